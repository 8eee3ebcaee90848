"""Surroundings by name, by file, and turned."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mathutils import Matrix

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError


def test_blenders_own_surroundings_are_known() -> None:
    from facestage_blender.synthetic.scans.light import read_surroundings, shipped

    assert {"interior", "courtyard", "sunset"} <= set(shipped())
    found = read_surroundings("sunset@-20.5")
    assert (found.name, found.turn, found.file) == ("sunset", -20.5, shipped()["sunset"])
    assert read_surroundings("night").turn == 0.0


def test_a_file_is_taken_by_its_name() -> None:
    from facestage_blender.synthetic.scans.light import read_surroundings

    found = read_surroundings("/some/where@home/my.hdr@90")
    assert (found.file, found.name, found.turn) == (Path("/some/where@home/my.hdr"), "my", 90.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("moon", "no light 'moon'; expected one of city, "),
        ("photo.jpg", "no light 'photo.jpg'"),
        ("interior@left", "turned by 'left'"),
        ("interior@nan", "turned by 'nan'"),
    ],
)
def test_what_lights_nothing_is_refused(text: str, words: str) -> None:
    from facestage_blender.synthetic.scans.light import read_surroundings

    with pytest.raises(InputError, match=words):
        read_surroundings(text)


def test_a_picture_that_is_none_is_refused(scene, tmp_path: Path) -> None:
    from facestage_blender.synthetic.scans.light import light_world, read_surroundings

    (tmp_path / "my.exr").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"my\.exr"):
        light_world(scene, read_surroundings(str(tmp_path / "my.exr")))


def test_surroundings_turn_about_the_vertical(scene, tmp_path: Path) -> None:
    """Bright on one half, dark on the other: a camera sees the one, or turned half round the
    other, and a border upright in its middle at a quarter.
    """
    from facestage_blender.pictures.render import render_linear, save_exr
    from facestage_blender.scene.camera import ensure_camera, write_camera
    from facestage_blender.synthetic.scans.light import light_world, read_surroundings

    halves = np.full((16, 32, 3), 0.01, np.float32)
    halves[:, :16] = 1.0
    save_exr(tmp_path / "halves.exr", halves)
    camera = ensure_camera(scene, scene.collection)
    camera.matrix_world = Matrix()
    write_camera(scene, camera.data, Camera.default(16, 16, 20.0))

    def seen(degrees: int) -> np.ndarray:
        light_world(scene, read_surroundings(f"{tmp_path / 'halves.exr'}@{degrees}"))
        picture = render_linear(scene, samples=1, background=True)[..., 0]
        assert np.ptp(picture, axis=0).max() < 0.02  # the vertical is upright
        return np.asarray(picture[8])

    rows = [seen(degrees) for degrees in (0, 90, 180, 270)]
    # Half round shows what was behind.
    for one, other in ((rows[0], rows[2]), (rows[1], rows[3])):
        np.testing.assert_allclose(one[[2, 13]] + other[[2, 13]], 1.01, atol=0.02)
    assert sorted(float(np.ptp(row[[2, 13]])) > 0.9 for row in rows) == [False, False, True, True]


def test_a_scene_with_its_vertical_along_z_shows_the_same(scene, tmp_path: Path):
    from facestage_blender.pictures.render import render_linear, save_exr
    from facestage_blender.scene import frames
    from facestage_blender.scene.camera import ensure_camera, write_camera
    from facestage_blender.synthetic.scans.light import light_world, read_surroundings

    save_exr(tmp_path / "my.exr", np.random.default_rng(3).random((16, 32, 3), np.float32))
    sky = read_surroundings(f"{tmp_path / 'my.exr'}@70")
    camera = ensure_camera(scene, scene.collection)
    write_camera(scene, camera.data, Camera.default(16, 16, 20.0))
    pictures = []
    for vertical, matrix in (
        ("Y", np.eye(4)),
        ("Z", frames.local_matrix(np.eye(4), frames.CAMERA)),
    ):
        camera.matrix_world = Matrix(matrix.tolist())
        light_world(scene, sky, vertical=vertical)
        pictures.append(render_linear(scene, samples=1, background=True)[..., :3])
    np.testing.assert_allclose(pictures[0], pictures[1], atol=0.02)
    assert np.ptp(pictures[0]) > 0.3


def test_the_fit_takes_a_map_for_the_same_surroundings(scene, tmp_path: Path) -> None:
    """Each pixel of the background has the color of the texel that lies there, turned or not."""
    from facestage.contract.environment import directions
    from facestage_blender.pictures.render import render_linear, save_exr
    from facestage_blender.scene import frames
    from facestage_blender.scene.camera import ensure_camera, write_camera
    from facestage_blender.synthetic.scans.light import light_world, read_surroundings

    towards = directions(32, 64)
    picture = (0.5 + 0.4 * towards).astype(np.float32)  # smooth, and every direction its own color
    save_exr(tmp_path / "my.exr", picture)
    camera, lens = ensure_camera(scene, scene.collection), Camera.default(16, 16, 20.0)
    write_camera(scene, camera.data, lens)
    camera.matrix_world = Matrix(frames.local_matrix(np.eye(4), frames.CAMERA).tolist())
    y, x = np.mgrid[:16, :16] + 0.5
    rays = np.stack([x - 8, 8 - y, np.full_like(x, -20.0)], axis=-1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    for degrees in (0, 70):
        light_world(scene, read_surroundings(f"{tmp_path / 'my.exr'}@{degrees}"), vertical="Z")
        seen = render_linear(scene, samples=4, background=True)[..., :3].reshape(-1, 3)
        turned = directions(32, 64, degrees).reshape(-1, 3)
        nearest = np.argmax(rays @ turned.T, axis=1)
        np.testing.assert_allclose(seen, picture.reshape(-1, 3)[nearest], atol=0.04)
