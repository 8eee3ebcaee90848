"""Lays the default head onto any face mesh, and carries over what that mesh does not bring.

May import the rooms anatomy and mesh; the default head is an argument.
"""
