"""Modes of the built-in head that carry others along, as faces of people vary."""

from __future__ import annotations

import numpy as np

from facestage.models.head.assemble import assemble
from facestage.models.head.default_head import build_default_model
from facestage.models.head.identity import identity_modes
from facestage.models.head.masks import Masks
from facestage.models.head.variation import TOGETHER, mixing


def test_a_mode_is_the_sum_of_its_parts_and_the_others_are_as_they_were():
    model = build_default_model()
    names, independent = identity_modes(Masks(assemble()))
    assert model.identity_names == names
    for name, mode in zip(names, model.identity_basis, strict=True):
        parts = TOGETHER.get(name, {name: 1.0})
        expected = sum(weight * independent[names.index(part)] for part, weight in parts.items())
        np.testing.assert_allclose(1e3 * mode, expected, atol=1e-4, err_msg=name)


def test_only_modes_that_are_named_after_nothing_measured_carry_others():
    for name, parts in TOGETHER.items():
        assert name.startswith("smooth_")
        assert parts[name] > 1, "its own variance stays"
        assert not any("asymmetry" in part for part in parts), "faces are symmetric in the mean"
        assert "head_size" not in parts, "no photo knows it"


def test_two_directions_vary_as_in_people_and_the_rest_as_before():
    """The variances are those that tools/derive_variation.py prints: 14.8, 10.5, then 4.3. What the
    bearing modes were alone varies less for it: two directions of the eighty.
    """
    names = build_default_model().identity_names
    matrix = mixing(names)
    variances = np.linalg.eigvalsh(matrix.T @ matrix)
    print(f"largest {variances[-2:]}, smallest {variances[:2]}")
    np.testing.assert_allclose(variances[-2:], (10.5, 14.8), rtol=0.05)
    np.testing.assert_allclose(variances[2:-2], 1.0, atol=1e-6)
    assert variances[0] > 0.15
