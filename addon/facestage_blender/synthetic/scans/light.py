"""The light of a scan's photographs: pictures of whole surroundings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import bpy

from facestage.contract.environment import split_turn
from facestage.contract.errors import InputError

from ...pictures.images import load_image

SUFFIXES = (".exr", ".hdr")


@dataclass(frozen=True)
class Surroundings:
    """A picture of all directions, and by how many degrees it is turned about the vertical."""

    name: str
    file: Path
    turn: float


def shipped() -> dict[str, Path]:
    """The pictures of surroundings that Blender ships, by name."""
    folder = bpy.utils.system_resource("DATAFILES", path="studiolights/world")
    return {path.stem: path for path in sorted(Path(folder).glob("*.exr"))} if folder else {}


def read_surroundings(text: str) -> Surroundings:
    """What NAME or FILE, or either with @DEGREES behind it, says.

    Raises InputError.
    """
    given, turn = split_turn(text)
    known = shipped()
    if given in known:
        return Surroundings(given, known[given], turn)
    path = Path(given)
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"There is no light '{given}'; expected one of {', '.join(known)}, or a picture of "
            "all directions in an .exr or .hdr file."
        )
    return Surroundings(path.stem, path, turn)


def light_world(scene: bpy.types.Scene, light: Surroundings, *, vertical: str = "Y") -> None:
    """Let the surroundings light the scene, whose ``vertical`` is the camera's own Y, or Blender's
    Z. Raises InputError.
    """
    image = load_image(light.file)
    world = bpy.data.worlds.new("Surroundings")
    scene.world = world
    if world.node_tree is None:  # before Blender 5.0 a new world has no nodes
        world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    place = nodes.new("ShaderNodeTexCoord")
    turned = nodes.new("ShaderNodeMapping")
    # Pictures of surroundings have their vertical along z.
    upright = math.pi / 2 if vertical == "Y" else 0.0
    turned.inputs["Rotation"].default_value = (upright, 0.0, math.radians(light.turn))
    picture = nodes.new("ShaderNodeTexEnvironment")
    picture.image = image
    links.new(place.outputs["Generated"], turned.inputs["Vector"])
    links.new(turned.outputs["Vector"], picture.inputs["Vector"])
    links.new(picture.outputs["Color"], nodes["Background"].inputs["Color"])
