"""A performance from a film: one person, a pose and an expression for every frame.

May import every room of the fit.
"""
