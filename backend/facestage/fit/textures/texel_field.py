"""A smooth field over a texture's texels that explains what pixels say: least squares, coarse to
fine.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Bool, Float, Float32, Float64, Int
from facestage.fit.forward.shading import bilinear_weights, sample_bilinear

COARSEST = 64
TOLERANCE = 2e-3
STEPS_COARSE, STEPS_FINE = 60, 10
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
) -> tuple[Float[np.ndarray, "size size channels"], Float[np.ndarray, "size size"]]:
    """The field, and 0..1 how much of it is known: its value where all
    observations are 1.

    Zero outside the texels. Each level starts from the one of half its size, so that few steps are
    left to do.
    """
    size = field.texels.shape[0]
    channels = field.values.shape[1]
    if not field.texels.any() or not (field.weight > 0).any():
        return np.zeros((size, size, channels), np.float32), np.zeros((size, size), np.float32)
    if size > COARSEST and size % 2 == 0:
        known_and_values = doubled(np.dstack(solve_field(field.halved())))
        wanted = field.texels & (known_and_values[..., -1] > NEGLIGIBLE)
        known_and_values[~field.texels] = 0.0
        start, steps = known_and_values, STEPS_FINE
    else:
        wanted, steps = field.texels, STEPS_COARSE
        start = np.zeros((size, size, channels + 1), np.float32)
    found = start.reshape(size * size, -1)
    if wanted.any():
        texels = np.flatnonzero(wanted)
        system, right = _normal_equations(field, wanted, texels)
        found[texels] = conjugate_gradients(system, right, found[texels], TOLERANCE, steps)
    found = found.reshape(size, size, -1)
    return found[..., :-1], np.clip(found[..., -1], 0, 1)


def _normal_equations(
    field: Field, wanted: Bool[np.ndarray, "size size"], texels: Int[np.ndarray, " texels"]
) -> tuple[sp.csr_matrix, Float32[np.ndarray, "texels columns"]]:
    """System and right sides for the ``texels``, the last for observations that
    are all 1.
    """
    size = len(wanted)
    compact = np.full(size * size, -1, np.int32)
    compact[texels] = np.arange(len(texels))
    used = field.weight > 0
    pick = texel_rows(field.uvs[used], compact, len(texels))
    weight = field.weight[used].astype(np.float32)
    weighted = sp.csr_matrix(
        (pick.data * np.repeat(weight, 4), pick.indices, pick.indptr), shape=pick.shape
    )
    observed = np.concatenate([field.values[used], np.ones((pick.shape[0], 1))], axis=1).astype(
        np.float32
    )
    diagonal = np.full(len(texels), field.shrinkage, np.float32)
    right = weighted.T @ observed
    if field.guess_weight is not None and field.guess is not None:
        guess_weight = field.guess_weight.reshape(-1)[texels].astype(np.float32)
        diagonal += guess_weight
        guess = field.guess.reshape(size * size, -1)[texels]
        right += guess_weight[:, None] * np.concatenate(
            [guess, np.ones((len(texels), 1))], axis=1
        ).astype(np.float32)
    system = pick.T @ weighted
    del pick, weighted, observed  # of large photos each is as large as the system
    laplacian = neighbour_laplacian(compact.reshape(size, size), len(texels))
    system = system + field.smoothness * laplacian
    del laplacian
    return (system + sp.diags(diagonal)).tocsr(), right


def texel_rows(
    uvs: Float[np.ndarray, "pixels 2"], numbers: Int[np.ndarray, " texels"], count: int
) -> sp.csr_matrix:
    """Bilinear lookups (pixels, texels) at ``uvs`` in a square texture; ``numbers`` of its
    texels, -1: none.
    """
    index, share = bilinear_weights(uvs, int(np.sqrt(len(numbers))))
    index = numbers[index]
    share = np.where(index >= 0, share, 0.0).astype(np.float32)
    rows = np.arange(0, 4 * len(index) + 1, 4)
    return sp.csr_matrix(
        (share.ravel(), np.maximum(index, 0).ravel(), rows), shape=(len(index), count)
    )


def halved(mask: Bool[np.ndarray, "size size"]) -> Bool[np.ndarray, "half half"]:
    """True where any of two by two texels is."""
    return _quads(mask[..., None].astype(np.float32))[..., 0] > 0


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


def doubled(
    texture: Float[np.ndarray, "size size channels"],
) -> Float[np.ndarray, "wide wide channels"]:
    """Each texel four times."""
    return np.repeat(np.repeat(texture, 2, axis=0), 2, axis=1)
