"""The light stage in the scene: radiance in Cycles, geometry, states, rebuilding."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.light_stage import FROZEN, OFF, ON, LightStage, fibonacci_stage

FIELDS = ("position", "direction", "axis_x", "side", "radiance", "state")


def one_light(
    position: tuple[float, float, float], side: float, radiance: tuple[float, float, float]
) -> LightStage:
    outward = np.array(position) / np.linalg.norm(position)
    axis = np.cross([0.0, 1.0, 0.0], outward)
    return LightStage(
        position=np.array([position]),
        direction=-outward[None],
        axis_x=axis[None] / np.linalg.norm(axis),
        side=np.array([side]),
        radiance=np.array([radiance]),
        state=np.array([ON]),
    )


def some_stage() -> LightStage:
    stage = fibonacci_stage(7, radius=1.3, side=0.31)
    radiance = np.random.default_rng(5).uniform(0, 20, (7, 3))
    state = np.array([ON, OFF, FROZEN, ON, ON, OFF, ON])
    return replace(stage, state=state).with_radiance(radiance)


def assert_same(found: LightStage, expected: LightStage) -> None:
    for name in FIELDS:
        np.testing.assert_allclose(
            getattr(found, name), getattr(expected, name), atol=2e-6, err_msg=name
        )


def white_card(scene, light: LightStage, samples: int = 256) -> np.ndarray:
    """(3,) radiance of a white diffuse card at the stage's origin that faces +Z of the stage, from
    Cycles.
    """
    import bpy

    from facestage_blender.pictures.render import render_linear
    from facestage_blender.scene.camera import set_resolution
    from facestage_blender.scene.stage import build_stage

    build_stage(scene, light)
    mesh = bpy.data.meshes.new("card")
    half = 0.002
    mesh.from_pydata(
        [(-half, 0, -half), (half, 0, -half), (half, 0, half), (-half, 0, half)], [], [(0, 1, 2, 3)]
    )
    material = bpy.data.materials.new("white")
    if material.node_tree is None:
        material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    diffuse, output = nodes.new("ShaderNodeBsdfDiffuse"), nodes.new("ShaderNodeOutputMaterial")
    diffuse.inputs["Color"].default_value = (1, 1, 1, 1)
    material.node_tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("card", mesh))
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)
    scene.camera.location, scene.camera.rotation_euler = (0, -0.3, 0), (math.pi / 2, 0, 0)
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", half
    set_resolution(scene, 8, 8)
    return render_linear(scene, samples, direct_only=True)[..., :3].mean(axis=(0, 1))


def irradiance(light: LightStage, grid: int = 400) -> np.ndarray:
    """(3,) irradiance at the origin on a surface facing +Z, by summing small pieces of the
    light.
    """
    steps = (np.arange(grid) + 0.5) / grid - 0.5
    a, b = np.meshgrid(steps, steps)
    points = light.position[0] + light.side[0] * (
        a[..., None] * light.axis_x[0] + b[..., None] * light.axis_y[0]
    )
    distance = np.linalg.norm(points, axis=-1)
    towards = points / distance[..., None]
    form = (
        np.maximum(towards[..., 2], 0)
        * np.maximum(-(towards @ light.direction[0]), 0)
        / distance**2
    )
    return light.radiance[0] * form.mean() * light.side[0] ** 2


@pytest.mark.parametrize(
    ("position", "side"),
    [
        ((0.0, 0.0, 1.0), 0.2),
        ((0.6, 0.5, 0.6), 0.2),
        ((-0.2, 0.1, 0.4), 0.5),
        ((0.9, 0.0, 0.2), 0.1),
    ],
)
def test_radiance_of_a_light_on_a_white_card(scene, position, side) -> None:
    light = one_light(position, side, (7.0, 3.0, 0.5))
    expected = irradiance(light) / math.pi
    found = white_card(scene, light)
    print(
        f"white card: {found} against {expected}, off by {np.abs(found / expected - 1).max():.2%} "
        "of at most 1 %"
    )
    np.testing.assert_allclose(found, expected, rtol=0.01)


def test_a_light_is_dark_from_behind_and_when_off(scene) -> None:
    light = one_light((0.0, 0.0, 1.0), 0.2, (5.0, 5.0, 5.0))
    away = replace(light, direction=-light.direction)
    assert white_card(scene, away, samples=4).max() == 0.0
    off = replace(light, state=np.array([OFF]))
    assert white_card(scene, off, samples=4).max() == 0.0


def test_stage_survives_the_scene(scene) -> None:
    from facestage_blender.scene.stage import build_stage, read_stage, require_stage

    expected = some_stage()
    build_stage(scene, expected)
    assert_same(read_stage(require_stage(scene)), expected)


def test_stage_is_read_relative_to_its_empty(scene) -> None:
    from facestage_blender.scene.stage import build_stage, read_stage, require_stage

    empty = build_stage(scene, some_stage())
    empty.location, empty.rotation_euler = (3.0, -2.0, 1.0), (0.3, -0.5, 2.0)
    assert_same(read_stage(require_stage(scene)), some_stage())


def test_rebuilding_reuses_and_removes_lights(scene) -> None:
    import bpy

    from facestage_blender.scene.stage import build_stage, default_stage, stage_lights

    empty = build_stage(scene, default_stage(20, 1.0, 0.2))
    first = stage_lights(empty)[0]
    assert build_stage(scene, default_stage(5, 1.0, 0.2)) == empty
    assert stage_lights(empty)[0] == first
    assert len(stage_lights(empty)) == len(bpy.data.lights) == 5
    build_stage(scene, default_stage(20, 1.0, 0.2))
    build_stage(scene, default_stage(20, 1.0, 0.2))
    assert len(bpy.data.lights) == 20
    assert len([item for item in bpy.data.objects if item.type == "EMPTY"]) == 1
    assert all(not light.visible_camera for light in stage_lights(empty))


def test_off_keeps_the_power_for_later(scene) -> None:
    from facestage_blender.scene.stage import build_stage, read_stage, require_stage, stage_lights

    build_stage(scene, fibonacci_stage(3, radiance=4.0))
    light = stage_lights(scene.facestage.stage)[1]
    light.facestage_light.state = "OFF"
    assert light.hide_render
    stage = read_stage(require_stage(scene))
    assert stage.radiance[1].max() == 0.0
    assert stage.state[1] == OFF
    light.facestage_light.state = "FROZEN"
    assert not light.hide_render
    np.testing.assert_allclose(read_stage(require_stage(scene)).radiance[1], 4.0, rtol=1e-5)


def test_what_cannot_be_read_is_refused(scene) -> None:
    from facestage_blender.scene.stage import build_stage, read_stage, require_stage, stage_lights

    with pytest.raises(InputError, match="Build Light Stage"):
        require_stage(scene)
    empty = build_stage(scene, fibonacci_stage(3))
    stage_lights(empty)[0].data.shape = "DISK"
    with pytest.raises(InputError, match="square"):
        read_stage(empty)
    empty.scale = (2, 2, 2)
    with pytest.raises(InputError, match="scale"):
        require_stage(scene)


def test_relight_comes_from_that_side_and_goes_back(scene) -> None:
    from facestage_blender.scene.relight import relight, restore_lights
    from facestage_blender.scene.stage import build_stage, read_stage, require_stage

    before = some_stage()
    before = replace(before, state=np.zeros(7, int)).with_radiance(before.radiance)
    empty = build_stage(scene, before)
    relight(scene, "left")
    lit = read_stage(require_stage(scene))
    weight = lit.radiance.mean(axis=1)
    assert weight @ lit.position[:, 0] / weight.sum() < -0.5
    assert weight.sum() == pytest.approx(before.radiance.mean(axis=1).sum(), rel=1e-4)
    restore_lights(scene)
    assert_same(read_stage(empty), before)
    with pytest.raises(InputError, match="below"):
        relight(scene, "below")


def test_relight_leaves_off_and_frozen_lights_what_they_are(scene) -> None:
    from facestage_blender.scene.relight import relight, restore_lights
    from facestage_blender.scene.stage import build_stage, read_stage, stage_lights

    before = some_stage()
    empty = build_stage(scene, before)
    kept = [light.data.energy for light in stage_lights(empty)]
    for direction in ("left", "right", "top"):
        relight(scene, direction)
        lit = read_stage(empty)
        assert lit.state.tolist() == before.state.tolist()
        assert lit.radiance.sum() > 0 and not lit.radiance[before.state == OFF].any()
    restore_lights(scene)
    assert_same(read_stage(empty), read_stage(build_stage(scene, before)))
    assert [light.data.energy for light in stage_lights(empty)] == pytest.approx(kept)


def test_eevee_leaves_out_no_lamp_of_the_stage(scene) -> None:
    from facestage_blender.scene.stage import build_stage

    assert scene.eevee.light_threshold == pytest.approx(0.01)  # black: the lamps have half a watt
    build_stage(scene, some_stage())
    assert scene.eevee.light_threshold <= 1e-5
    scene.eevee.light_threshold = 0.0
    build_stage(scene, some_stage())
    assert scene.eevee.light_threshold == 0.0


def test_relight_without_a_light_that_is_on_says_so(scene) -> None:
    from facestage_blender.scene.relight import relight
    from facestage_blender.scene.stage import build_stage

    build_stage(scene, replace(some_stage(), state=np.full(7, OFF)))
    with pytest.raises(InputError, match="are off; turn one on"):
        relight(scene, "left")
