"""People in the surroundings that Blender ships, which are all their light."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from addon.synthetic.people import SIZE, person_of
from facestage.contract.face_model import FaceModel
from facestage.contract.files.storage import read_arrays


def test_each_of_blenders_surroundings_lights_one_person() -> None:
    from facestage_blender.synthetic.cases.skies import skies
    from facestage_blender.synthetic.scans.light import shipped

    cases = skies()
    assert set(cases) == set(shipped())
    for name, recipe in cases.items():
        assert recipe.name == name and recipe.sky is not None and recipe.sky.name == name
    assert len({recipe.pose for recipe in cases.values()}) == len(cases)


def test_the_sky_is_all_the_light_there_is(scene, head: FaceModel, tmp_path: Path) -> None:
    from facestage_blender.pictures.render import read_pixels
    from facestage_blender.synthetic.cases.skies import skies
    from facestage_blender.synthetic.photograph import render_person

    person = person_of(head, skies()["studio"], 3)
    assert not person.stage.radiance.any()
    render_person(scene, head, person, tmp_path / "case", samples=4, seed=3, size=SIZE)
    truth = read_arrays(tmp_path / "case" / "truth.npz", "truth")
    assert not any(name.startswith("light") for name in truth)
    photo = read_pixels(tmp_path / "case" / "photo.exr")[..., :3]
    assert np.percentile(photo[truth["mask"]], 99) > 0.5
