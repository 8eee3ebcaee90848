"""Pixels: renders of Cycles, picture files, and textures painted from values at vertices."""
