"""Whatever is done to a result's files: it loads sound, or is refused in one sentence of one
line.
"""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_arrays
from facestage.contract.result import Result
from reference.tampering import copy_of, tamperings

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes and /dev/zero are of Unix")


@pytest.fixture
def sound(tmp_path: Path, result: Result) -> Path:
    folder = tmp_path / "sound"
    folder.mkdir()
    replace(result, triangles=np.clip(result.triangles, 0, 8)).write_into(folder)
    return folder


def test_every_tampering_is_refused_in_one_line_or_harmless(sound: Path, tmp_path: Path):
    refused = harmless = 0
    for name, deed in tamperings(sound):
        folder = copy_of(sound, tmp_path / "spoiled")
        deed(folder)
        try:
            result = Result.load(folder)
        except InputError as error:
            refused += 1
            check_sentence(str(error), name)
        else:
            harmless += 1
            check_finite(result, name)
    print(f"{refused} refused, {harmless} harmless")
    assert refused > 500


@pytest.mark.parametrize("name", ["identity", "expression"])
def test_files_of_two_fits_are_told_apart(sound: Path, name: str):
    arrays = read_arrays(sound / "result.npz", "arrays")
    np.savez(sound / "result.npz", **(arrays | {name: arrays[name] + 0.1}))
    with pytest.raises(InputError, match=rf"another {name}; run the fit again"):
        Result.load(sound)


def test_a_value_is_named_by_its_path_and_shortened(sound: Path):
    data = json.loads((sound / "result.json").read_text())
    data["camera"]["width"] = "\x1b[2J" + "w" * 10_000_000
    (sound / "result.json").write_text(json.dumps(data))
    with pytest.raises(
        InputError, match=r"result\.json: camera\.width is '.x1b.*\(10000004 characters\)"
    ) as caught:
        Result.load(sound)
    assert len(str(caught.value)) < 500 and "a whole number of 1 to 16384" in str(caught.value)


def test_what_a_newer_version_adds_is_ignored(sound: Path):
    data = json.loads((sound / "result.json").read_text())
    (sound / "result.json").write_text(json.dumps(data | {"mood": [None]}))
    arrays = read_arrays(sound / "result.npz", "arrays")
    np.savez(sound / "result.npz", **(arrays | {"hair": np.full(3, np.nan)}))
    assert Result.load(sound).model == "default"


def check_sentence(sentence: str, name: str) -> None:
    assert sentence.isprintable() and 30 < len(sentence) < 1000, (name, sentence)
    assert sentence.endswith((".", "?")) and "spoiled" in sentence, (name, sentence)


def check_finite(result: Result, name: str) -> None:
    stage = vars(result.stage).values()
    own = (result.identity, result.expression, result.albedo, result.specular, result.vertices)
    for array in (*own, *stage, result.model_to_stage, np.array(result.camera.principal_px)):
        assert np.isfinite(np.asarray(array, np.float32)).all(), name
    assert 0 <= result.roughness <= 1, name
