"""Pictures in and out: photographs of any file format and color space, always linear floats inside.

May import the contract, the room system, numpy, OpenCV and Pillow.
"""
