"""Pixels: renders of Cycles, picture files, images of the .blend, textures painted at vertices."""
