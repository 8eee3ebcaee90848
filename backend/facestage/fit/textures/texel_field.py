"""A smooth field over a texture's texels that explains what pixels say: least squares, coarse to
fine.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Bool, Float, Float32, Float64, Int
from facestage.fit.forward.shading import bilinear_weights, sample_bilinear
from facestage.system.cores import cores

COARSEST = 64
TOLERANCE = 2e-3
STEPS_COARSE, STEPS_FINE = 60, 10
# Texels along the side of a tile, and around it; more than a step goes in all.
TILE, HALO = 512, 12
TILES_AT_ONCE = 4  # at most: each takes memory
# Share of the answer that is known, on the level before, below which a texel is not solved for
# again.
NEGLIGIBLE = 0.005


@dataclass(frozen=True)
class Field:
    """What is sought: values of ``texels``, from pixels, tied together and to zero.

    Minimises, channel by channel, sum_p w_p (x(uv_p) - y_p)^2 + sum_t W_t (x_t - Y_t)^2
    + smoothness sum |x_t - x_neighbour|^2 + shrinkage sum x_t^2.
    """

    texels: Bool[np.ndarray, "size size"]
    uvs: Float[np.ndarray, "pixels 2"]
    weight: Float[np.ndarray, " pixels"]  # inverse variances, at least 0
    values: Float[np.ndarray, "pixels channels"]
    smoothness: float
    shrinkage: float  # per texel; on a level of half the size four times as much
    # W, what other texels say of this one; None: nothing
    guess_weight: Float[np.ndarray, "size size"] | None = None
    guess: Float[np.ndarray, "size size channels"] | None = None  # Y

    def halved(self) -> Field:
        """The same on a texture of half the size."""
        if self.guess_weight is None or self.guess is None:
            weight, guess = None, None
        else:
            weight = _quads(self.guess_weight[..., None])[..., 0]
            guess = (
                _quads(self.guess * self.guess_weight[..., None])
                / np.maximum(weight, 1e-12)[..., None]
            )
        return replace(
            self,
            texels=halved(self.texels),
            shrinkage=4 * self.shrinkage,
            guess_weight=weight,
            guess=guess,
        )


def solve_field(
    field: Field,
) -> tuple[Float32[np.ndarray, "size size channels"], Float32[np.ndarray, "size size"]]:
    """The field, and 0..1 how much of it is known: its value where all
    observations are 1. Zero outside the texels.
    """
    return deque(solved_levels(field), maxlen=1).pop()


def solved_levels(
    field: Field,
) -> Iterator[tuple[Float32[np.ndarray, "side side channels"], Float32[np.ndarray, "side side"]]]:
    """The same on textures of ever finer texels, the last of the field's own.

    Each level starts from the one of half its size, so that few steps are left to do; in so few
    steps no texel hears of those beyond HALO, so a large texture is solved tile by tile, with so
    many texels of its neighbours around each.
    """
    used = np.flatnonzero(field.weight > 0)
    if not field.texels.any() or not len(used):
        shape = (*field.texels.shape, field.values.shape[1])
        yield np.zeros(shape, np.float32), np.zeros(field.texels.shape, np.float32)
        return
    used = used[np.argsort(field.uvs[used, 1], kind="stable")]
    observed = np.concatenate([field.values[used], np.ones((len(used), 1))], axis=1)
    guess = field.guess
    if guess is not None:
        guess = np.dstack([guess, np.ones(guess.shape[:2])]).astype(np.float32)
    levels = [
        replace(
            field,
            uvs=np.clip(field.uvs[used], 0.0, 1.0),  # beyond the texture its edge is looked up
            weight=field.weight[used].astype(np.float32),
            values=observed.astype(np.float32),
            guess=guess,
        )
    ]
    while len(levels[-1].texels) > COARSEST and len(levels[-1].texels) % 2 == 0:
        levels.append(levels[-1].halved())
    found = None
    while levels:
        found = _solved(levels.pop(), found)
        yield found[..., :-1], np.clip(found[..., -1], 0, 1)


def _solved(
    field: Field, coarse: Float32[np.ndarray, "half half columns"] | None
) -> Float32[np.ndarray, "size size columns"]:
    """Of a field whose pixels are ordered by v, with the ones among its values, begun at the
    ``coarse`` one of half the size.
    """
    size, columns = len(field.texels), field.values.shape[1]
    result = np.zeros((size, size, columns), np.float32)
    if coarse is None:
        whole = slice(0, size)
        return _tile(field, whole, whole, result, field.texels, STEPS_COARSE)

    def solve(top: int, left: int) -> None:
        inner = tuple(slice(TILE * at, min(TILE * (at + 1), size)) for at in (top, left))
        rows, across = (
            slice(max(each.start - HALO, 0), min(each.stop + HALO, size)) for each in inner
        )
        start = doubled(
            coarse[rows.start // 2 : rows.stop // 2, across.start // 2 : across.stop // 2]
        )
        texels = field.texels[rows, across]
        start[~texels] = 0.0
        wanted = texels & (start[..., -1] > NEGLIGIBLE)
        within = tuple(
            slice(own.start - wide.start, own.stop - wide.start)
            for own, wide in zip(inner, (rows, across), strict=True)
        )
        if wanted[within].any():
            start = _tile(field, rows, across, start, wanted, STEPS_FINE)
        result[inner] = start[within]

    # Each tile alone writes its own part; what takes time in it leaves Python's lock to others.
    tiles = list(np.ndindex(-(-size // TILE), -(-size // TILE)))
    with ThreadPoolExecutor(min(cores(), TILES_AT_ONCE)) as pool:
        deque(pool.map(solve, *zip(*tiles, strict=True)), maxlen=0)
    return result


def _tile(
    field: Field,
    rows: slice,
    columns: slice,
    start: Float32[np.ndarray, "height width values"],
    wanted: Bool[np.ndarray, "height width"],
    steps: int,
) -> Float32[np.ndarray, "height width values"]:
    """The solution for the ``wanted`` texels of a part of the texture, alone; all others stay as
    they are at the ``start``.
    """
    texels = np.flatnonzero(wanted)
    numbers = np.full(wanted.size, -1, np.int32)
    numbers[texels] = np.arange(len(texels))
    numbers = numbers.reshape(wanted.shape)
    system, right = _normal_equations(field, rows, columns, numbers, len(texels))
    found = start.reshape(wanted.size, -1)
    found[texels] = conjugate_gradients(system, right, found[texels], TOLERANCE, steps)
    return found.reshape(start.shape)


def _normal_equations(
    field: Field, rows: slice, columns: slice, numbers: Int[np.ndarray, "height width"], count: int
) -> tuple[sp.csr_matrix, Float32[np.ndarray, "texels columns"]]:
    """System and right sides for the ``count`` texels that have ``numbers``, in this part of the
    texture.
    """
    size = len(field.texels)
    # Rows run against v, by which the pixels are ordered; one texel more for what lies between.
    bounds = [1 - (rows.stop + 1) / size, 1 - (rows.start - 1) / size]
    first, last = np.searchsorted(field.uvs[:, 1], bounds)
    near = first + np.flatnonzero(
        np.abs(field.uvs[first:last, 0] * size - 0.5 * (columns.start + columns.stop))
        <= 0.5 * (columns.stop - columns.start) + 1
    )
    index, share = bilinear_weights(field.uvs[near], size)
    row, column = index // size - rows.start, index % size - columns.start
    height, width = numbers.shape
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    pick = _picked(np.where(inside, row * width + column, 0), share * inside, numbers, count)
    weight = field.weight[near]
    weighted = sp.csr_matrix(
        (pick.data * np.repeat(weight, 4), pick.indices, pick.indptr), shape=pick.shape
    )
    diagonal = np.full(count, field.shrinkage, np.float32)
    right = weighted.T @ field.values[near]
    if field.guess_weight is not None and field.guess is not None:
        chosen = numbers >= 0
        guess_weight = field.guess_weight[rows, columns][chosen].astype(np.float32)
        diagonal += guess_weight
        right += guess_weight[:, None] * field.guess[rows, columns][chosen]
    system = pick.T @ weighted + field.smoothness * neighbour_laplacian(numbers, count)
    return (system + sp.diags(diagonal)).tocsr(), right


def texel_rows(
    uvs: Float[np.ndarray, "pixels 2"], numbers: Int[np.ndarray, " texels"], count: int
) -> sp.csr_matrix:
    """Bilinear lookups (pixels, texels) at ``uvs`` in a square texture; ``numbers`` of its
    texels, -1: none.
    """
    return _picked(*bilinear_weights(uvs, int(np.sqrt(len(numbers)))), numbers, count)


def _picked(
    index: Int[np.ndarray, "pixels 4"],
    share: Float[np.ndarray, "pixels 4"],
    numbers: Int[np.ndarray, " ..."],
    count: int,
) -> sp.csr_matrix:
    """The mean of four texels each, of those that have ``numbers``."""
    index = numbers.ravel()[index]
    share = np.where(index >= 0, share, 0.0).astype(np.float32)
    rows = np.arange(0, 4 * len(index) + 1, 4)
    return sp.csr_matrix(
        (share.ravel(), np.maximum(index, 0).ravel(), rows), shape=(len(index), count)
    )


def halved(mask: Bool[np.ndarray, "size size"]) -> Bool[np.ndarray, "half half"]:
    """True where any of two by two texels is."""
    half: Bool[np.ndarray, "half half"] = (
        mask[::2, ::2] | mask[::2, 1::2] | mask[1::2, ::2] | mask[1::2, 1::2]
    )
    return half


def resampled(texture: Float[np.ndarray, "_ _"], size: int) -> Float[np.ndarray, "_ _"]:
    """A square map looked up at the centres of ``size`` texels along a side."""
    centre = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(centre, 1 - centre)
    return sample_bilinear(texture, np.stack([u.ravel(), v.ravel()], axis=1)).reshape(size, size)


def neighbour_laplacian(index: Int[np.ndarray, "height width"], count: int) -> sp.csr_matrix:
    """Graph Laplacian of four neighbours each; ``index`` numbers the n
    texels, -1: none.
    """
    rows, columns = [], []
    for a, b in ((index[:, :-1], index[:, 1:]), (index[:-1], index[1:])):
        both = (a >= 0) & (b >= 0)
        rows += [a[both], b[both]]
        columns += [b[both], a[both]]
    row, column = np.concatenate(rows), np.concatenate(columns)
    links = sp.csr_matrix((np.ones(len(row), np.float32), (row, column)), shape=(count, count))
    return sp.diags(np.asarray(links.sum(axis=1)).ravel().astype(np.float32)) - links


def conjugate_gradients(
    system: sp.csr_matrix,
    right: Float32[np.ndarray, "unknowns columns"],
    start: Float[np.ndarray, "unknowns columns"],
    tolerance: float,
    steps: int,
) -> Float32[np.ndarray, "unknowns columns"]:
    """Solutions of ``system`` x = ``right``, all columns in step;
    Jacobi-preconditioned.

    Ends when every column's residual is ``tolerance`` of its right side (in the preconditioner's
    norm), or after ``steps``.
    """
    scale = (1.0 / system.diagonal())[:, None].astype(np.float32)
    x = start.astype(np.float32)
    residual = (right - system @ x).astype(np.float32)
    goal = tolerance**2 * _dots(right, scale * right)
    direction = scale * residual
    energy = _dots(residual, direction)
    for _ in range(steps):
        if (energy <= goal).all():
            break
        image = system @ direction
        length = (energy / np.maximum(_dots(direction, image), 1e-30)).astype(np.float32)
        x += length * direction
        residual -= length * image
        step = scale * residual
        before, energy = energy, _dots(residual, step)
        direction *= (energy / np.maximum(before, 1e-30)).astype(np.float32)
        direction += step
    return x


def _dots(
    a: Float[np.ndarray, "unknowns columns"], b: Float[np.ndarray, "unknowns columns"]
) -> Float64[np.ndarray, " columns"]:
    """Products of the columns."""
    # A small matrix product: many times faster than sums along the long axis.
    return np.diagonal(a.T @ b).astype(np.float64)


def _quads(
    texture: Float[np.ndarray, "size size channels"],
) -> Float[np.ndarray, "half half channels"]:
    """Sums of two by two texels."""
    half = len(texture) // 2
    return texture.reshape(half, 2, half, 2, -1).sum(axis=(1, 3))


def doubled(texture: Float[np.ndarray, "_ _ channels"]) -> Float[np.ndarray, "_ _ channels"]:
    """Each texel four times."""
    return np.repeat(np.repeat(texture, 2, axis=0), 2, axis=1)
