"""The world's picture as the stage's lights: known surroundings instead of fitted light."""

from __future__ import annotations

import math

import bpy
import numpy as np

from facestage.contract.environment import environment_stage
from facestage.contract.errors import InputError
from facestage.contract.light_stage import LightStage

from ..pictures.images import image_pixels
from .frames import stage_to_blender
from .relight import BEFORE, MARK
from .stage import build_stage, require_stage


def light_as_world(scene: bpy.types.Scene) -> None:
    """Let the stage's lights, held, be what the world's picture shows; the fit finds the exposure.

    The stage's axes are the photo's camera's, as the fit has them. Raises InputError for a world
    without such a picture.
    """
    empty = require_stage(scene)
    picture, degrees = world_picture(scene)
    build_stage(scene, seen_from(empty, environment_stage(picture, degrees)))
    scene.facestage.exposure_known = False


def world_picture(scene: bpy.types.Scene) -> tuple[np.ndarray, float]:
    """(h, w, 3) linear map of all directions of the scene's world, or of the one that was put out
    of the way, and by how many degrees it is turned. Raises InputError.
    """
    world = scene.world or scene.facestage.world_before
    nodes = [] if world is None or world.node_tree is None else world.node_tree.nodes
    shown = [node for node in nodes if node.type == "TEX_ENVIRONMENT" and node.image is not None]
    if not shown:
        raise InputError(
            "The world shows no picture of the surroundings; give it an Environment Texture "
            "(World, Surface, Color)."
        )
    node = shown[0]
    if node.projection != "EQUIRECTANGULAR":
        raise InputError("The world's picture is a mirror ball; set it to Equirectangular.")
    if node.image.size[0] and not node.image.is_float:
        raise InputError(
            f"The world's picture '{node.image.name}' has 8 bits a channel, in which lamps are no "
            "brighter than walls; take an .exr or .hdr."
        )
    pixels = image_pixels(node.image)[..., :3]
    if not pixels.size or not np.isfinite(pixels).all():
        raise InputError(f"The world's picture '{node.image.name}' cannot be read; load it again.")
    return pixels, _turn(node)


def show_world(
    scene: bpy.types.Scene, image: bpy.types.Image, degrees: float, strength: float
) -> None:
    """Give the scene a world of a picture, turned by ``degrees``, and remember the one before."""
    world = bpy.data.worlds.new("Facestage Surroundings")
    if scene.world is not None:
        world[BEFORE] = scene.world
    world[MARK] = True
    scene.world = world
    if world.node_tree is None:  # before Blender 5.0 a new world has no nodes
        world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    place, turned = nodes.new("ShaderNodeTexCoord"), nodes.new("ShaderNodeMapping")
    turned.inputs["Rotation"].default_value[2] = math.radians(degrees)
    picture, background = nodes.new("ShaderNodeTexEnvironment"), nodes["Background"]
    picture.image, background.inputs["Strength"].default_value = image, strength
    links.new(place.outputs["Generated"], turned.inputs["Vector"])
    links.new(turned.outputs["Vector"], picture.inputs["Vector"])
    links.new(picture.outputs["Color"], background.inputs["Color"])


def seen_from(empty: bpy.types.Object, stage: LightStage) -> LightStage:
    """Lights in the stage frame of an upright empty at the origin, as ``empty`` has them."""
    turned = np.eye(4)
    turned[:3, :3] = empty_axes(empty)
    return stage.transformed(turned)


def empty_axes(empty: bpy.types.Object) -> np.ndarray:
    """(3, 3) from the stage frame of an upright empty to that of ``empty``."""
    into_empty = np.array(empty.matrix_world.to_3x3().normalized().inverted())
    return np.asarray(stage_to_blender().T @ into_empty @ stage_to_blender())


def _turn(node: bpy.types.Node) -> float:
    """Degrees that a Mapping before ``node`` turns its picture by, about the vertical."""
    links = node.inputs["Vector"].links
    if not links or links[0].from_node.type != "MAPPING":
        return 0.0
    x, y, z = links[0].from_node.inputs["Rotation"].default_value
    if abs(x) > 1e-3 or abs(y) > 1e-3:
        raise InputError(
            "The world's picture is tilted by its Mapping node; turn it about Z alone."
        )
    return math.degrees(z)
