"""Photographs of a scanned head: geometry and skin that no face model contains.

Frames: the head's own is x towards the picture's right when the head looks at the camera, y up, z
the way it looks, in millimetres; a posed head is in the camera's frame of the contract.
"""
