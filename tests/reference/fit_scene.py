"""A fit in the open Blender scene, step by step as the panel has them."""

from __future__ import annotations

from pathlib import Path


def fit_scene(photo: Path, landmarks: Path) -> None:
    """Choose the files, build stage and rig, and fit; the result is applied."""
    import bpy

    for answer in (
        bpy.ops.facestage.choose_photo(filepath=str(photo)),
        bpy.ops.facestage.choose_landmarks(filepath=str(landmarks)),
        bpy.ops.facestage.build_stage(),
        bpy.ops.facestage.build_rig(),
        bpy.ops.facestage.fit(),
    ):
        assert answer == {"FINISHED"}
