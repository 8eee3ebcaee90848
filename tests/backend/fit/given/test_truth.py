"""Errors of an albedo texture against a known one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.contract.files.storage import write_arrays
from facestage.contract.skin_tone import chromaticity, typology_angle
from facestage.fit.given.face_color import face_tone
from facestage.fit.given.truth import VertexTruth, read_truth
from reference.synthetic_scene import Scene

TRUE = np.array([0.3, 0.17, 0.11])


def truth_of(scene: Scene, folder: Path, albedo: np.ndarray | None) -> VertexTruth:
    arrays = {"vertices": scene.model.vertices}
    if albedo is not None:
        arrays["albedo"] = albedo
    write_arrays(folder / "truth.npz", arrays)
    truth = read_truth(folder / "truth.npz", scene.geometry)
    assert isinstance(truth, VertexTruth)
    return truth


def test_tone_is_told_with_its_scale_and_albedo_without(scene: Scene, tmp_path: Path) -> None:
    truth = truth_of(scene, tmp_path, np.broadcast_to(TRUE, (32, 32, 3)).astype(np.float32))
    brighter = np.broadcast_to(1.5 * TRUE, (32, 32, 3)).copy()
    brighter[0] = 0.9  # a median does not mind the hairline
    errors = truth.tone_errors(brighter)
    assert errors["true_ita"] == pytest.approx(float(typology_angle(TRUE)), abs=1e-3)
    found = face_tone(scene.geometry, brighter)
    assert found == pytest.approx(float(typology_angle(1.5 * TRUE)), abs=1e-3)
    assert errors["chromaticity"] < 1e-6
    redder = TRUE * (1.2, 1.0, 1.0)
    shift = np.linalg.norm(chromaticity(redder) - chromaticity(TRUE))
    errors = truth.tone_errors(np.broadcast_to(redder, (32, 32, 3)).copy())
    assert errors["chromaticity"] == pytest.approx(float(shift), abs=1e-6)


def test_without_a_known_albedo_there_is_no_tone(scene: Scene, tmp_path: Path) -> None:
    assert truth_of(scene, tmp_path, None).tone_errors(np.full((4, 4, 3), 0.5)) == {}
