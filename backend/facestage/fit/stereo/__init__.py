"""What the same skin, seen in two photos, says of the shape: multi-view stereo on the face model's
surface.
"""
