"""What a camera adds to a picture, and the truth beside it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from addon.synthetic.people import SIZE, person_of, recipe
from facestage.bench.cases import Case
from facestage.contract.face_model import FaceModel
from facestage.contract.files.storage import read_arrays
from facestage.fit.forward.shading import sample_bilinear
from reference.known import known


def test_a_sensor_counts_electrons() -> None:
    from facestage_blender.synthetic.photograph import READ_NOISE, noisy

    picture = np.full((200, 200, 3), 0.25)
    assert noisy(picture, None, np.random.default_rng(0)) is picture
    counted = noisy(picture, 400, np.random.default_rng(0))
    assert counted.mean() == pytest.approx(0.25, rel=2e-3)
    assert counted.std() == pytest.approx(np.sqrt(0.25 * 400 + READ_NOISE**2) / 400, rel=0.02)


def test_a_snapshot_has_all_of_it(scene, model: FaceModel, tmp_path: Path) -> None:
    from facestage_blender.pictures.render import read_pixels
    from facestage_blender.synthetic.photograph import render_person
    from facestage_blender.synthetic.sightlines import BACKGROUND, FACE, HEAD, NARROW_FACE, WORN

    person = person_of(model, recipe("snapshot"), 3)
    assert [item.name for item in person.worn] == ["Strands", "Hand"] and len(person.around) == 2
    render_person(scene, model, person, tmp_path / "case", samples=2, seed=1, size=SIZE)
    folder = tmp_path / "case"
    truth = read_arrays(folder / "truth.npz", "truth")
    photo, compressed = (read_pixels(folder / f"photo.{kind}")[..., :3] for kind in ("png", "jpg"))
    np.testing.assert_array_equal(photo, compressed)
    exact = read_pixels(folder / "photo.exr")[..., :3]
    # The walls are orange, and no part of what the exposure was measured on.
    wall = exact[truth["labels"] == BACKGROUND].mean(axis=0)
    assert (
        wall[0] > 2 * wall[1] > 2 * wall[2]
        and not truth["mask"][truth["labels"] == BACKGROUND].any()
    )
    skin = read_pixels(folder / "skin.png")[..., 0] > 0.5
    np.testing.assert_array_equal(skin, np.isin(truth["labels"], (NARROW_FACE, FACE, HEAD)))
    assert (truth["labels"] == WORN).mean() > 0.03
    lens = scene.camera.data.dof
    assert (
        lens.use_dof
        and lens.aperture_fstop == pytest.approx(2.8)
        and 0.6 < lens.focus_distance < 0.8
    )
    assert known(Case("snapshot", folder, "default").job().camera).width == SIZE


def test_truth_shows_the_albedo_of_the_face_tile(head: FaceModel) -> None:
    from facestage_blender.synthetic.photograph import face_tile

    texture = np.random.default_rng(2).uniform(size=(64, 64, 3))
    model = replace(head, face_tile=(0.25, 0.125, 0.5))
    uvs = np.random.default_rng(3).uniform(0.05, 0.95, (200, 2))
    tile = face_tile(texture, model)
    assert tile.shape == (32, 32, 3)
    np.testing.assert_allclose(
        sample_bilinear(tile, uvs),
        sample_bilinear(texture, np.array([0.25, 0.125]) + 0.5 * uvs),
        atol=1e-9,
    )
