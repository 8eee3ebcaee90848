"""Wrong, missing and contradictory landmarks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract.job import Job
from facestage.stress.case import DOUBT, REFUSAL, Suite
from facestage.stress.scene import Scene, plain_scene, project_landmarks, render, turn, write_job

suite = Suite()


def _with_points(
    folder: Path, scene: Scene, points: np.ndarray, visible: np.ndarray | None = None
) -> Job:
    """The scene's job with its landmarks moved to ``points`` (68, 2)."""
    landmarks = project_landmarks(scene)
    shown = landmarks.visible if visible is None else visible
    return write_job(folder, scene, render(scene), replace(landmarks, points=points, visible=shown))


@suite.add(
    "landmark-outliers", "12 of 68 landmarks wrong by half a face", worst_mm=1.5, worst_psnr=32
)
def landmark_outliers(folder: Path) -> Job:
    """Gross errors, scattered."""
    scene, random = plain_scene(), np.random.default_rng(8)
    points = project_landmarks(scene).points
    wrong = random.permutation(len(points))[:12]
    points[wrong] += random.normal(0, 40, (12, 2)).clip(-45, 45)
    return _with_points(folder, scene, points)


@suite.add("landmark-shift", "one eye's landmarks on the other eye", worst_mm=1.5, worst_psnr=32)
def landmark_shift(folder: Path) -> Job:
    """Outliers that agree with each other."""
    scene = plain_scene()
    points = project_landmarks(scene).points
    points[36:42] = points[42:48]
    return _with_points(folder, scene, points)


@suite.add("landmarks-at-a-point", "all landmarks at one point", right=REFUSAL)
def landmarks_at_a_point(folder: Path) -> Job:
    """A detector's way of finding nothing."""
    scene = plain_scene()
    return _with_points(folder, scene, np.full((68, 2), 56.0))


@suite.add("landmarks-on-a-line", "all landmarks on one line", right=REFUSAL)
def landmarks_on_a_line(folder: Path) -> Job:
    """A face seen edge-on does not exist."""
    scene = plain_scene()
    points = project_landmarks(scene).points
    points[:, 0] = 56.0
    return _with_points(folder, scene, points)


@suite.add("landmarks-mirrored", "left and right exchanged", right=DOUBT)
def landmarks_mirrored(folder: Path) -> Job:
    """The points of the mirrored photo."""
    scene = plain_scene()
    points = project_landmarks(scene).points
    points[:, 0] = scene.camera.width - points[:, 0]
    return _with_points(folder, scene, points)


@suite.add("landmarks-shuffled", "the right points in a random order", right=DOUBT)
def landmarks_shuffled(folder: Path) -> Job:
    """Another scheme under the same name."""
    scene = plain_scene()
    points = project_landmarks(scene).points
    return _with_points(folder, scene, np.random.default_rng(2).permutation(points))


@suite.add("landmarks-of-another-photo", "landmarks of a photo three times as large", right=REFUSAL)
def landmarks_of_another_photo(folder: Path) -> Job:
    """Made before the photo was made smaller."""
    scene = plain_scene()
    return _with_points(folder, scene, 3.0 * project_landmarks(scene).points)


@suite.add("six-landmarks", "six visible landmarks, the rest unknown", worst_mm=2.0, worst_psnr=30)
def six_landmarks(folder: Path) -> Job:
    """Just enough for a pose; the photo has to say the rest."""
    scene = plain_scene()
    points, visible = project_landmarks(scene).points, np.zeros(68, bool)
    visible[[8, 30, 36, 45, 48, 54]] = True
    points[~visible] = np.nan
    return _with_points(folder, scene, points, visible)


@suite.add("face-half-outside", "the frame cuts the face in two", worst_mm=1.5, worst_psnr=30)
def face_half_outside(folder: Path) -> Job:
    """Half of the landmarks lie outside the photo."""
    scene = plain_scene()
    shift = np.array([-0.085, 0.0, 0.0])
    scene = replace(scene, translation=scene.translation + shift)
    return write_job(folder, scene, render(scene))


@suite.add("upside-down", "a head upside down", worst_mm=1.0, worst_psnr=32)
def upside_down(folder: Path) -> Job:
    """Roll of 180 degrees, where Euler angles of a half-turn are two."""
    scene = replace(plain_scene(), rotation=turn(yaw=12, roll=180))
    return write_job(folder, scene, render(scene))
