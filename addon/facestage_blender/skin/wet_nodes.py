"""Geometry nodes that carry cornea and tears with a rig's eyeballs and lids, and their material."""

from __future__ import annotations

from typing import Any

import bpy

from facestage.contract.face_model import SKIN

from .lids import part_slots
from .material import empty_material, node_at
from .vector_nodes import BALL, RiggedVectors

GROUP = "Facestage Wet Eyes"
# Of each vertex, beside its root and eyeball: how far from the eyeball's centre it goes, over half
# the distance of the eyeball's pair; 0 on the shell, 1 on tears; of tears, how far up from the root
# and how far from the eyeball, metres.
NUMBERS = RADIUS, TEAR, RISE, LIFT = "radius", "tear", "rise", "lift"
SHADE = "facestage_lid_shade"  # of the shell: how much of the lids' shade lies there
ABOVE_M, ROOM_M = 0.00003, 0.004  # the shell over the eyeball, at least and at most
BEHIND_M = 0.0004  # lids may lie as far below the eyeball's surface
SHADE_M, SHADE_MOST = 0.0028, 0.35
INDEX, ROUGHNESS = 1.336, 0.03  # of water with salt; GGX alpha is its square
# Tears are finer than a picture shows: as rough as they are bent within a pixel, and brighter by
# the light that gathers in them.
TEAR_ROUGHNESS, TEAR_SHINE = 0.22, 0.06
SHADOW = (0.62, 0.42, 0.36)  # what the lids' shade leaves of light from the white


def wet_group(rig: bpy.types.Object) -> bpy.types.NodeTree:
    """New nodes that put shells over the eyeballs of ``rig`` as they look, and tears between them
    and the lids as they are.
    """
    build = RiggedVectors(GROUP, rig)
    root = build.root()
    first, other = (build.point_of(name) for name in BALL)
    centre = build.scaled(build.math("ADD", first, other), 0.5)
    half = build.number("MULTIPLY", build.math("DISTANCE", first, other), 0.5)
    away = build.math("SUBTRACT", root, centre)
    distance = build.math("LENGTH", away)
    goal = build.number("MULTIPLY", build.named(RADIUS, "FLOAT"), half)

    # On the shell: as far as it should be, and above the eyeball whatever became of that.
    above = build.number("MAXIMUM", goal, build.number("ADD", distance, ABOVE_M))
    above = build.number("MINIMUM", above, _below_lids(build, rig, root, away, distance))
    tear = build.named(TEAR, "FLOAT")
    lifted = build.number("ADD", goal, build.named(LIFT, "FLOAT"))
    on_lid = build.number("MULTIPLY", tear, build.number("ADD", lifted, 2 * ABOVE_M))
    on_ball = build.number("MULTIPLY", build.number("SUBTRACT", 1.0, tear), above)
    length = build.number("ADD", on_lid, on_ball)
    raised = build.math("ADD", away, build.joined(0.0, 0.0, build.named(RISE, "FLOAT")))
    place = build.math("ADD", centre, build.scaled(build.math("NORMALIZE", raised), length))
    placed = build.placed(build.given, place)
    build.tree.links.new(_shaded(build, placed, tear), build.result)
    return build.tree


def _below_lids(
    build: RiggedVectors, rig: bpy.types.Object, root: Any, away: Any, distance: Any
) -> Any:
    """How far from the eyeball's centre there is room under the lids; much where none are."""
    nodes, links = build.tree.nodes, build.tree.links
    skin = nodes.new("GeometryNodeSeparateGeometry")
    skin.domain = "FACE"
    links.new(build.geometry, skin.inputs["Geometry"])
    slot = nodes.new("GeometryNodeInputMaterialIndex").outputs[0]
    own = next(iter(part_slots(rig.data, SKIN)), -1)
    is_skin = build.number("COMPARE", slot, float(own), 0.5)
    links.new(is_skin, skin.inputs["Selection"])
    ray = nodes.new("GeometryNodeRaycast")
    links.new(skin.outputs["Selection"], ray.inputs["Target Geometry"])
    ahead = build.math("NORMALIZE", away)
    start = build.math("SUBTRACT", root, build.scaled(ahead, BEHIND_M))
    links.new(start, ray.inputs["Source Position"])
    links.new(ahead, ray.inputs["Ray Direction"])
    ray.inputs["Ray Length"].default_value = ROOM_M
    room = build.number("SUBTRACT", ray.outputs["Hit Distance"], BEHIND_M)
    room = build.number("MULTIPLY", room, 0.8)
    hit = ray.outputs["Is Hit"]
    free = build.number("MULTIPLY", build.number("SUBTRACT", 1.0, hit), ROOM_M)
    room = build.number("ADD", build.number("MULTIPLY", hit, room), free)
    return build.number("ADD", distance, build.number("MAXIMUM", room, ABOVE_M))


