"""The landmark stage in numpy: the pose and the sliders under which points of a face show where
they were put. No bpy.

Minimised is half the sum of squares of (points - where they were put) / deviation, with a Cauchy
loss on what is not pinned, and of (sliders - their rest) / deviation, by Levenberg-Marquardt steps
within the sliders' bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.arrays import Bool, Float
from facestage.contract.camera import Camera

CAUCHY_SCALE = 3.0  # standard deviations, as in the backend
STEPS, TRIALS = 40, 6
SETTLED = 1e-6  # of the energy, below which a step gains nothing
DAMPING = 1e-6
BOUND_ROUNDS = 6


@dataclass(frozen=True)
class Shapes:
    """m points of a mesh in its own coordinates, and how k sliders move them."""

    rest: Float[np.ndarray, "points 3"]
    modes: Float[np.ndarray, "points 3 sliders"]
    spread: Float[np.ndarray, " sliders"]  # standard deviation of each slider
    low: Float[np.ndarray, " sliders"]
    high: Float[np.ndarray, " sliders"]

    def at(self, sliders: Float[np.ndarray, " sliders"]) -> Float[np.ndarray, "points 3"]:
        """Where the points are."""
        return self.rest + self.modes @ sliders


@dataclass(frozen=True)
class Sight:
    """Where the m points are to be seen.

    ``deviation`` in pixels, infinite for what says nothing; ``share`` of an independent observation
    that each is; ``sure``: put there by hand, however far that is.
    """

    camera: Camera
    pixels: Float[np.ndarray, "points 2"]
    deviation: Float[np.ndarray, " points"]
    share: Float[np.ndarray, " points"]
    sure: Bool[np.ndarray, " points"]


@dataclass(frozen=True)
class Guess:
    """A pose of the mesh, from its own coordinates to the camera's (4, 4), and its sliders."""

    to_camera: Float[np.ndarray, "4 4"]
    sliders: Float[np.ndarray, " sliders"]

    def turned(self, step: Float[np.ndarray, " unknowns"], centre: np.ndarray) -> Guess:
        """After a rotation vector about ``centre`` (3,), metres, and changes of the sliders."""
        motion = np.eye(4)
        motion[:3, :3] = rotation(step[:3])
        motion[:3, 3] = centre + step[3:6] - motion[:3, :3] @ centre
        return Guess(motion @ self.to_camera, self.sliders + step[6:])


def positions(shapes: Shapes, guess: Guess) -> Float[np.ndarray, "points 3"]:
    """The points in the camera's frame, metres."""
    return shapes.at(guess.sliders) @ guess.to_camera[:3, :3].T + guess.to_camera[:3, 3]


def residuals(shapes: Shapes, sight: Sight, guess: Guess) -> Float[np.ndarray, "points 2"]:
    """How far each point shows from where it was put, in standard deviations."""
    away = sight.camera.project(positions(shapes, guess)) - sight.pixels
    return np.asarray(away / sight.deviation[:, None])


def jacobian(
    shapes: Shapes, sight: Sight, guess: Guess, centre: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "points 2 unknowns"]:
    """Derivative of :func:`residuals` by the step of :meth:`Guess.turned`."""
    points, focal = positions(shapes, guess), sight.camera.focal_px
    depth = -points[:, 2]
    by_point = np.zeros((len(points), 2, 3))
    by_point[:, 0, 0], by_point[:, 0, 2] = focal / depth, focal * points[:, 0] / depth**2
    by_point[:, 1, 1], by_point[:, 1, 2] = -focal / depth, -focal * points[:, 1] / depth**2
    by_point /= sight.deviation[:, None, None]
    arm = np.broadcast_to((points - centre)[:, None], by_point.shape)
    by_shape = (by_point @ guess.to_camera[:3, :3]) @ shapes.modes
    return np.concatenate([np.cross(arm, by_point), by_point, by_shape], axis=2)


def energy(
    shapes: Shapes, sight: Sight, guess: Guess, rest: Float[np.ndarray, " sliders"]
) -> float:
    """What is minimised; infinite where a point is behind the camera."""
    squared = (residuals(shapes, sight, guess) ** 2).sum(axis=1)
    if not np.isfinite(squared).all():
        return np.inf
    calm = CAUCHY_SCALE**2 * np.log1p(squared / CAUCHY_SCALE**2)
    seen = sight.share @ np.where(sight.sure, squared, calm)
    return 0.5 * float(seen + (((guess.sliders - rest) / shapes.spread) ** 2).sum())


