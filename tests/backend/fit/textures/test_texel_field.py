"""Fields over texels against dense least squares."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from facestage.fit.forward.shading import bilinear_weights
from facestage.fit.textures import texel_field
from facestage.fit.textures.texel_field import (
    Field,
    neighbour_laplacian,
    solve_field,
    solved_levels,
)


def direct(field: Field) -> np.ndarray:
    """The field by a direct solver, from the definition."""
    size, channels = len(field.texels), field.values.shape[1]
    chosen = np.flatnonzero(field.texels)
    numbers = np.full(size * size, -1)
    numbers[chosen] = np.arange(len(chosen))
    rows: list[int] = []
    columns: list[int] = []
    data: list[float] = []
    right: list[np.ndarray] = []
    index, share = bilinear_weights(field.uvs, size)
    for pixel in range(len(index)):
        for texel, part in zip(index[pixel], share[pixel], strict=True):
            if numbers[texel] >= 0:
                rows.append(len(right))
                columns.append(numbers[texel])
                data.append(np.sqrt(field.weight[pixel]) * part)
        right.append(np.sqrt(field.weight[pixel]) * field.values[pixel])
    for row, column in np.argwhere(field.texels):
        for other in ((row, column + 1), (row + 1, column)):
            if max(other) < size and field.texels[other]:
                rows += [len(right)] * 2
                columns += [numbers[row * size + column], numbers[other[0] * size + other[1]]]
                data += [np.sqrt(field.smoothness), -np.sqrt(field.smoothness)]
                right.append(np.zeros(channels))
        extra = [(field.shrinkage, np.zeros(channels))]
        if field.guess is not None and field.guess_weight is not None:
            extra.append((field.guess_weight[row, column], field.guess[row, column]))
        for weight, wanted in extra:
            rows.append(len(right))
            columns.append(numbers[row * size + column])
            data.append(np.sqrt(weight))
            right.append(np.sqrt(weight) * wanted)
    operator = sp.csr_matrix((data, (rows, columns)), shape=(len(right), len(chosen)))
    result = np.zeros((size * size, channels))
    result[chosen] = spsolve((operator.T @ operator).tocsc(), operator.T @ np.array(right)).reshape(
        -1, channels
    )
    return result.reshape(size, size, channels)


def example(size: int, guess: bool) -> Field:
    random = np.random.default_rng(2)
    texels = np.ones((size, size), bool)
    texels[:, size // 2 : size // 2 + 2] = False
    texels[: size // 4, : size // 4] = False
    uvs = random.uniform([0.05, 0.1], [0.6, 0.9], (400, 2))
    values = np.stack([np.sin(7 * uvs[:, 0]), uvs[:, 1] - 0.5], axis=1) + 0.1 * random.normal(
        size=(400, 2)
    )
    return Field(
        texels,
        uvs,
        random.uniform(0, 1, 400),
        values,
        0.08,
        0.02 * (24 / size) ** 2,
        0.1 * random.uniform(size=(size, size)) if guess else None,
        random.normal(size=(size, size, 2)) if guess else None,
    )


@pytest.mark.parametrize(
    ("size", "guess", "allowed"), [(24, False, 0.02), (24, True, 0.02), (128, False, 0.06)]
)
def test_fields_are_the_least_squares_solution(size: int, guess: bool, allowed: float):
    field = example(size, guess)
    found, known = solve_field(field)
    wanted = direct(field)
    error = np.abs(found - wanted).max() / np.abs(wanted).max()
    print(f"{size} texels: off by {error:.1e} of the largest value, {allowed} allowed")
    assert error < allowed
    assert known.min() >= 0 and known.max() <= 1 and not found[~field.texels].any()
    if not guess:
        assert (
            known[int(0.5 * size), int(0.3 * size)] > 0.7
            and known[int(0.5 * size), int(0.95 * size)] < 0.05
        )


def test_nothing_observed_is_nothing_found():
    field = example(64, guess=False)
    nothing = Field(field.texels, field.uvs, np.zeros(400), field.values, 0.08, 0.02)
    found, known = solve_field(nothing)
    assert not found.any() and not known.any()


def test_a_constant_is_free_of_ties():
    index = np.arange(12).reshape(3, 4)
    index[1, 1] = -1
    laplacian = neighbour_laplacian(np.where(index > 5, index - 1, index), 11)
    np.testing.assert_allclose(laplacian @ np.ones(11), 0, atol=1e-6)
    assert (laplacian - laplacian.T).nnz == 0


def test_tiles_find_what_the_whole_texture_does(monkeypatch: pytest.MonkeyPatch):
    """No step of the solver goes farther than a tile's border is wide."""
    field = example(256, guess=True)
    whole, known = solve_field(field)
    monkeypatch.setattr(texel_field, "TILE", 64)
    tiled, known_too = solve_field(field)
    for one, other, what in ((whole, tiled, "values"), (known, known_too, "shares")):
        error = np.sqrt(np.mean((one - other) ** 2) / np.mean(one**2))
        print(f"tiles change {what} by {error:.1e} of their root mean square, 5e-3 allowed")
        assert error < 5e-3


def test_levels_end_with_the_field_s_own():
    field = example(128, guess=False)
    levels = list(solved_levels(field))
    assert [len(found) for found, _ in levels] == [64, 128]
    np.testing.assert_array_equal(levels[-1][0], solve_field(field)[0])
    np.testing.assert_array_equal(levels[0][0], solve_field(field.halved())[0])
