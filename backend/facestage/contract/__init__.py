"""What the Blender add-on and the fitting backend say to each other: files, frames and units.

May import numpy, marshmallow and the standard library only, because it is loaded inside Blender
too. Conventions (frames, units, color): see ``contract/CONVENTIONS.md``.
"""
