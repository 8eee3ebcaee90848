"""Landmarks on the photo: named points that are dragged on a plane before the camera, and drawn."""
