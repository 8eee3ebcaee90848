"""How far MediaPipe's landmarks are off, each for itself and together, from what
derive_landmarks.py measured.

python tools/landmark_scatter.py face_landmarker.task RESIDUALS.npz... --out mediapipe478.npz
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from landmark_pictures import canonical_mesh, mirror_order

from facestage.contract.files.storage import read_arrays, write_arrays

# Cosines of normal and view above which a point shows well, and at least shows.
WELL, BARELY = 0.4, -0.1
COUNT_MIN = 30
# Median of a Rayleigh distribution over its standard deviation per axis.
RAYLEIGH_MEDIAN = 1.1774
# The distance of the outer eye corners over the face's size (jaw and brows), and a sharp point's
# deviation in shares of the latter, which is the unit of what is written.
EYE_CORNERS_PER_FACE, SHARP = 0.62, 0.0085
CLIP = 3.0  # standard deviations, so that a few wild detections do not make the correlation


def main() -> None:
    """Average the given files and write the result."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bundle", type=Path, help="face_landmarker.task")
    parser.add_argument("residuals", type=Path, nargs="+", help="one file of each model")
    parser.add_argument("--out", type=Path, required=True, help="the .npz to write")
    options = parser.parse_args()
    mirror = mirror_order(canonical_mesh(options.bundle))
    logs, squares = [], []
    for path in options.residuals:
        arrays = read_arrays(path, "residuals")
        residual, cosine = arrays["residual"].astype(float), arrays["cosine"]
        deviation = deviations(residual, cosine)
        shows = cosine > WELL
        left = without_pose(residual, shows, deviation, arrays["positions"])
        squared = squared_correlation(left, shows, deviations(left, cosine))
        print(
            f"{path.name}: deviation {100 * np.median(deviation):.2f} % (median), "
            f"{1 / squared:.0f} independent points"
        )
        logs.append(np.log(deviation))
        squares.append(squared)
    mean = np.mean(logs, axis=0)
    deviation = np.exp(0.5 * (mean + mean[mirror])) * EYE_CORNERS_PER_FACE / SHARP
    independent = 1.0 / float(np.mean(squares))
    write_arrays(options.out, {"deviation": deviation, "independent": np.array(independent)})


def deviations(residual: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """(478,) robust standard deviation per axis, in shares of the distance of the outer eye
    corners.
    """
    distance = np.linalg.norm(residual, axis=-1)
    result = np.empty(distance.shape[1])
    for point, (lengths, faces) in enumerate(zip(distance.T, cosine.T, strict=True)):
        shows = faces > (WELL if (faces > WELL).sum() >= COUNT_MIN else BARELY)
        result[point] = np.median(lengths[shows]) / RAYLEIGH_MEDIAN
    return result


def without_pose(
    residual: np.ndarray, shows: np.ndarray, deviation: np.ndarray, positions: np.ndarray
) -> np.ndarray:
    """(N, 478, 2) what an affine motion of each picture leaves: a fit gives the rest to the pose,
    not to the shape.
    """
    design = np.column_stack(
        [np.ones(len(positions)), positions[:, :2] / np.abs(positions[:, :2]).max()]
    )
    result = np.empty_like(residual)
    for left, picture, seen in zip(result, residual, shows, strict=True):
        weight = (seen / deviation)[:, None]
        left[:] = (
            picture - design @ np.linalg.lstsq(design * weight, picture * weight, rcond=None)[0]
        )
    return result


def squared_correlation(residual: np.ndarray, shows: np.ndarray, deviation: np.ndarray) -> float:
    """Mean squared correlation of all pairs of points: one over how many independent points there
    are.

    That is (tr C)^2 / tr C^2 of the correlation matrix C (Bretherton et al. 1999, "The Effective
    Number of Spatial Degrees of Freedom of a Time-Varying Field"), less what chance adds to a
    square: a picture and its mirror image count as one observation of two coordinates.
    """
    use = shows.sum(axis=0) >= COUNT_MIN
    residual, shows, deviation = residual[:, use], shows[:, use], deviation[use]
    relative = np.where(shows[..., None], np.clip(residual / deviation[:, None], -CLIP, CLIP), 0.0)
    count = shows.T.astype(float) @ shows
    covariance = np.einsum("nix,njx->ij", relative, relative) / np.maximum(2 * count, 1)
    scale = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(scale, scale)
    pairs = (count >= COUNT_MIN) & ~np.eye(len(scale), dtype=bool)
    squares = correlation[pairs] ** 2
    chance = (1 - squares) ** 2 / count[pairs]
    m = len(scale)
    return (1.0 + (m - 1) * max(float((squares - chance).mean()), 0.0)) / m


if __name__ == "__main__":
    main()
