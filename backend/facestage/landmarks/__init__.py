"""Finds faces in a photograph and their landmarks: the networks of MediaPipe's Face Landmarker, run
by OpenCV.

Imports numpy, OpenCV, pooch, facestage.contract, facestage.system and facestage.images.
"""
