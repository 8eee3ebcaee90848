"""The unknowns, and the mesh that they move.

Imports no other room of the fit.
"""
