"""Textures: texel maps: albedo, gloss, symmetry, parts, merging.

May import trust, forward and what those may import.
"""
