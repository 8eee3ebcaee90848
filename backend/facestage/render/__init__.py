"""Ray tracing: the only place that imports Mitsuba and Dr.Jit.

May import the contract and ``facestage.native``. Hands out and takes numpy arrays only.
"""
