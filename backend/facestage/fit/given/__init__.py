"""Given: one job, read and checked: photo, window, skin mask, occluders, truth.

May import forward and what those may import.
"""
