"""A softbox of its own size: a rectangle in Blender, squares to a fit, the same light to both."""

from __future__ import annotations

import math

import numpy as np
import pytest

from addon.scene.test_stage import irradiance, white_card
from facestage.contract.errors import InputError
from facestage.contract.light_stage import fibonacci_stage, selected
from facestage_blender.scene.light_setups import direction
from facestage_blender.scene.softbox import squares


def lit(scene, **how: float):
    """A stage of five lights with a softbox in their place; the stage as a fit reads it."""
    import bpy

    from facestage_blender.scene.stage import build_stage, read_stage

    empty = build_stage(scene, fibonacci_stage(5, radiance=2.0))
    empty.location, empty.rotation_euler = (0.3, 0.1, 1.0), (0.2, 0.1, 0.7)
    bpy.context.view_layer.update()
    assert bpy.ops.facestage.softbox(**how) == {"FINISHED"}
    bpy.context.view_layer.update()
    return empty, read_stage(empty)


@pytest.mark.parametrize(
    ("width", "height", "count"),
    [(0.6, 0.6, (1, 1)), (0.6, 0.9, (2, 3)), (1.2, 0.3, (4, 1)), (0.2, 1.0, (1, 5))],
)
def test_a_fit_reads_squares_that_fill_the_softbox(scene, width, height, count) -> None:
    left, up, distance = 0.6, 0.4, 0.8
    _, stage = lit(scene, width=width, height=height, left=left, up=up, distance=distance)
    assert squares(width, height) == count
    tiles = selected(stage, np.arange(5, len(stage)))
    assert len(tiles) == count[0] * count[1] and not stage.radiance[:5].any()
    np.testing.assert_allclose(tiles.side, width / count[0], rtol=1e-5)
    assert (tiles.side**2).sum() == pytest.approx(width * height, rel=1e-5)
    outward = np.array(direction(math.degrees(left), math.degrees(up)))
    np.testing.assert_allclose(tiles.position.mean(axis=0), distance * outward, atol=1e-5)
    np.testing.assert_allclose(tiles.direction, -outward[None] + 0 * tiles.direction, atol=1e-5)
    corners = tiles.corners.reshape(-1, 3) - distance * outward
    across, along = corners @ tiles.axis_x[0], corners @ tiles.axis_y[0]
    assert np.ptp(across) == pytest.approx(width, rel=1e-4)
    assert np.ptp(along) == pytest.approx(height, rel=1e-4)
    assert tiles.axis_x[0, 1] == pytest.approx(0.0, abs=1e-6)  # its width is level


def test_any_shape_is_cut_into_few_squares() -> None:
    for width, height in np.random.default_rng(0).uniform(0.1, 2.0, (200, 2)):
        columns, rows = squares(width, height)
        assert columns * rows <= 24
        assert 0.8 < width / columns / (height / rows) < 1.25 or max(width, height) > 10 * min(
            width, height
        )


def test_cycles_shows_the_rectangle_as_bright_as_its_squares(scene) -> None:
    import bpy

    from facestage_blender.pictures.render import render_linear
    from facestage_blender.scene.stage import read_stage

    white_card(scene, fibonacci_stage(5, radiance=2.0), samples=1)
    how = {"width": 0.5, "height": 0.75, "left": 0.6, "up": 0.4, "distance": 0.9}
    assert bpy.ops.facestage.softbox(**how) == {"FINISHED"}
    stage = read_stage(scene.facestage.stage)
    each = [irradiance(selected(stage, np.array([index]))) for index in range(len(stage))]
    found = render_linear(scene, 256, direct_only=True)[..., :3].mean(axis=(0, 1))
    np.testing.assert_allclose(found, sum(each) / math.pi, rtol=0.01)


def test_it_is_as_bright_as_the_fitted_light(scene) -> None:
    _, stage = lit(scene, width=0.1, height=0.2, distance=1.5)
    tiles = selected(stage, np.arange(5, len(stage)))
    flux = (tiles.radiance.mean(axis=1) * tiles.side**2).sum() / 1.5**2
    assert flux == pytest.approx(5 * 2.0 * 0.2**2, rel=1e-3)


def test_the_size_is_what_the_light_has_by_now(scene) -> None:
    from facestage_blender.scene.softbox import softbox_of
    from facestage_blender.scene.stage import read_stage
    from reference.known import known

    empty, _ = lit(scene, width=0.6, height=0.6)
    softbox = known(softbox_of(empty))
    softbox.data.size_y, softbox.scale.x = 0.3, 2.0
    tiles = selected(read_stage(empty), np.arange(5, 9))
    np.testing.assert_allclose(tiles.side, 0.3, rtol=1e-5)  # four squares in 1.2 m
    softbox.data.shape = "DISK"
    with pytest.raises(InputError, match="no rectangular area light"):
        read_stage(empty)


def test_other_light_takes_its_place_and_a_stage_that_is_built_has_none(scene) -> None:
    import bpy

    from facestage_blender.scene.softbox import softbox_of
    from facestage_blender.scene.stage import build_stage, read_stage

    empty, stage = lit(scene, width=0.6, height=0.9)
    assert bpy.ops.facestage.softbox(width=0.5, height=0.5) == {"FINISHED"}
    assert len(read_stage(empty)) == 6  # one softbox, not two
    for other in (
        lambda: bpy.ops.facestage.relight(direction="fitted"),
        lambda: bpy.ops.facestage.relight(direction="loop"),
        lambda: bpy.ops.facestage.next_light(),
        lambda: build_stage(scene, stage),
    ):
        bpy.ops.facestage.softbox()
        assert softbox_of(empty) is not None
        other()
        assert softbox_of(empty) is None and "Facestage Softbox" not in bpy.data.lights
    assert len(read_stage(empty)) == len(stage)  # what a fit made of it


def test_it_is_in_nobodys_way(scene) -> None:
    from facestage_blender.scene.obstacles import obstacles

    lit(scene, width=0.6, height=0.9)
    assert not list(obstacles(scene))


def test_it_stands_where_the_head_turns_to(scene, head) -> None:
    import bpy

    from facestage_blender.rig.face_rig import build_rig

    empty, _ = lit(scene)
    rig = build_rig(scene, head, "default", empty)
    rig.rotation_euler.z = math.radians(30.0)  # to the picture's right
    bpy.context.view_layer.update()
    from facestage_blender.scene.stage import read_stage

    for follow, left in ((True, 15.0), (False, 45.0)):
        assert bpy.ops.facestage.softbox(follow_head=follow) == {"FINISHED"}
        x, _, z = read_stage(empty).position[5:].mean(axis=0)
        assert math.degrees(math.atan2(-x, z)) == pytest.approx(left, abs=0.1)
