"""What the same skin, seen in two photos, says of the shape: stereo on the face model's surface.

May import energy and what that may import.
"""
