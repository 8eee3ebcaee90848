"""Photographs whose truth is known, one for each thing that is hard about real ones.

`python -m facestage_blender.cases` makes them. Only `synthetic.py` of the parent, which takes the picture, needs bpy.
"""
