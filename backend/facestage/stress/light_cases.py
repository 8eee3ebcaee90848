"""Stiff and extreme light."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract.environment import environment_stage
from facestage.contract.job import UNKNOWN, Job
from facestage.contract.light_stage import FROZEN, OFF, LightStage, fibonacci_stage
from facestage.stress.case import REFUSAL, Suite
from facestage.stress.scene import Scene, plain_scene, render, with_stage, write_job

suite = Suite()


def _job(folder: Path, scene: Scene) -> Job:
    return write_job(folder, scene, render(scene))


def _lit_by(scene: Scene, *lights: int) -> Scene:
    """The scene with radiance 1 at ``lights`` and 0 elsewhere."""
    radiance = np.zeros((len(scene.stage), 3))
    radiance[list(lights)] = 1.0
    return with_stage(scene, radiance=radiance)


def _anchored(scene: Scene, stage: LightStage) -> Scene:
    """The scene under ``stage``, fixed where the true face is."""
    matrix = np.eye(4)
    matrix[:3, 3] = -scene.translation
    return replace(scene, stage=stage, camera_to_stage=matrix)


@suite.add(
    "plain", "nothing extreme: what the other cases compare with", worst_mm=0.6, worst_psnr=36
)
def plain(folder: Path) -> Job:
    """The scene that the others change."""
    return _job(folder, plain_scene())


@suite.add(
    "grazing-light",
    "a single light 88 degrees from the view axis, among twelve",
    worst_mm=1.2,
    worst_psnr=30,
)
def grazing_light(folder: Path) -> Job:
    """The last light of the lattice is the lowest."""
    scene = plain_scene()
    return _job(folder, _lit_by(scene, len(scene.stage) - 1))


@suite.add("light-ratio-million", "one light a million times another", worst_mm=1.0, worst_psnr=34)
def light_ratio_million(folder: Path) -> Job:
    """A geometric series of radiance over twelve lights."""
    scene = plain_scene()
    level = np.geomspace(1.0, 1e-6, len(scene.stage))
    return _job(folder, with_stage(scene, radiance=np.repeat(level[:, None], 3, axis=1)))


@suite.add("frozen-ratio-million", "a frozen light a million times too bright", worst_mm=1.2)
def frozen_ratio_million(folder: Path) -> Job:
    """The photo is exposed for the other lights; the job insists on a light that outshines it."""
    scene = plain_scene()
    job = _job(folder, scene)
    state, radiance = scene.stage.state.copy(), scene.stage.radiance.copy()
    state[3], radiance[3] = FROZEN, 1e6
    return replace(job, stage=replace(scene.stage, state=state, radiance=radiance))


@suite.add("all-lights-off", "every light switched off", right=REFUSAL)
def all_lights_off(folder: Path) -> Job:
    """Nothing could explain the photo."""
    scene = plain_scene()
    job = _job(folder, scene)
    return replace(job, stage=replace(scene.stage, state=np.full(len(scene.stage), OFF)))


@suite.add("all-lights-frozen-dark", "every light frozen at radiance 0", right=REFUSAL)
def all_lights_frozen_dark(folder: Path) -> Job:
    """As good as off."""
    scene = plain_scene()
    job = _job(folder, scene)
    count = len(scene.stage)
    return replace(
        job, stage=replace(scene.stage, state=np.full(count, FROZEN), radiance=np.zeros((count, 3)))
    )


@suite.add(
    "identical-lights", "every light twice at the same place: singular normal equations", 0.8, 34
)
def identical_lights(folder: Path) -> Job:
    """How two coincident lights share their radiance is a null direction."""
    scene = plain_scene()
    job = _job(folder, scene)
    arrays = {name: np.concatenate([value, value]) for name, value in vars(scene.stage).items()}
    return replace(job, stage=LightStage(**arrays))


@suite.add("light-touching-skin", "a light whose square cuts through the cheek", worst_mm=1.2)
def light_touching_skin(folder: Path) -> Job:
    """Inverse squares of distances near 0."""
    return _job(folder, _with_light_at(np.array([0.045, -0.02, 0.0]), side=0.05))


@suite.add("light-inside-head", "a light in the middle of the head", worst_mm=1.0, worst_psnr=32)
def light_inside_head(folder: Path) -> Job:
    """Shadow rays that start inside the mesh."""
    return _job(folder, _with_light_at(np.array([0.0, 0.0, -0.06]), side=0.02))


def _with_light_at(position: np.ndarray, side: float) -> Scene:
    """The plain scene with its last light moved to ``position`` (3,), facing the camera's left."""
    scene = plain_scene()
    stage = scene.stage
    arrays = {name: value.copy() for name, value in vars(stage).items()}
    arrays["position"][-1], arrays["side"][-1], arrays["radiance"][-1] = position, side, 0.5
    arrays["direction"][-1], arrays["axis_x"][-1] = [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
    return _anchored(scene, LightStage(**arrays))


@suite.add("lights-behind-head", "the whole stage behind the head: only rims are lit", worst_mm=1.5)
def lights_behind_head(folder: Path) -> Job:
    """No light reaches the face."""
    scene = plain_scene()
    flip = np.array([1.0, 1.0, -1.0])
    mirrored = {
        name: getattr(scene.stage, name) * flip for name in ("position", "direction", "axis_x")
    }
    return _job(folder, with_stage(scene, **mirrored))


@suite.add("rim-light-alone", "a lamp behind the head, and a stage in front of it", worst_mm=1.5)
def rim_light_alone(folder: Path) -> Job:
    """What lights the photo stands where the job has no light."""
    scene = plain_scene()
    behind = fibonacci_stage(len(scene.stage), behind=True)
    lamp = int(np.argmax(behind.position @ [0.8, 0.2, -0.6]))
    lit = _lit_by(replace(scene, stage=behind), lamp)
    return replace(_job(folder, lit), stage=scene.stage)


@suite.add("neon-light", "nothing but one red tube and one blue one", worst_mm=1.0, worst_psnr=30)
def neon_light(folder: Path) -> Job:
    """No light is white, and hardly any is green."""
    scene = plain_scene()
    radiance = np.zeros((len(scene.stage), 3))
    radiance[np.argmax(scene.stage.position @ [-0.7, 0.2, 0.6])] = [1.0, 0.02, 0.05]
    radiance[np.argmax(scene.stage.position @ [0.7, 0.2, 0.6])] = [0.05, 0.02, 1.0]
    return _job(folder, with_stage(scene, radiance=radiance))


@suite.add("sun-in-known-sky", "known surroundings with a sun 10^5 times their sky", worst_mm=1.2)
def sun_in_known_sky(folder: Path) -> Job:
    """One of sixty lights has nearly all of the light, and only the exposure is found."""
    sky = np.ones((64, 128, 3), np.float32)
    sky[18, 28] = 1e5 * np.array([1.0, 0.9, 0.7])
    scene = replace(plain_scene(), stage=environment_stage(sky))
    return replace(_job(folder, scene), exposure=UNKNOWN)


@suite.add("one-light", "a stage of a single light", worst_mm=1.0, worst_psnr=32)
def one_light(folder: Path) -> Job:
    """Hard shadows, and nothing to trade."""
    return _job(folder, plain_scene(lights=1))


@suite.add(
    "hundred-lights",
    "100 lights: neighbours that look alike",
    worst_mm=0.8,
    worst_psnr=34,
    seconds=600,
)
def hundred_lights(folder: Path) -> Job:
    """300 light parameters."""
    return _job(folder, plain_scene(lights=100))


@suite.add("needle-light", "lights a tenth of a millimetre wide", worst_mm=0.8, worst_psnr=34)
def needle_light(folder: Path) -> Job:
    """Point-like: radiance 10^6 times what a usual light needs."""
    scene = plain_scene()
    return _job(folder, with_stage(scene, side=np.full(len(scene.stage), 1e-4)))


@suite.add(
    "wall-light", "lights four metres wide: they overlap and pass through the head", worst_mm=1.2
)
def wall_light(folder: Path) -> Job:
    """Squares larger than the stage."""
    scene = plain_scene()
    return _job(folder, with_stage(scene, side=np.full(len(scene.stage), 4.0)))


@suite.add(
    "uniform-color",
    "one color for all lights, and that color almost pure red",
    worst_mm=1.0,
    worst_psnr=32,
)
def uniform_color(folder: Path) -> Job:
    """The product of color and intensity has a null direction."""
    scene = plain_scene()
    level = scene.stage.radiance.mean(axis=1, keepdims=True)
    job = _job(folder, with_stage(scene, radiance=level * [1.0, 0.02, 0.01]))
    return replace(job, light_color="uniform")


@suite.add("radiance-million", "radiance of the order of 10^6", worst_mm=0.6)
def radiance_million(folder: Path) -> Job:
    """Units are arbitrary; nothing may depend on them."""
    scene = plain_scene()
    return write_job(folder, scene, render(scene, background=2e5, exposure=1e6))


@suite.add("radiance-millionth", "radiance of the order of 10^-6", worst_mm=0.6)
def radiance_millionth(folder: Path) -> Job:
    """The same photo, very dark."""
    scene = plain_scene()
    return write_job(folder, scene, render(scene, background=2e-7, exposure=1e-6))
