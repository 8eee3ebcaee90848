"""Energy: the terms, one a file, their noise and normal equations, and the plan of what to leave
out.

May import given and what those may import.
"""
