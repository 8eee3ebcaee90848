"""Solve: bounded Gauss-Newton, damping, line search, covariance; knows no face.

Imports no other room of the fit.
"""
