"""One job, read and checked: photo, window, skin mask, what hides the face, truth.

May import forward and what that may import.
"""