def _shaded(build: RiggedVectors, geometry: Any, is_tear: Any) -> Any:
    """The geometry with how near its vertices are to the lids, where the tears are."""
    nodes, links = build.tree.nodes, build.tree.links
    tears = nodes.new("GeometryNodeSeparateGeometry")
    links.new(geometry, tears.inputs["Geometry"])
    links.new(is_tear, tears.inputs["Selection"])
    near = nodes.new("GeometryNodeProximity")
    target = next(each for each in near.inputs if each.type == "GEOMETRY")
    links.new(tears.outputs["Selection"], target)
    share = build.number("DIVIDE", near.outputs["Distance"], SHADE_M)
    left = build.number("MAXIMUM", build.number("SUBTRACT", 1.0, share), 0.0)
    shade = build.number("MULTIPLY", build.number("MULTIPLY", left, left), SHADE_MOST)
    on_shell = build.number("MULTIPLY", shade, build.number("SUBTRACT", 1.0, is_tear))
    stored = nodes.new("GeometryNodeStoreNamedAttribute")
    stored.inputs["Name"].default_value = SHADE
    links.new(geometry, stored.inputs["Geometry"])
    value = next(each for each in stored.inputs if each.enabled and each.name == "Value")
    links.new(on_shell, value)
    return stored.outputs["Geometry"]


def wet_material(name: str, roughness: float = ROUGHNESS, shine: float = 0.0) -> bpy.types.Material:
    """Clear but for what water reflects, and ``shine`` more, and for the lids' shade."""
    material, nodes, links = empty_material(name)
    shade = node_at(nodes, "ShaderNodeAttribute", -700, 200)
    shade.attribute_name = SHADE
    tint = node_at(nodes, "ShaderNodeMix", -450, 200)
    tint.data_type = "RGBA"
    links.new(shade.outputs["Fac"], tint.inputs["Factor"])
    colors = [each for each in tint.inputs if each.type == "RGBA"]
    colors[0].default_value, colors[1].default_value = (1.0, 1.0, 1.0, 1.0), (*SHADOW, 1.0)
    clear = node_at(nodes, "ShaderNodeBsdfTransparent", -200, 200)
    color = next(each for each in tint.outputs if each.type == "RGBA")
    links.new(color, clear.inputs["Color"])
    gloss = node_at(nodes, "ShaderNodeBsdfGlossy", -200, 0)
    gloss.distribution = "GGX"
    gloss.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    gloss.inputs["Roughness"].default_value = roughness
    share = node_at(nodes, "ShaderNodeFresnel", -200, 400)
    share.inputs["IOR"].default_value = INDEX
    mix = node_at(nodes, "ShaderNodeMixShader", 50, 200)
    more = node_at(nodes, "ShaderNodeMath", -100, 400)
    more.inputs[1].default_value, more.use_clamp = shine, True
    links.new(share.outputs["Fac"], more.inputs[0])
    links.new(more.outputs[0], mix.inputs[0])
    links.new(clear.outputs["BSDF"], mix.inputs[1])
    links.new(gloss.outputs["BSDF"], mix.inputs[2])
    output = node_at(nodes, "ShaderNodeOutputMaterial", 300, 200)
    links.new(mix.outputs["Shader"], output.inputs["Surface"])
    # EEVEE: before Blender 4.2 under other names.
    if hasattr(material, "surface_render_method"):
        material.surface_render_method = "BLENDED"
    else:
        material.blend_method, material.shadow_method = "BLEND", "NONE"
    material.use_backface_culling = True
    material.diffuse_color = (1.0, 1.0, 1.0, 0.0)  # in Solid views, which know no shader
    return material
