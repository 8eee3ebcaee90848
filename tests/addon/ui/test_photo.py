"""Which files the photo's browser shows, and that Blender reads them."""

from __future__ import annotations

from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.jpeg", "a.webp", "a.tif", "a.tiff", "a.exr"])
def test_the_browser_shows_every_kind_of_photo(scene, name: str) -> None:
    import bpy

    for operator in (bpy.ops.facestage.choose_photo, bpy.ops.facestage.add_photos):
        patterns = operator.get_rna_type().properties["filter_glob"].default.split(";")
        assert any(fnmatch(name, pattern) for pattern in patterns)


@pytest.mark.parametrize("suffix", [".webp", ".tif"])
def test_photos_of_phones_and_scanners_are_read(scene, tmp_path: Path, suffix: str) -> None:
    import bpy
    from PIL import Image

    path = tmp_path / f"a photo{suffix}"
    Image.fromarray(np.full((40, 60, 3), 90, np.uint8)).save(path)
    assert bpy.ops.facestage.choose_photo(filepath=str(path)) == {"FINISHED"}
    assert (scene.render.resolution_x, scene.render.resolution_y) == (60, 40)
