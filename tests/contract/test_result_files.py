"""Which files of a result's or a person's folder are Facestage's; all others are the user's."""

from __future__ import annotations

from pathlib import PurePath

import pytest

from facestage.contract.result_files import is_result_file

OURS = """
    result.json result.npz job.json job.npz landmarks.json trace.jsonl relight.npz report.html
    albedo.exr specular.exr roughness.exr render.exr light_probe.exr coverage.png
    person.json person.html albedo.png texture_coverage.png relit_0.png relit_left_2.png
    1-anna/result.json 8-x/albedo.png
"""
THEIRS = """
    face.blend result.txt Result.json notes.png albedo.jpg albedo face.exr relit_.png relit_0.exr
    relit_a-b.png 0-anna/result.json 9-anna/result.json 1-/result.json 12-anna/result.json
    anna/result.json 1-anna/notes.txt 1-anna/deep/result.json deep/1-anna/result.json
    result.json/a 1-anna
"""


@pytest.mark.parametrize("path", [*OURS.split(), "2-a\nb/relit_0.png"])
def test_what_facestage_writes(path: str):
    assert is_result_file(PurePath(path)) is True


@pytest.mark.parametrize("path", [*THEIRS.split(), ""])
def test_what_is_the_users(path: str):
    assert is_result_file(PurePath(path)) is False
