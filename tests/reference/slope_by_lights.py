"""The derivative of a term's residuals that only lights move, against differences."""

from __future__ import annotations

import numpy as np

from facestage.fit.energy.robust_residuals import RobustResiduals
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State


def assert_slope_by_lights(term: RobustResiduals, state: State, least: float) -> None:
    """In a random direction each residual changes by more than ``least``, and as they say."""
    layout = Layout(state)
    where = layout.slices["lights"]
    slope = term.jacobian(state, layout)
    assert not np.delete(slope, np.arange(where.start, where.stop), axis=1).any()
    direction = np.zeros(layout.size)
    direction[where] = np.random.default_rng(0).normal(size=where.stop - where.start)
    plus, minus = (term.residuals(layout.apply(state, s * 1e-5 * direction)) for s in (1, -1))
    np.testing.assert_allclose(slope @ direction, (plus - minus) / 2e-5, rtol=1e-6)
    assert np.abs(slope @ direction).min() > least
