"""How light the skin is, said in the panel: what the job gets, and whose it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.contract.skin_tone import typology_angle


@pytest.fixture
def ready(scene, photo: Path):
    import bpy

    for answer in (
        bpy.ops.facestage.choose_photo(filepath=str(photo)),
        bpy.ops.facestage.build_stage(),
        bpy.ops.facestage.build_rig(),
    ):
        assert answer == {"FINISHED"}
    return scene


@pytest.mark.parametrize(
    ("tone", "angle"), [("PHOTO", None), ("VERY_LIGHT", 62.5), ("DARK", -55.0), ("ANGLE", -21.0)]
)
def test_the_job_knows_what_is_said(ready, tone: str, angle: float | None) -> None:
    from facestage_blender.exchange.scene_read import read_job

    settings = ready.facestage
    assert settings.skin_tone == "PHOTO"
    settings.skin_tone, settings.skin_angle = tone, -21.0
    assert read_job(ready).skin_tone == angle
    shown = float(typology_angle(np.array(settings.skin_color)))
    assert shown == pytest.approx(34.5 if angle is None else angle, abs=2)


@pytest.mark.parametrize(
    ("color", "angle"),
    [
        ((0.129, 0.047, 0.025), -48.1),
        ((0.437, 0.292, 0.244), 52.1),
        ((0, 0, 0), -80),
        ((1, 1, 1), 70),
    ],
)
def test_a_color_says_its_angle(ready, color: tuple[float, float, float], angle: float) -> None:
    from facestage_blender.exchange.scene_read import read_job

    ready.facestage.skin_tone = "LIGHT"
    ready.facestage.skin_color = color
    assert ready.facestage.skin_tone == "ANGLE"
    assert read_job(ready).skin_tone == pytest.approx(angle, abs=0.5)


def test_it_is_of_one_person(ready, photo: Path, tmp_path: Path) -> None:
    import shutil

    import bpy

    settings = ready.facestage
    settings.skin_tone = "BROWN"
    other, third = (Path(shutil.copy(photo, tmp_path / f"{n}{photo.suffix}")) for n in (2, 3))
    added = bpy.ops.facestage.add_photos(directory=str(tmp_path), files=[{"name": other.name}])
    assert added == {"FINISHED"}
    bpy.ops.facestage.show_photo(number=1)
    assert settings.skin_tone == "BROWN", "photos of one person show one skin"
    bpy.ops.facestage.remove_photo(number=2)
    assert bpy.ops.facestage.add_face() == {"FINISHED"}
    assert settings.skin_tone == "PHOTO", "another face has skin of its own"
    bpy.ops.facestage.show_face(number=1)
    assert settings.skin_tone == "BROWN"
    assert bpy.ops.facestage.choose_photo(filepath=str(third)) == {"FINISHED"}
    assert settings.skin_tone == "PHOTO", "another photo may show somebody else"
