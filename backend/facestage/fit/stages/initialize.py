"""Where a fit starts: the head pose from landmarks in closed form, light by non-negative least
squares.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from facestage.contract.arrays import Float
from facestage.contract.camera import Camera
from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.solve.cholesky import with_ridge
from facestage.models.anatomy.landmark_schemes import scheme_of


def scaled_orthographic_pose(
    points: np.ndarray, pixels: np.ndarray, camera: Camera, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and translation (3,) placing model ``points`` (m, 3) at ``pixels`` (m, 2).

    Weak perspective: a linear least-squares fit of two rows of a scaled rotation (DeMenthon & Davis
    1995), then the nearest rotation.
    """
    total = weights.sum()
    centre3, centre2 = weights @ points / total, weights @ pixels / total
    a = (points - centre3) * weights[:, None]
    image = (
        np.stack([pixels[:, 0] - centre2[0], -(pixels[:, 1] - centre2[1])], axis=1)
        * weights[:, None]
    )
    # A little ridge: coplanar points leave the third column open.
    rows = np.linalg.solve(a.T @ a + 1e-6 * np.trace(a.T @ a) * np.eye(3), a.T @ image).T
    scale = max(0.5 * float(np.linalg.norm(rows[0]) + np.linalg.norm(rows[1])), 1e-6)
    u, _, vt = np.linalg.svd(rows / scale, full_matrices=False)
    two = u @ vt
    rotation = np.vstack([two, np.cross(two[0], two[1])])
    depth = camera.focal_px / scale
    ray = np.array(
        [
            (centre2[0] - camera.principal_px[0]) / camera.focal_px,
            -(centre2[1] - camera.principal_px[1]) / camera.focal_px,
            -1.0,
        ]
    )
    return rotation, depth * ray - rotation @ centre3


def initial_pose(
    geometry: FaceGeometry, landmarks: Landmarks, camera: Camera
) -> tuple[np.ndarray, np.ndarray]:
    """Pose of the mean face; points that fit the first guess badly are taken out and it is done
    again.
    """
    vertices, barycentric = geometry.model.landmark_vertices(landmarks.scheme)
    points = np.einsum("mi,mix->mx", barycentric, geometry.model.vertices[vertices]).astype(float)
    pixels = np.nan_to_num(landmarks.points)
    usable = np.isfinite(landmarks.points).all(1)
    if landmarks.weights is not None:
        usable &= landmarks.weights > 0
    scheme = scheme_of(landmarks.scheme)
    sure = np.where(landmarks.visible, 1.0, 0.1) * usable / scheme.deviation**2
    sure[scheme.behind_closed_lids(landmarks.points)] = 0.0
    weights = sure
    for _ in range(10):
        rotation, translation = scaled_orthographic_pose(points, pixels, camera, weights)
        distance = np.linalg.norm(
            camera.project(points @ rotation.T + translation) - pixels, axis=1
        )
        scale = max(float(np.median(distance[usable])), 1.0)
        weights = sure / (1 + (distance / (2 * scale)) ** 2)
    return rotation, translation


# Share of the largest eigenvalue added to the light system: neighbouring lights look alike on a
# face.
LIGHT_RIDGE = 1e-3
ROBUST_ROUNDS = 5
DARK_SHARE = 0.02  # of the brightest skin, below which no pixel tells the exposure


def initial_lights(
    evaluation: Evaluation, photo: PhotoTerm, lights: LightParameters, ridge: float = LIGHT_RIDGE
) -> np.ndarray:
    """Radiance (N, 3) of all lights that best explains the photo on the current geometry and
    albedo.

    The image is linear in the lights, so this is a non-negative least-squares problem per channel;
    lights that are not fitted keep their radiance. Residuals are absolute: bright pixels say where
    the light is; relative residuals would let black explain a half-lit face. Huber weights calm
    highlights. A clipped pixel counts while the model is darker than it: it says "at least this
    bright".
    """
    image = evaluation.image
    y, x = photo.index(image.surface)
    weights, target, clipped = (
        evaluation.base_weight[y, x],
        photo.photo.color[y, x],
        photo.photo.clipped[y, x],
    )
    result = lights.fixed_radiance.copy()
    terms = image.terms
    shown = image.skin.by_light(
        terms.diffuse, terms.specular, indirect=terms.indirect, scattered=image.scattered
    )
    for channel, columns in enumerate(shown):
        wanted = target[:, channel] - columns @ lights.fixed_radiance[:, channel]
        result[lights.fitted, channel] = _robust_nnls(
            columns[:, lights.fitted], wanted, weights, clipped[:, channel], ridge
        )
    # A fit that starts in the dark has no gradient to leave it.
    level = max(float(result[lights.fitted].mean()), 1e-6)
    result[lights.fitted] = np.maximum(result[lights.fitted], 1e-3 * level)
    return result


def exposure(
    photo: PhotoTerm, evaluation: Evaluation, radiance: Float[np.ndarray, "lights 3"]
) -> float:
    """By what lights of this ``radiance`` must be brighter for mean skin to be as bright as the
    photo's: the median over the pixels that count. 1 where nothing can be compared.
    """
    image = evaluation.image
    y, x = photo.index(image.surface)
    lit = photo.forward.shade(evaluation.state, image.surface, image.terms, radiance=radiance)
    shown, seen = lit.color.mean(axis=1), photo.photo.color[y, x].mean(axis=1)
    counted = evaluation.counted[y, x] & ~photo.photo.clipped[y, x].any(axis=1)
    counted &= shown > DARK_SHARE * max(float(shown.max(initial=0.0)), 1e-30)
    found = float(np.median(seen[counted] / shown[counted])) if counted.any() else 0.0
    return found if found > 0 else 1.0


def ridged_nnls(
    columns: Float[np.ndarray, "pixels lights"],
    target: Float[np.ndarray, " pixels"],
    weights: Float[np.ndarray, " pixels"],
    ridge: float = LIGHT_RIDGE,
) -> Float[np.ndarray, " lights"]:
    """The non-negative radiance of least squared ``weights`` * residuals, with a ``ridge``, which
    is the share of the largest eigenvalue that all get more.
    """
    weighted = columns * weights[:, None]
    factor = np.linalg.cholesky(with_ridge(weighted.T @ columns, ridge))
    found, _ = nnls(factor.T, np.linalg.solve(factor, weighted.T @ target))
    return np.asarray(found)


def _robust_nnls(
    columns: np.ndarray, target: np.ndarray, weights: np.ndarray, clipped: np.ndarray, ridge: float
) -> np.ndarray:
    robust = np.ones_like(weights)
    radiance = np.zeros(columns.shape[1])
    for _ in range(ROBUST_ROUNDS):
        usable = weights * (~clipped | (columns @ radiance < target))
        if not usable.any():
            break
        radiance = ridged_nnls(columns, target, usable * robust, ridge)
        residual = np.abs(columns @ radiance - target)
        scale = 1.5 * max(float(residual[usable > 0].mean()) if (usable > 0).any() else 1.0, 1e-9)
        robust = np.minimum(1.0, scale / np.maximum(residual, 1e-12))
    return radiance
