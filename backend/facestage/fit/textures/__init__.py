"""Texel maps: albedo, gloss, symmetry, parts, merging of several photos.

May import trust and what that may import.
"""
