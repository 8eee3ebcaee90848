"""The terms of the energy, one a file, their noise, and the plan of what to leave out.

May import given and what that may import.
"""
