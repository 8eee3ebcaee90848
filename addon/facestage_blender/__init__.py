"""Facestage's Blender extension: build a light stage and a face rig, fit them to a photo, edit the
result.

May import bpy, numpy and facestage.contract only; the fitting itself runs in a process of its own.
Importing this package is cheap and needs no bpy; :func:`register` loads the rest.
"""

import sys


def _forget_contract() -> None:
    """Let go of the contract in memory, where this is an extension that takes the place of an older
    one in a Blender that runs: the older one's is still loaded, from a wheel that is gone.
    """
    own = f"{__package__}."
    if own.startswith("bl_ext.") and not any(name.startswith(own) for name in sys.modules):
        for name in [name for name in sys.modules if f"{name}.".startswith("facestage.")]:
            del sys.modules[name]


_forget_contract()


def register() -> None:
    """Add Facestage to Blender."""
    from . import registration

    registration.register()


def unregister() -> None:
    """Remove Facestage from Blender."""
    from . import registration

    registration.unregister()