def solve(
    shapes: Shapes,
    sight: Sight,
    start: Guess,
    rest: Float[np.ndarray, " sliders"],
    steps: int = STEPS,
) -> Guess:
    """The best pose and sliders from ``start`` on; ``rest``: the sliders that are likeliest."""
    guess = replace(start, sliders=np.clip(start.sliders, shapes.low, shapes.high))
    value, damping = energy(shapes, sight, guess, rest), DAMPING
    for _ in range(steps):
        centre = positions(shapes, guess).mean(axis=0)
        hessian, gradient = _normal_equations(shapes, sight, guess, rest, centre)
        scale = np.diag(hessian).copy()
        low = np.r_[np.full(6, -np.inf), shapes.low - guess.sliders]
        high = np.r_[np.full(6, np.inf), shapes.high - guess.sliders]
        for _ in range(TRIALS):
            step = _bounded_step(hessian + np.diag(damping * scale), gradient, low, high)
            trial = guess.turned(step, centre)
            found = energy(shapes, sight, trial, rest)
            if found <= value:
                break
            damping *= 30.0
        else:
            return guess
        gained, value, guess = value - found, found, trial
        damping = max(damping / 10.0, DAMPING)
        if gained <= SETTLED * max(value, 1e-12):
            break
    return guess


def upright_pose(
    points: Float[np.ndarray, "points 3"], sight: Sight, scale: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "4 4"]:
    """A pose to start from, of ``points`` in the mesh's own coordinates, scaled by ``scale``: the
    nearest rotation to the best two rows of a scaled one (DeMenthon & Davis 1995).
    """
    weights, camera = sight.share / sight.deviation**2, sight.camera
    weights = weights / weights.sum()
    points = points * scale
    centre3, centre2 = weights @ points, weights @ sight.pixels
    arms, image = points - centre3, (sight.pixels - centre2) * [1.0, -1.0]
    square = arms.T @ (arms * weights[:, None])
    square += 1e-6 * np.trace(square) * np.eye(3)  # points in a plane leave one column open
    rows = np.linalg.solve(square, arms.T @ (image * weights[:, None])).T
    size = max(0.5 * float(np.linalg.norm(rows, axis=1).sum()), 1e-6)
    u, _, vt = np.linalg.svd(rows / size, full_matrices=False)
    two = u @ vt
    turn = np.vstack([two, np.cross(two[0], two[1])])
    ray = np.append((centre2 - camera.principal_px) * [1.0, -1.0] / camera.focal_px, -1.0)
    result = np.eye(4)
    result[:3, :3] = turn * scale
    result[:3, 3] = camera.focal_px / size * ray - turn @ centre3
    return result


def rotation(vector: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation by a vector's length in radians about it (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle if angle > 1e-12 else np.zeros(3)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def _normal_equations(
    shapes: Shapes, sight: Sight, guess: Guess, rest: np.ndarray, centre: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    away = residuals(shapes, sight, guess)
    weights = sight.share / np.where(sight.sure, 1.0, 1.0 + (away**2).sum(axis=1) / CAUCHY_SCALE**2)
    columns = jacobian(shapes, sight, guess, centre).reshape(2 * len(away), -1)
    weighed = columns * np.repeat(weights, 2)[:, None]
    hessian, gradient = columns.T @ weighed, weighed.T @ away.ravel()
    stiffness = 1.0 / shapes.spread**2
    hessian[range(6, len(hessian)), range(6, len(hessian))] += stiffness
    gradient[6:] += stiffness * (guess.sliders - rest)
    # What nothing holds stays.
    hessian[range(len(hessian)), range(len(hessian))] += 1e-9 * max(float(hessian.max()), 1e-9)
    return hessian, gradient


def _bounded_step(
    hessian: np.ndarray, gradient: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """The step to the quadratic's minimum; what would leave its bounds is held there, round by
    round.
    """
    step, free = np.zeros(len(gradient)), np.ones(len(gradient), bool)
    for _ in range(BOUND_ROUNDS):
        held = hessian[np.ix_(free, ~free)] @ step[~free]
        step[free] = np.linalg.solve(hessian[np.ix_(free, free)], -gradient[free] - held)
        outside = free & ((step < low) | (step > high))
        if not outside.any():
            break
        step = np.where(outside, np.clip(step, low, high), step)
        free &= ~outside
    return np.clip(step, low, high)
