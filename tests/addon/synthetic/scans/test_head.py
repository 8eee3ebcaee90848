"""Heads from OBJ files of any kind, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError

# A box of 100 x 150 x 80 mm, its front (+Z) of five corners: quads, a polygon, negative numbers.
CORNERS = """v -50 -75 -40
v 50 -75 -40
v 50 75 -40
v -50 75 -40
v -50 -75 40
v 50 -75 40
v 50 75 40
v 0 75 40
v -50 75 40
"""
FACES = """f 4 3 2 1
f 5 6 7 8 9
f 1 2 6 5
f -8 -7 -3 -4
f 3 4 9 8 7
f 4 1 5 9
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "box.obj"
    path.write_text(text, encoding="utf-8")
    return path


def read(path: Path, units: str = "mm", facing: str = "+Z", up: str = "+Y"):
    from facestage_blender.synthetic.scans.head import read_head

    return read_head(path, units, facing, up)


def volume(vertices: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return float((np.cross(a, b) * c).sum() / 6)


def test_polygons_of_any_kind_are_read(scene, tmp_path: Path) -> None:
    head = read(write(tmp_path, CORNERS + FACES))
    assert head.complete and not head.has_uvs
    assert len(head.vertices) == 9 and len(head.triangles) == 2 + 3 + 2 + 2 + 3 + 2
    np.testing.assert_array_equal(head.vertices[7], [0, 75, 40])
    assert volume(head.vertices, head.triangles) == pytest.approx(100 * 150 * 80)


def test_a_surface_inside_out_is_turned(scene, tmp_path: Path) -> None:
    faces = "\n".join(
        " ".join(["f", *reversed(line.split()[1:])]) for line in FACES.strip().split("\n")
    )
    head = read(write(tmp_path, CORNERS + faces))
    assert volume(head.vertices, head.triangles) == pytest.approx(100 * 150 * 80)


def test_units_and_axes(scene, tmp_path: Path) -> None:
    """The same box in centimetres, its crown along -X and looking along +Y."""
    lines = []
    for line in CORNERS.strip().split("\n"):
        x, y, z = (float(word) / 10 for word in line.split()[1:])
        lines.append(f"v {-y} {z} {-x}")
    found = read(write(tmp_path, "\n".join(lines) + "\n" + FACES), "cm", "+Y", "-X")
    np.testing.assert_allclose(
        found.vertices, read(write(tmp_path, CORNERS + FACES)).vertices, atol=1e-4
    )


def test_no_axes_make_a_mirror_image() -> None:
    from facestage_blender.synthetic.scans.head import AXES, axes

    np.testing.assert_array_equal(axes("+Z", "+Y"), np.eye(3))
    for facing in AXES:
        for up in AXES:
            if facing[1] != up[1]:
                assert np.linalg.det(axes(facing, up)) == pytest.approx(1.0)


def test_loose_vertices_are_noticed_and_objects_are_one(scene, tmp_path: Path) -> None:
    lines = FACES.split("\n")
    halves = "\n".join(["o first", *lines[:3], "o second", *lines[3:]])
    assert read(write(tmp_path, CORNERS + halves)).complete
    with_loose = read(write(tmp_path, CORNERS + "v 0 0 0\n" + FACES.replace("f -8", "f 2 3 7 6 #")))
    assert len(with_loose.vertices) == 9 and not with_loose.complete


def test_uvs_are_seen(scene, tmp_path: Path) -> None:
    faces = "\n".join(
        " ".join(["f", *(f"{word}/1" for word in line.split()[1:])])
        for line in FACES.replace("-8 -7 -3 -4", "2 3 7 6").strip().split("\n")
    )
    assert read(write(tmp_path, CORNERS + "vt 0.5 0.5\n" + faces)).has_uvs


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no polygon|cannot be read"),  # Blender 5.2 does not read an empty file
        ("nonsense\n", "no polygon"),
        (CORNERS, "no polygon"),
        (CORNERS + "f 1 2 99\n", "no polygon"),
        (CORNERS.replace("0 ", "0000 ") + FACES, "mm large if its unit is mm"),
    ],
)
def test_what_is_no_head_is_refused(scene, tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read(write(tmp_path, text))


def test_what_cannot_be_a_head_is_refused(scene, tmp_path: Path) -> None:
    path = write(tmp_path, CORNERS + FACES)
    with pytest.raises(InputError, match="does not exist"):
        read(tmp_path / "none.obj")
    with pytest.raises(InputError, match=r"150000 mm|1\.5e\+05 mm"):
        read(path, "m")
    with pytest.raises(InputError, match="cannot look along \\+Y and have its crown along -Y"):
        read(path, "mm", "+Y", "-Y")
