"""``facestage bench``: error against run time of the solver and of its alternatives, on cases with
known truth.

May import the contract, models, fit, report's figures and ``facestage.render``'s numpy interfaces;
never the renderer itself, never Blender.
"""
