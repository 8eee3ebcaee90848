"""A fitted face to its folder, and a finished one rendered again.

May import textures, runs and what those may import.
"""
