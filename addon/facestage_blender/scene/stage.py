"""The virtual light stage as area lights under one empty.

A Cycles area light of power P (W) over A square metres emits radiance P / (pi A) times its color.
"""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Matrix

from facestage.contract.errors import InputError
from facestage.contract.light_stage import LightStage, fibonacci_stage, joined

from ..properties import LIGHT_STATES
from . import frames
from .several import separate_light
from .softbox import read_softbox, remove_softbox, softbox_of

COLLECTION = "Facestage"
EMPTY = "Facestage Stage"
# Sum of the new lights' radiances: a white card that faces the camera then reflects about 1.2.
TOTAL_RADIANCE = 100.0
# EEVEE leaves out light below this threshold; its own, 0.01, would leave out lamps of a watt.
FAINTEST = 1e-5
# Faces that can be looked through behind each other, such as a lid's lashes; Cycles' own, 8, would
# show them as a black band.
SEEN_THROUGH = 64


def default_stage(count: int, radius: float, side: float) -> LightStage:
    """A new stage whose lights together expose a face well at any count, radius and size."""
    stage = fibonacci_stage(count, radius, side)
    return stage.with_radiance(
        np.full((count, 3), TOTAL_RADIANCE / count * (0.2 * radius / side) ** 2)
    )


def ensure_stage(scene: bpy.types.Scene) -> bpy.types.Object:
    """The scene's stage, made as its settings say where there is none."""
    empty = scene.facestage.stage
    return new_stage(scene) if empty is None or empty.name not in scene.objects else empty


def new_stage(scene: bpy.types.Scene) -> bpy.types.Object:
    """Build the stage anew, as the scene's settings say."""
    settings = scene.facestage
    settings.exposure_known = True
    stage = default_stage(settings.light_count, settings.light_radius, settings.light_side)
    return build_stage(scene, stage)


def build_stage(scene: bpy.types.Scene, stage: LightStage) -> bpy.types.Object:
    """Make the scene's light stage equal to ``stage`` (stage frame) and return its empty.

    Existing lights and the empty's place in the world are kept; surplus lights are removed.
    """
    collection = facestage_collection(scene)
    empty = scene.facestage.stage
    if empty is None or empty.name not in scene.objects:
        empty = bpy.data.objects.new(EMPTY, None)
        empty.empty_display_type, empty.empty_display_size = "PLAIN_AXES", 0.03
        collection.objects.link(empty)
        scene.facestage.stage = empty
    remove_softbox(empty)  # a fit has made squares of it
    lights = stage_lights(empty)
    for surplus in lights[len(stage) :]:
        data = surplus.data
        bpy.data.objects.remove(surplus)
        if not data.users:
            bpy.data.lights.remove(data)
    lights = lights[: len(stage)]
    while len(lights) < len(stage):
        lights.append(_new_light(collection, empty, len(lights)))
    for index, light in enumerate(lights):
        _set_light(light, stage, index)
    separate_light(scene)
    scene.eevee.light_threshold = min(scene.eevee.light_threshold, FAINTEST)
    if hasattr(scene, "cycles"):  # it can be disabled
        cycles = scene.cycles
        cycles.transparent_max_bounces = max(cycles.transparent_max_bounces, SEEN_THROUGH)
    return empty


def facestage_collection(scene: bpy.types.Scene) -> bpy.types.Collection:
    """The collection of everything that Facestage builds, made when missing."""
    for collection in scene.collection.children_recursive:
        if collection.name.split(".")[0] == COLLECTION:
            return collection
    collection = bpy.data.collections.new(COLLECTION)
    scene.collection.children.link(collection)
    return collection


def stage_lights(empty: bpy.types.Object) -> list[bpy.types.Object]:
    """The stage's lights in lattice order."""
    lights = [
        child
        for child in empty.children
        if child.type == "LIGHT" and child.facestage_light.index >= 0
    ]
    return sorted(lights, key=lambda light: (light.facestage_light.index, light.name))


def require_stage(scene: bpy.types.Scene) -> bpy.types.Object:
    """The scene's stage. Raises InputError when there is none or it is scaled."""
    empty = scene.facestage.stage
    if empty is None or empty.name not in scene.objects:
        raise InputError("The scene has no light stage; press Build Light Stage first.")
    for layer in scene.view_layers:
        layer.update()  # matrix_world of what a script has just moved is out of date
    if not np.allclose(empty.matrix_world.to_scale(), 1, atol=1e-4):
        raise InputError(f"The light stage '{empty.name}' is scaled; reset its scale to 1 (Alt S).")
    return empty


