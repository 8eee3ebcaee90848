"""Meshes in .obj files: what is there, or a clause that names the file."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.models.files.obj_text import parse_mesh, parse_vertices

QUAD = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"


def test_quads_and_triangles():
    mesh = parse_mesh(QUAD + b"f 1/1 2/2 3/3 4/4\nf 1/4/1 2/3/1 3/2/1\n# end\n", "a.obj")
    np.testing.assert_array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(mesh.texture, [[0, 0], [1, 0], [1, 1], [0, 1]])
    np.testing.assert_array_equal(mesh.polygons, [[0, 1, 2, 3], [0, 1, 2, -1]])
    np.testing.assert_array_equal(mesh.polygon_texture, [[0, 1, 2, 3], [3, 2, 1, -1]])


@pytest.mark.parametrize(
    "number", [b"nan", b"inf", b"-inf", b"1e400", b"1e7", b"x", b"\xff\xfe", b"", b"0x10", b"1_0e9"]
)
def test_coordinates_are_plausible_numbers(number: bytes):
    with pytest.raises(ValueError, match=r"^a\.obj "):
        parse_vertices(b"v 0 0 0\nv 0 1 " + number + b"\n", "a.obj")


@pytest.mark.parametrize(
    "line",
    [
        b"f 1/1 2/2 5/3",
        b"f 0/1 2/2 3/3",
        b"f -1/1 2/2 3/3",
        b"f 1/1 2/2 3/9",
        b"f 1/1 2/2",
        b"f 1 2 3",
        b"f ",
        b"f 1/1 2/2 3/3 4/4 1/1",
        b"f 1.5/1 2/2 3/3",
        b"f " + b"9" * 5000 + b"/1 2/2 3/3",
        b"f a/1 2/2 3/3",
        b"f 99999999999999999999/1 2/2 3/3",
        b"f 1/ 2/ 3/",
        b"f \xc3\xa9/1 2/2 3/3",
    ],
)
def test_polygons_are_of_points_that_are_there(line: bytes):
    with pytest.raises(ValueError, match=r"^a\.obj has a polygon"):
        parse_mesh(QUAD + line + b"\n", "a.obj")


@pytest.mark.parametrize("text", [b"", b"\n" * 1000, b"vt 0 0\n"])
def test_a_mesh_without_points_is_named(text: bytes):
    with pytest.raises(ValueError, match=r"a\.obj has 0 points"):
        parse_mesh(text, "a.obj")
