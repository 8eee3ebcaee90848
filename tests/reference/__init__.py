"""Slow, obviously right float64 numpy code that the fast code is compared to, and small synthetic
scenes.

May import numpy and facestage.contract; the scenes also facestage.fit, which they feed.
"""
