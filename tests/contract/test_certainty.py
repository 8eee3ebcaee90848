"""The scale of certainty.png, against matplotlib's own."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import colormaps

from facestage.contract.certainty import COLOR_MAP, colors, finite_mm, scale_end


def test_colors_are_the_color_map() -> None:
    shares = np.linspace(-0.2, 1.2, 501)
    wanted = colormaps[COLOR_MAP](np.clip(shares, 0, 1))[:, :3]
    off = np.abs(colors(shares) - wanted).max() * 255
    print(f"{off:.1f} codes, at most 6")
    assert off < 6


def test_the_scale_ends_where_nearly_all_of_the_face_lies_below() -> None:
    total = np.concatenate([np.full(100, 1.7), np.full(900, 40.0)])
    assert scale_end(total, np.arange(100)) == pytest.approx(2.0)
    assert scale_end(total, np.arange(1000)) == pytest.approx(50.0)
    assert scale_end(0 * total, np.arange(1000)) == scale_end(total, np.arange(0)) == 0.1


def test_what_nothing_holds_is_shown_as_nothing() -> None:
    found = finite_mm(np.array([[np.inf, np.nan, 2.0], [-1.0, 0.5, 1e300]]))
    np.testing.assert_array_equal(found, np.array([[0, 0, 2], [0, 0.5, 1e9]]))
