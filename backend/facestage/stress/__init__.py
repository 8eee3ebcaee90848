"""Stiff and extreme cases through the real fitting engine: scenes with known truth, and a verdict
on each.

May import everything of the backend but the renderer itself; each case runs in a process of its
own.
"""
