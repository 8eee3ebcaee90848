"""The least squares of one photo or several with every row written out: slow, and obviously
right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.energy.photo_jacobian import Jacobian
from facestage.fit.energy.priors import Priors
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_color import LightPrior
from facestage.fit.face.state import State
from facestage.fit.stages.photo_descent import PhotoDescent


@dataclass(frozen=True)
class Rows:
    """Residuals r (m,), their derivatives J (m, size) and weights w (m,) of an energy 0.5 sum w
    r^2.
    """

    jacobian: np.ndarray
    residual: np.ndarray
    weights: np.ndarray
    concave: tuple[int, ...] = ()  # rows that have no part in the Hessian

    def normal_equations(self) -> tuple[np.ndarray, np.ndarray]:
        """J^T W J, without the concave rows, and J^T W r."""
        weighted = self.jacobian * self.weights[:, None]
        curved = np.delete(weighted, self.concave, axis=0)
        return curved.T @ np.delete(self.jacobian, self.concave, axis=0), weighted.T @ self.residual


def written_out(jacobian: Jacobian, layout: Layout, pixels: int) -> np.ndarray:
    """(3 P, size) float64, channel by channel within a pixel."""
    result = np.zeros((pixels, 3, layout.size))
    for block in jacobian.blocks():
        rows = result[block.pixels]
        rows[:, :, jacobian.dense_columns] = block.dense.transpose(1, 0, 2)
        rows[:, :, layout.slices["lights"]] = np.einsum(
            "cbn,ncp->bcp", block.lights.astype(float), jacobian.light_jacobian
        )
        if block.texels is not None:
            rows[:, :, layout.slices["specular"]] = (
                block.gloss[..., None] * block.texels.toarray()[:, None]
            )
    return result.reshape(-1, layout.size)


def data_rows(stage: PhotoDescent, state: State, seed: int) -> Rows:
    """Landmarks and photo; without lights that move or shadows' edges."""
    energy, layout = stage.energy, stage.energy.layout
    photo = energy.photo
    assert photo is not None
    placed = energy.term(LandmarkTerm).at(state)
    residual = placed.residuals(state)
    landmarks = Rows(
        placed.jacobian(state, layout), residual, placed.weight * placed.robust_weights(residual)
    )
    evaluation = photo.evaluate(state, seed)
    y, x = photo.index(evaluation.image.surface)
    weights = photo.weights(evaluation, photo.noise(evaluation))[y, x]
    jacobian = Jacobian(photo.forward, state, evaluation.image, layout, stage.active)
    pixels = Rows(
        written_out(jacobian, layout, len(weights)),
        evaluation.residual[y, x].ravel(),
        np.repeat(weights, 3),
    )
    return stacked([landmarks, pixels])


def prior_rows(stage: PhotoDescent, state: State, blocks: Sequence[str]) -> Rows:
    """The priors of ``blocks``."""
    layout, rows = stage.energy.layout, []
    values = layout.values(state)
    for where, gaussian in stage.energy.term(Priors).gaussians.values():
        if not any(layout.slices[name] == where for name in blocks):
            continue
        residual = gaussian.residuals(values[where])
        jacobian = np.zeros((len(residual), layout.size))
        jacobian[:, where] = gaussian.jacobian(values[where])
        concave: tuple[int, ...] = ()
        if isinstance(gaussian, LightPrior):
            concave = tuple(np.flatnonzero(gaussian.concave(values[where])).tolist())
        rows.append(Rows(jacobian, residual, np.ones(len(residual)), concave))
    return stacked(rows)


def stacked(rows: Sequence[Rows]) -> Rows:
    """All rows, one below the other."""
    return Rows(
        np.concatenate([one.jacobian for one in rows]),
        np.concatenate([one.residual for one in rows]),
        np.concatenate([one.weights for one in rows]),
        _concave(rows),
    )


def _concave(rows: Sequence[Rows]) -> tuple[int, ...]:
    first = np.cumsum([0] + [len(one.residual) for one in rows])
    return tuple(
        int(start + row) for start, one in zip(first, rows, strict=False) for row in one.concave
    )


def side_by_side(rows: Sequence[Rows], layouts: Sequence[Layout], shared: Sequence[str]) -> Rows:
    """The rows of several photos over [shared blocks | the first's own | the second's own | ...],
    blocks in order.
    """

    def width(layout: Layout, names: Sequence[str]) -> int:
        return sum(layout.slices[name].stop - layout.slices[name].start for name in names)

    own = [name for name in layouts[0].slices if name not in shared]
    names = [name for name in layouts[0].slices if name in shared]
    total = width(layouts[0], names) + sum(width(layout, own) for layout in layouts)
    result, start = [], width(layouts[0], names)
    for one, layout in zip(rows, layouts, strict=True):
        wide = np.zeros((len(one.residual), total))
        at = 0
        for name in names:
            part = one.jacobian[:, layout.slices[name]]
            wide[:, at : at + part.shape[1]] = part
            at += part.shape[1]
        for name in own:
            part = one.jacobian[:, layout.slices[name]]
            wide[:, start : start + part.shape[1]] = part
            start += part.shape[1]
        result.append(replace(one, jacobian=wide))
    return stacked(result)
