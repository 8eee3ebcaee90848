"""Where the photo shows a brow: what is darker than skin around the brows' landmarks."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.textures.albedo_detail import LOG_DARKER_MAX
from facestage.fit.textures.shown import BROW_DEPARTURE, hair_share


def test_a_brow_is_dark_and_near_its_landmarks():
    skin = np.full((5, 3), [0.5, 0.4, 0.3])
    photo = skin * np.exp([[0.0], [-0.3], [-0.5], [-0.7], [-2.0]])
    brows = np.ones(5, bool)
    assert hair_share(brows, photo, skin) == pytest.approx([0, 0, 0.5, 1, 1], abs=1e-6)
    assert not hair_share(~brows, photo, skin).any()


def test_a_brow_in_the_dark_and_one_without_light_are_numbers():
    dark = np.zeros((2, 3))
    assert np.isfinite(hair_share(np.ones(2, bool), dark, dark)).all()


def test_black_hair_is_within_what_a_brow_may_depart():
    """Reflectance of black hair is a few percent, of light skin a third and more."""
    assert LOG_DARKER_MAX < np.log(0.35 / 0.05) <= BROW_DEPARTURE
