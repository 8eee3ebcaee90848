"""Bounded Gauss-Newton: steps, damping, line search, covariance. Knows no face.

Imports no other room of the fit.
"""
