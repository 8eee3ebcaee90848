"""Forward: from a state to radiance: shading, one-light images, pictures.

May import face and what those may import.
"""
