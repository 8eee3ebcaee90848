"""The landmark stage in numpy: the pose and the sliders, and where it is unknown the focal length,
under which points of a face show where they were put. No bpy.

Minimised is half the sum of squares of (points - where they were put) / deviation, with a Cauchy
loss on what is not pinned, of (sliders - their rest) / deviation, and of log(focal length / the
camera's) / deviation, by Levenberg-Marquardt steps within the sliders' bounds.
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
# Pins that contradict each other do not end at a fisheye: the most of log(focal / the camera's).
FOCAL_REACH = np.log(2.0)


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
    that each is; ``sure``: put there by hand, however far that is; ``focal_sigma``: standard
    deviation of the logarithm of the camera's focal length, 0 where that is known.
    """

    camera: Camera
    pixels: Float[np.ndarray, "points 2"]
    deviation: Float[np.ndarray, " points"]
    share: Float[np.ndarray, " points"]
    sure: Bool[np.ndarray, " points"]
    focal_sigma: float = 0.0

    def lens(self, guess: Guess) -> Camera:
        """The camera with the focal length of ``guess``."""
        if guess.focal_px is None:
            return self.camera
        return replace(self.camera, focal_px=guess.focal_px)


@dataclass(frozen=True)
class Guess:
    """A pose of the mesh, from its own coordinates to the camera's (4, 4), its sliders, and the
    focal length in pixels; None: the camera's.
    """

    to_camera: Float[np.ndarray, "4 4"]
    sliders: Float[np.ndarray, " sliders"]
    focal_px: float | None = None

    def turned(self, step: Float[np.ndarray, " unknowns"], centre: np.ndarray) -> Guess:
        """After a rotation vector about ``centre`` (3,), metres, changes of the sliders, and one of
        the logarithm of the focal length, if the step has it: by that much the face goes further
        away, and shows as large as before.
        """
        count, focal_px, away = 6 + len(self.sliders), self.focal_px, 0.0
        if len(step) > count and focal_px is not None:
            zoom = float(np.exp(step[count]))
            focal_px, away = zoom * focal_px, (zoom - 1.0) * centre[2]
        motion = np.eye(4)
        motion[:3, :3] = rotation(step[:3])
        motion[:3, 3] = centre + step[3:6] + [0.0, 0.0, away] - motion[:3, :3] @ centre
        return Guess(motion @ self.to_camera, self.sliders + step[6:count], focal_px)


def positions(shapes: Shapes, guess: Guess) -> Float[np.ndarray, "points 3"]:
    """The points in the camera's frame, metres."""
    return shapes.at(guess.sliders) @ guess.to_camera[:3, :3].T + guess.to_camera[:3, 3]


def residuals(shapes: Shapes, sight: Sight, guess: Guess) -> Float[np.ndarray, "points 2"]:
    """How far each point shows from where it was put, in standard deviations."""
    away = sight.lens(guess).project(positions(shapes, guess)) - sight.pixels
    return np.asarray(away / sight.deviation[:, None])


def jacobian(
    shapes: Shapes, sight: Sight, guess: Guess, centre: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "points 2 unknowns"]:
    """Derivative of :func:`residuals` by the step of :meth:`Guess.turned`, with the focal length
    where that is unknown.
    """
    points, focal = positions(shapes, guess), sight.lens(guess).focal_px
    depth = -points[:, 2]
    by_point = np.zeros((len(points), 2, 3))
    by_point[:, 0, 0], by_point[:, 0, 2] = focal / depth, focal * points[:, 0] / depth**2
    by_point[:, 1, 1], by_point[:, 1, 2] = -focal / depth, -focal * points[:, 1] / depth**2
    by_point /= sight.deviation[:, None, None]
    arm = np.broadcast_to((points - centre)[:, None], by_point.shape)
    by_shape = (by_point @ guess.to_camera[:3, :3]) @ shapes.modes
    columns = [np.cross(arm, by_point), by_point, by_shape]
    if sight.focal_sigma:
        offset = focal * points[:, :2] / depth[:, None] * [1.0, -1.0] / sight.deviation[:, None]
        columns.append((offset + centre[2] * by_point[..., 2])[..., None])
    return np.concatenate(columns, axis=2)


def energy(
    shapes: Shapes, sight: Sight, guess: Guess, rest: Float[np.ndarray, " sliders"]
) -> float:
    """What is minimised; infinite where a point is behind the camera."""
    squared = (residuals(shapes, sight, guess) ** 2).sum(axis=1)
    if not np.isfinite(squared).all():
        return np.inf
    calm = CAUCHY_SCALE**2 * np.log1p(squared / CAUCHY_SCALE**2)
    seen = sight.share @ np.where(sight.sure, squared, calm)
    prior = (((guess.sliders - rest) / shapes.spread) ** 2).sum() + _focal_off(sight, guess) ** 2
    return 0.5 * float(seen + prior)


def solve(
    shapes: Shapes,
    sight: Sight,
    start: Guess,
    rest: Float[np.ndarray, " sliders"],
    steps: int = STEPS,
) -> Guess:
    """The best pose, sliders and, where it is unknown, focal length from ``start`` on; ``rest``:
    the sliders that are likeliest.
    """
    guess = Guess(
        start.to_camera,
        np.clip(start.sliders, shapes.low, shapes.high),
        sight.lens(start).focal_px if sight.focal_sigma else start.focal_px,
    )
    value, damping = energy(shapes, sight, guess, rest), DAMPING
    for _ in range(steps):
        centre = positions(shapes, guess).mean(axis=0)
        hessian, gradient = _normal_equations(shapes, sight, guess, rest, centre)
        scale = np.diag(hessian).copy()
        zoom = _focal_off(sight, guess) * sight.focal_sigma
        reach = np.array([-FOCAL_REACH, FOCAL_REACH])[:, None] - zoom
        reach = reach[:, : 1 if sight.focal_sigma else 0]
        low = np.r_[np.full(6, -np.inf), shapes.low - guess.sliders, reach[0]]
        high = np.r_[np.full(6, np.inf), shapes.high - guess.sliders, reach[1]]
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
    stiffness, sliders = 1.0 / shapes.spread**2, range(6, 6 + len(rest))
    hessian[sliders, sliders] += stiffness
    gradient[sliders] += stiffness * (guess.sliders - rest)
    if sight.focal_sigma:
        hessian[-1, -1] += 1.0 / sight.focal_sigma**2
        gradient[-1] += _focal_off(sight, guess) / sight.focal_sigma
    # What nothing holds stays.
    hessian[range(len(hessian)), range(len(hessian))] += 1e-9 * max(float(hessian.max()), 1e-9)
    return hessian, gradient


def _focal_off(sight: Sight, guess: Guess) -> float:
    """How far the focal length is from the camera's, in standard deviations; 0 if it is known."""
    if not sight.focal_sigma:
        return 0.0
    return float(np.log(sight.lens(guess).focal_px / sight.camera.focal_px)) / sight.focal_sigma


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
