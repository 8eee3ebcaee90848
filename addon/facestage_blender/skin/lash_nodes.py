"""Geometry nodes that let lashes follow the lids of a rig, whatever its shape keys do."""

from __future__ import annotations

import bpy

from .vector_nodes import BALL, OFFSET, RiggedVectors

GROUP = "Facestage Lashes"
# Of each vertex of the lashes, beside its root and eyeball: the inner and outer corner of the eye.
# Its offset is along the eye, away from the eyeball, and across both.
CORNERS = ("corner_0", "corner_1")


def lash_group(rig: bpy.types.Object) -> bpy.types.NodeTree:
    """New nodes that put each vertex at its offset from where ``rig`` has its root, turned with
    the lid about the eyeball.
    """
    build = RiggedVectors(GROUP, rig)
    root = build.root()
    middle = build.scaled(build.sum([build.point_of(name) for name in BALL]), 0.5)
    away = build.math("NORMALIZE", build.math("SUBTRACT", root, middle))
    corners = [build.point_of(name) for name in CORNERS]
    across = build.math(
        "NORMALIZE",
        build.math("CROSS_PRODUCT", away, build.math("SUBTRACT", corners[1], corners[0])),
    )
    along = build.math("CROSS_PRODUCT", across, away)
    offset = build.split(build.named(OFFSET, "FLOAT_VECTOR"))
    moved = [build.scaled(axis, s) for axis, s in zip((along, away, across), offset, strict=True)]
    build.tree.links.new(build.placed(build.given, build.sum([root, *moved])), build.result)
    return build.tree
