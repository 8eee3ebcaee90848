"""Facestage's Blender extension: build a light stage and a face rig, fit them to a photo, edit the
result.

May import bpy, numpy and facestage.contract only; the fitting itself runs in a process of its own.
Importing this package is cheap and needs no bpy; :func:`register` loads the rest.
"""


def register() -> None:
    """Add Facestage to Blender."""
    from . import registration

    registration.register()


def unregister() -> None:
    """Remove Facestage from Blender."""
    from . import registration

    registration.unregister()
