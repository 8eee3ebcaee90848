"""Light the fitted face from elsewhere, and go back."""

from __future__ import annotations

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.light_stage import OFF

from .light_setups import LIGHT_FROM, SETUPS, direction
from .several import separate_light
from .softbox import add_softbox, remove_softbox, shine
from .stage import light_side, read_stage, require_stage, set_light_radiance, stage_lights

# On a world that Light From made: that it is one, and the one before it.
MARK, BEFORE = "facestage_surroundings", "facestage_before"


def relight(scene: bpy.types.Scene, name: str, mirrored: bool = False, yaw: float = 0.0) -> None:
    """White light from one side, or of a setup that has a name, of the same total radiance as the
    fitted lights. Lights that are off stay off.

    ``mirrored``: mirrored; ``yaw``: radians that a face for which a setup is meant is turned by to
    the picture's right. Sides are the picture's. Raises InputError when there is no such light, or
    when no light is on.
    """
    if name not in LIGHT_FROM:
        raise InputError(f"Cannot light from '{name}'; expected one of {', '.join(LIGHT_FROM)}.")
    setup = LIGHT_FROM[name].mirrored() if mirrored else LIGHT_FROM[name]
    if name in SETUPS:
        setup = setup.before(yaw)
    lights = lights_on(scene)
    take_back(scene)
    outward = -read_stage(require_stage(scene)).direction[[index for index, _ in lights]]
    shares = sum((beam.lobe(outward) for beam in setup.beams), np.zeros(len(lights)))
    total = total_radiance(scene)
    for (_, light), share in zip(lights, shares, strict=True):
        set_light_radiance(light, np.full(3, total * share), light_side(light))


def next_light(scene: bpy.types.Scene, number: int = 0) -> tuple[int, int]:
    """Let one light alone shine, as bright as all of the fitted ones, in its fitted color: that of
    this number, 1 is the first; 0: the first, or the one after that which does so already. Returns
    its number and how many there are.

    Raises InputError when no light is on, or there is no such light.
    """
    lights = lights_on(scene)
    if number > len(lights):
        raise InputError(f"There is no light {number}; {len(lights)} of the stage's are on.")
    take_back(scene)
    shining = [place for place, (_, light) in enumerate(lights) if light.data.energy > 0]
    following = (shining[0] + 1) % len(lights) if len(shining) == 1 else 0
    chosen = number - 1 if number else following
    total = total_radiance(scene)
    for place, (_, light) in enumerate(lights):
        color = np.array(light.facestage_light.fitted_radiance)
        color = color / color.mean() if color.any() else np.ones(3)
        set_light_radiance(light, float(place == chosen) * total * color, light_side(light))
    return chosen + 1, len(lights)


def lit_by_world(scene: bpy.types.Scene) -> bool:
    """Whether a world that Light From made lights the scene."""
    return scene.world is not None and bool(scene.world.get(MARK))


def light_by_softbox(
    scene: bpy.types.Scene, place: tuple[float, float, float], size: tuple[float, float]
) -> bpy.types.Object:
    """Let a white softbox alone light the face, as brightly as the fitted lights would a surface
    that faces them.

    ``place``: radians left of the camera and above it, and metres from the stage's middle;
    ``size``: width and height in metres. Raises InputError when no light is on.
    """
    empty = require_stage(scene)
    remove_softbox(empty)
    lights, stage = lights_on(scene), read_stage(empty)
    take_back(scene)
    left, up, distance = place
    softbox = add_softbox(empty, np.array(direction(*np.degrees((left, up)))), distance, size)
    spread = np.square(stage.side / np.linalg.norm(stage.position, axis=1))
    fitted = sum(
        float(np.mean(light.facestage_light.fitted_radiance)) * spread[index]
        for index, light in lights
    )
    shine(softbox, fitted * distance**2 / (size[0] * size[1]))
    for _, light in lights:
        set_light_radiance(light, np.zeros(3), light_side(light))
    separate_light(scene)
    return softbox


def take_back(scene: bpy.types.Scene) -> None:
    """Give the scene the world that it had before Light From made one, if it did, and take the
    softbox away that it made.
    """
    if scene.facestage.stage is not None:
        remove_softbox(scene.facestage.stage)
    if not lit_by_world(scene):
        return
    world = scene.world
    scene.world = world.get(BEFORE)
    if not world.users:
        bpy.data.worlds.remove(world)


def lights_on(scene: bpy.types.Scene) -> list[tuple[int, bpy.types.Object]]:
    """The stage's lights that are not off, with their places among all.

    Raises InputError when there is none.
    """
    empty = require_stage(scene)
    state = read_stage(empty).state
    found = [
        (index, light) for index, light in enumerate(stage_lights(empty)) if state[index] != OFF
    ]
    if not found:
        raise InputError("All lights of the stage are off; turn one on (Lights, Set All).")
    return found


def total_radiance(scene: bpy.types.Scene) -> float:
    """Of all lights together, as they were fitted."""
    lights = stage_lights(require_stage(scene))
    return float(sum(np.mean(light.facestage_light.fitted_radiance) for light in lights))


def restore_lights(scene: bpy.types.Scene) -> None:
    """Give every light the radiance that the last fit, or the last build of the stage, gave it."""
    take_back(scene)
    for light in stage_lights(require_stage(scene)):
        radiance = np.array(light.facestage_light.fitted_radiance)
        if radiance.any() or light.facestage_light.state != "OFF":  # an off light keeps its power
            set_light_radiance(light, radiance, light_side(light))
