"""From a state to radiance: shading, reflectance, one-light images, pictures.

May import face.
"""
