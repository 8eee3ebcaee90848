"""Photographs whose truth is known, one for each thing that is hard about real ones.

`python -P -m facestage_blender.cases` makes them: recipes and people are plain arrays, and
`photograph.py` takes the picture.
"""
