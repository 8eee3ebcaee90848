"""How far the poses of single frames are off, measured in the sequence itself.

What a frame says of its own pose is trusted too much: errors of light, skin and landmarks are not
independent from pixel to pixel. From frame to frame they are, nearly; and heads move smoothly. So
the fourth difference in time shows them, whatever the motion.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.arrays import Float, Int
from facestage.fit.sequence.course import POSE, Course
from facestage.fit.sequence.smoother import Evidence

# 1, -4, 6, -4, 1: of independent noise, the fourth difference has 70 times the variance.
ORDER, GAIN = 4, 70.0
FRAMES_MIN = 12
INFLATION_MAX = 100.0


def with_honest_poses(
    course: Course, evidence: Evidence, shots: Int[np.ndarray, " frames"]
) -> Evidence:
    """``evidence`` of frames whose poses are as noisy as they show; never less than they say."""
    seen = np.einsum("tii->ti", evidence.hessian)[:, :POSE].all(axis=1)
    own = np.zeros_like(evidence.gradient)
    hessian = evidence.hessian[seen]
    own[seen] = np.linalg.solve(hessian, -evidence.gradient[seen][..., None])[..., 0]
    shown = _noise(course, own, shots)
    if shown is None:
        return evidence
    said = np.linalg.inv(hessian)[:, np.arange(POSE), np.arange(POSE)]
    inflation = np.clip(shown / np.median(said, axis=0), 1.0, INFLATION_MAX)
    factor = np.ones(evidence.gradient.shape[1])
    factor[:POSE] = 1.0 / np.sqrt(inflation)
    hessian = evidence.hessian * factor[:, None] * factor
    return replace(evidence, hessian=hessian, gradient=-np.einsum("tij,tj->ti", hessian, own))


def _noise(
    course: Course, own: Float[np.ndarray, "frames unknowns"], shots: Int[np.ndarray, " frames"]
) -> Float[np.ndarray, " 6"] | None:
    """Variance of each of a frame's own pose unknowns; None where too few frames follow each
    other.
    """
    turns = Rotation.from_matrix(course.rotation) * Rotation.from_matrix(course.rotation[0]).inv()
    poses = np.concatenate([turns.as_rotvec(), course.translation], axis=1) + own[:, :POSE]
    windows = [shots[k : len(shots) - ORDER + k] for k in range(ORDER + 1)]
    whole = np.ptp(windows, axis=0) == 0 if len(shots) > ORDER else np.zeros(0, bool)
    if whole.sum() < FRAMES_MIN:
        return None
    fourth = np.abs(np.diff(poses, ORDER, axis=0)[whole])
    return np.asarray((1.4826 * np.median(fourth, axis=0)) ** 2 / GAIN)
