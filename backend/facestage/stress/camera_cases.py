"""Extreme cameras, poses and distances."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.job import Job
from facestage.stress.case import DOUBT, Suite
from facestage.stress.scene import (
    DISTANCE,
    FOCAL_PER_SIDE,
    SIDE_PX,
    Scene,
    plain_scene,
    render,
    turn,
    write_job,
)

suite = Suite()


def _job(folder: Path, scene: Scene) -> Job:
    return write_job(folder, scene, render(scene))


def _zoomed(scene: Scene, focal_per_side: float) -> Scene:
    """The scene through another lens, the face as large in the photo."""
    camera = replace(scene.camera, focal_px=focal_per_side * SIDE_PX)
    distance = DISTANCE * focal_per_side / FOCAL_PER_SIDE
    return replace(scene, camera=camera, translation=np.array([*scene.translation[:2], -distance]))


@suite.add("yaw-60", "head turned by 60 degrees", worst_mm=1.5, worst_psnr=30)
def yaw_60(folder: Path) -> Job:
    """One eye is hidden."""
    return _job(folder, replace(plain_scene(), rotation=turn(yaw=60)))


@suite.add("yaw-90", "a profile: head turned by 90 degrees", worst_mm=2.5, worst_psnr=28)
def yaw_90(folder: Path) -> Job:
    """Half of the face is hidden, and half of the landmarks are guesses."""
    return _job(folder, replace(plain_scene(), rotation=turn(yaw=90)))


@suite.add("back-of-head", "a head that looks away, with landmarks all the same", right=DOUBT)
def back_of_head(folder: Path) -> Job:
    """Every landmark is hidden behind hair; a detector would not know."""
    scene = replace(plain_scene(), rotation=turn(yaw=180))
    job = _job(folder, scene)
    assert job.landmarks is not None
    return replace(job, landmarks=replace(job.landmarks, visible=np.ones(68, bool)))


def _far(folder: Path, metres: float) -> Job:
    """The plain scene in a stage whose origin is ``metres`` away from the face."""
    scene = plain_scene()
    offset = metres * np.array([0.6, -0.48, 0.64])
    matrix = np.eye(4)
    matrix[:3, :3] = turn(yaw=130, pitch=20)
    matrix[:3, 3] = offset
    centre = matrix[:3, :3] @ scene.translation + offset
    to_stage = np.eye(4)
    to_stage[:3, :3], to_stage[:3, 3] = matrix[:3, :3], centre
    return _job(
        folder, replace(scene, stage=scene.stage.transformed(to_stage), camera_to_stage=matrix)
    )


@suite.add(
    "stage-far-10km", "face and lights 10 km from the stage's origin", worst_mm=0.6, worst_psnr=36
)
def stage_far_10km(folder: Path) -> Job:
    """float32 would keep a millimetre."""
    return _far(folder, 1e4)


@suite.add(
    "stage-far-1000km",
    "face and lights 1000 km from the stage's origin",
    worst_mm=0.6,
    worst_psnr=36,
)
def stage_far_1000km(folder: Path) -> Job:
    """float32 would keep six centimetres."""
    return _far(folder, 1e6)


@suite.add(
    "telescope",
    "a focal length of 1000 photo widths, the face 240 m away",
    worst_mm=1.0,
    worst_psnr=32,
)
def telescope(folder: Path) -> Job:
    """Parallel rays: depth and size look the same."""
    return _job(folder, _zoomed(plain_scene(), 1000.0))


@suite.add(
    "wide-lens", "a focal length of half the photo's width, the lens 12 cm from the face", 1.5, 30
)
def wide_lens(folder: Path) -> Job:
    """The nose is twice as near as the ears."""
    return _job(folder, _zoomed(plain_scene(), 0.5))


@suite.add(
    "lens-unknown",
    "the focal length is fitted, from a guess of half of it",
    worst_mm=1.5,
    worst_psnr=32,
)
def lens_unknown(folder: Path) -> Job:
    """Depth, size and focal length are one null direction, nearly."""
    return replace(_job(folder, plain_scene()), camera=None)


@suite.add("lens-wrong", "a focal length ten times too long, said to be known", worst_mm=2.5)
def lens_wrong(folder: Path) -> Job:
    """The fit may only say how well it does with it."""
    scene = plain_scene()
    return replace(
        _job(folder, scene), camera=replace(scene.camera, focal_px=10 * scene.camera.focal_px)
    )


@suite.add("tiny-face", "a face of 12 pixels", worst_mm=4.0)
def tiny_face(folder: Path) -> Job:
    """A dozen pixels from chin to brow."""
    scene = plain_scene(side_px=96)
    return _job(folder, replace(scene, translation=np.array([0.0, 0.0, -3.2])))


@suite.add(
    "corner-crop", "a crop whose optical axis lies far outside of it", worst_mm=1.0, worst_psnr=32
)
def corner_crop(folder: Path) -> Job:
    """Principal point 400 pixels to the left."""
    scene = plain_scene()
    camera = Camera(SIDE_PX, SIDE_PX, scene.camera.focal_px, (-350.0, SIDE_PX / 2))
    shift = DISTANCE * (SIDE_PX / 2 + 350.0) / camera.focal_px
    return _job(
        folder,
        replace(scene, camera=camera, translation=scene.translation + np.array([shift, 0.0, 0.0])),
    )
