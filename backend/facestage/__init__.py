"""Facestage's fitting backend: a photograph and a face model in, an editable face out.

Importing this package is cheap; Mitsuba and OpenCV load only when a fit starts. Never imports bpy.
"""

__version__ = "0.1.0"