def read_stage(empty: bpy.types.Object) -> LightStage:
    """The lights under ``empty`` as the contract's stage, in the stage frame; the squares of its
    softbox, if there is one, come last.
    """
    lights = stage_lights(empty)
    if not lights:
        raise InputError("The light stage has no light; press Build Light Stage again.")
    for light in lights:
        if light.data.type != "AREA" or light.data.shape != "SQUARE":
            raise InputError(
                f"The light '{light.name}' is not a square area light; set its type and shape back."
            )
    local = np.array([relative_matrix(empty, light) for light in lights])
    axes = local[:, :3, :3] / np.linalg.norm(local[:, :3, :3], axis=1, keepdims=True)
    states = np.array([LIGHT_STATES[light.facestage_light.state] for light in lights])
    stage = LightStage(
        position=frames.points_to_stage(local[:, :3, 3]),
        direction=-frames.points_to_stage(axes[:, :, 2]),
        axis_x=frames.points_to_stage(axes[:, :, 0]),
        side=np.array([light_side(light) for light in lights]),
        radiance=np.array([light_radiance(light) for light in lights]),
        state=states,
    )
    softbox = softbox_of(empty)
    if softbox is None:
        return stage
    return joined(stage, read_softbox(softbox, relative_matrix(empty, softbox)))


def relative_matrix(empty: bpy.types.Object, child: bpy.types.Object) -> np.ndarray:
    """(4, 4) matrix of ``child`` relative to ``empty``, whether or not it is its parent."""
    if child.parent == empty and child.parent_type == "OBJECT" and not child.constraints:
        # Blender does not update matrix_world of hidden objects.
        return np.array(child.matrix_parent_inverse @ child.matrix_basis)
    return np.array(empty.matrix_world.inverted_safe() @ child.matrix_world)


def light_side(light: bpy.types.Object) -> float:
    """Side of a square light in metres, including the object's own scale."""
    return float(light.data.size) * 0.5 * (abs(light.scale.x) + abs(light.scale.y))


def light_radiance(light: bpy.types.Object) -> np.ndarray:
    """(3,) linear RGB radiance that the light emits; 0 when it is off."""
    if light.facestage_light.state == "OFF":
        return np.zeros(3)
    power = light.data.energy * 2.0 ** getattr(light.data, "exposure", 0.0)
    return power / (math.pi * light_side(light) ** 2) * np.array(light.data.color, np.float64)


def set_light_radiance(light: bpy.types.Object, radiance: np.ndarray, side: float) -> None:
    """Give a light of ``side`` metres the color and power of an RGB radiance (3,); black keeps the
    color.
    """
    energy, color = light_power(np.asarray(radiance), side)
    if energy > 0:
        light.data.color = color
    light.data.energy = float(energy)


def light_power(radiance: np.ndarray, side: float) -> tuple[np.ndarray, np.ndarray]:
    """Watts (...) and color (..., 3) of a square light of ``side`` metres by its RGB radiance
    (..., 3); black is white without power.
    """
    values = np.asarray(radiance, np.float64)
    peak = values.max(axis=-1)
    color = np.where(peak[..., None] > 0, values / np.maximum(peak, 1e-300)[..., None], 1.0)
    return peak * math.pi * side**2, color


def _new_light(
    collection: bpy.types.Collection, empty: bpy.types.Object, index: int
) -> bpy.types.Object:
    light = bpy.data.objects.new(
        f"Facestage Light {index + 1:02d}",
        bpy.data.lights.new(f"Facestage Light {index + 1:02d}", "AREA"),
    )
    collection.objects.link(light)
    light.parent = empty
    light.facestage_light.index = index
    return light


def _set_light(light: bpy.types.Object, stage: LightStage, index: int) -> None:
    """Place one light and give it its size, state and radiance."""
    matrix = np.eye(4)
    matrix[:3, :3] = frames.light_rotation(stage.direction[index], stage.axis_x[index])
    matrix[:3, 3] = frames.points_to_blender(stage.position[index])
    light.matrix_parent_inverse = Matrix()
    light.matrix_basis = Matrix(matrix.tolist())
    light.facestage_light.index = index
    data = light.data
    data.type, data.shape, data.size = "AREA", "SQUARE", float(stage.side[index])
    data.spread = math.pi
    # only how long the 3D View draws the light's axis
    data.cutoff_distance = float(stage.side[index])
    for name, value in (("exposure", 0.0), ("normalize", True), ("use_temperature", False)):
        if hasattr(data, name):  # which of these exist depends on the version of Blender
            setattr(data, name, value)
    light.visible_camera = False
    state = next(name for name, value in LIGHT_STATES.items() if value == stage.state[index])
    if state != "OFF":  # an off light keeps its power for the day it is turned on again
        set_light_radiance(light, stage.radiance[index], float(stage.side[index]))
    light.facestage_light.state = state
    light.facestage_light.fitted_radiance = stage.radiance[index]


def place(
    empty: bpy.types.Object, item: bpy.types.Object, to_stage: np.ndarray, axes: str | np.ndarray
) -> None:
    """Move an object to its pose (4, 4) in the stage frame, whatever its parent is; it takes the
    axes' scale.
    """
    item.matrix_world = empty.matrix_world @ Matrix(frames.local_matrix(to_stage, axes).tolist())
