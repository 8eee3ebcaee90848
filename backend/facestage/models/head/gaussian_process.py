"""Smooth residual identity modes: the leading eigenfunctions of a Gaussian process on the face.

Luethi et al. 2018, "Gaussian Process Morphable Models": a displacement field with a smooth kernel,
reduced to its leading eigenfunctions with the Nystroem method. The kernel is symmetrised so that
each function is even or odd.
"""

from __future__ import annotations

import numpy as np

from facestage.models.head.masks import Masks, smoothstep

_SCALES = ((38.0, 2.1), (20.0, 1.0), (12.0, 0.45))  # correlation length and standard deviation, mm
_ASYMMETRIC_SHARE = 0.35  # standard deviation of asymmetric relative to symmetric variation
_NAMES = ("breadth", "height", "depth")
# sliding along the surface changes a shape less than moving across it
_AXIS_SHARE = (0.75, 0.75, 1.0)


def smooth_modes(masks: Masks, points: np.ndarray, count: int) -> dict[str, np.ndarray]:
    """The `count` strongest modes at points (m, 3) in mm: (m, 3) mm per standard deviation, named
    by direction.
    """
    samples = _samples(masks)
    found: list[tuple[float, str, int, np.ndarray]] = []
    among, to_samples = _kernels(samples, samples), _kernels(points, samples)
    for even, within, across in zip((True, False), among, to_samples, strict=True):
        values, vectors = np.linalg.eigh(within / len(samples))
        values, vectors = values[::-1][:count], vectors[:, ::-1][:, :count]
        vectors = vectors * np.sign(vectors[np.abs(vectors).argmax(axis=0), np.arange(count)])
        # Nystroem: eigenfunctions, scaled to the standard deviation of their coefficients.
        functions = across @ (vectors / np.sqrt(values * len(samples)))
        for axis in range(3):
            # Mirroring a face flips breadth: it is symmetric when its field is odd.
            symmetric = even == (axis != 0)
            name = _NAMES[axis] if symmetric else f"asymmetry_{_NAMES[axis]}"
            share = _AXIS_SHARE[axis] * (1.0 if symmetric else _ASYMMETRIC_SHARE)
            found += [
                (value * share**2, name, axis, share * f)
                for value, f in zip(values, functions.T, strict=True)
            ]
    found.sort(key=lambda entry: -entry[0])
    modes: dict[str, np.ndarray] = {}
    for _, name, axis, function in found[:count]:
        number = 1 + sum(known.startswith(f"smooth_{name}_") for known in modes)
        mode = np.zeros((len(points), 3))
        mode[:, axis] = function
        modes[f"smooth_{name}_{number:02d}"] = mode
    return modes


def _samples(masks: Masks) -> np.ndarray:
    """Points of the left half of the face, thinned."""
    index = np.unique(masks.mesh.grid[masks.mesh.grid >= 0])
    points = masks.points[index]
    points = points[(points[:, 0] > -1e-9) & (_window(points) > 0.02)]
    lids = masks.points[masks.mesh.loops["eye_left"][1:8:2]].reshape(-1, 3)[::2]
    lips = masks.points[masks.mesh.loops["mouth"][1:11:2]].reshape(-1, 3)[::2]
    return np.concatenate([points[::2], lids, lips[lips[:, 0] > -1e-9]])


def _window(points: np.ndarray) -> np.ndarray:
    """1 on the face, falling to 0 on the neck, the top and the back of the head."""
    y, z = points[:, 1], points[:, 2]
    return smoothstep((z + 5) / 55) * smoothstep((y + 150) / 40) * smoothstep((110 - y) / 70)


def _kernels(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(m, k) covariances in mm^2 of the even and of the odd part of the process."""
    window = _window(a)
    inside = window > 0  # elsewhere nothing varies
    even, odd = np.zeros((2, int(inside.sum()), len(b)))
    near = _squared_distance(a[inside], b)
    far = _squared_distance(a[inside], b * [-1, 1, 1])
    for length, sd in _SCALES:
        scale = -0.5 / length**2
        same, other = np.exp(near * scale), np.exp(far * scale)
        even += 0.5 * sd**2 * (same + other)
        odd += 0.5 * sd**2 * (same - other)
    result = np.zeros((2, len(a), len(b)))
    for whole, part in zip(result, (even, odd), strict=True):
        whole[inside] = part * window[inside, None] * _window(b)[None]
    return result[0], result[1]


def _squared_distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.maximum((a**2).sum(1)[:, None] + (b**2).sum(1)[None] - 2 * a @ b.T, 0.0)
