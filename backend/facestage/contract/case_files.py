"""The files of a case: a photo whose truth is known, made by the add-on and fitted by the bench."""

from __future__ import annotations

PHOTO, LANDMARKS, CAMERA, TRUTH = "photo.png", "landmarks.json", "camera.json", "truth.npz"
# The truth of a photo of a scanned head, and which vertices of a scan are its face.
SCAN, FACE_REGION = "scan.npz", "face_region.npy"
# The photo before it was encoded, its pixels as a compressed photo held them, where bare skin is.
LINEAR_PHOTO, COMPRESSED_PHOTO, SKIN = "photo.exr", "photo.jpg", "skin.png"
