"""Adds Facestage's classes to Blender and takes them away again."""

from __future__ import annotations

import bpy

from . import preferences, properties, translations
from .landmarks.overlay import OVERLAY as LANDMARK_OVERLAY
from .pins.overlay import OVERLAY as PIN_OVERLAY
from .preview import live as preview
from .scene import color_views, keeping
from .ui import (
    backend_task,
    control_rig,
    export,
    expressions,
    face,
    faces,
    fit,
    install,
    landmarks,
    light_stage,
    own_mesh,
    photo,
    pins,
    relight,
    result,
    white_balance,
)

# Panels stand in the sidebar in the order in which they are registered.
MODULES = (
    properties,
    preferences,
    backend_task,
    install,
    landmarks,
    faces,
    photo,
    white_balance,
    light_stage,
    face,
    own_mesh,
    pins,
    fit,
    export,
    relight,
    result,
    expressions,
    control_rig,
)


def register() -> None:
    """Register every class, then attach the property groups."""
    translations.register()
    for module in MODULES:
        for cls in module.CLASSES:
            bpy.utils.register_class(cls)
    properties.attach()
    backend_task.register()
    keeping.register()
    color_views.register()
    preview.register()
    LANDMARK_OVERLAY.register()
    PIN_OVERLAY.register()
    pins.register()


def unregister() -> None:
    """Undo :func:`register`, last first; a fit still running is stopped."""
    pins.unregister()
    PIN_OVERLAY.unregister()
    LANDMARK_OVERLAY.unregister()
    preview.unregister()
    color_views.unregister()
    keeping.unregister()
    backend_task.unregister()
    properties.detach()
    for module in reversed(MODULES):
        for cls in reversed(module.CLASSES):
            bpy.utils.unregister_class(cls)
    translations.unregister()
