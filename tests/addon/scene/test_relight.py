"""Light that has a name, and one light at a time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from facestage.contract.light_stage import fibonacci_stage, joined
from facestage_blender.scene.light_setups import LIGHT_FROM, SETUPS

# Where the light has to come from: by the mean direction of what comes from the front.
WANTED: dict[str, Callable[[np.ndarray], bool]] = {
    "key_fill_rim": lambda mean: mean[0] < -0.15 and mean[1] > 0.1,
    "butterfly": lambda mean: abs(mean[0]) < 0.1 and mean[1] > 0.25 and mean[2] > 0.5,
    "loop": lambda mean: -0.6 < mean[0] < -0.2 and mean[1] > 0.25,
    "rembrandt": lambda mean: mean[0] < -0.4 and mean[1] > 0.4,
    "split": lambda mean: mean[0] < -0.8 and abs(mean[1]) < 0.25,
}


def radiance_of(scene) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) radiance, and (N, 3) where each light stands, as unit vectors."""
    from facestage_blender.scene.stage import read_stage, require_stage

    stage = read_stage(require_stage(scene))
    return stage.radiance, -stage.direction


@pytest.mark.parametrize("name", SETUPS)
def test_a_setup_lights_from_where_it_is_known_for(scene, name: str) -> None:
    from facestage_blender.scene.relight import relight
    from facestage_blender.scene.stage import build_stage

    front = fibonacci_stage(30, radiance=2.0)
    build_stage(scene, joined(front, fibonacci_stage(10, radiance=0.0, behind=True)))
    assert sum(beam.share for beam in SETUPS[name].beams) == pytest.approx(1.0)
    relight(scene, name)
    radiance, outward = radiance_of(scene)
    level = radiance.mean(axis=1)
    assert level.sum() == pytest.approx(60.0, rel=1e-4)
    seen = np.where(outward[:, 2] > -0.3, level, 0.0)
    mean = seen @ outward / seen.sum()
    print(name, mean)
    assert WANTED[name](mean)
    relight(scene, name, mirrored=True)
    other, _ = radiance_of(scene)
    level = np.where(outward[:, 2] > -0.3, other.mean(axis=1), 0.0)
    np.testing.assert_allclose(level @ outward[:, 0] / level.sum(), -mean[0], atol=0.15)


@pytest.mark.parametrize("name", SETUPS)
@pytest.mark.parametrize("degrees", [-40.0, 25.0])
def test_the_light_of_a_turned_head_is_turned_with_it(name: str, degrees: float) -> None:
    """The key is as far from where the face looks as it is from the camera without a turn."""
    yaw = np.radians(degrees)
    gaze = np.array([np.sin(yaw), 0.0, np.cos(yaw)])  # to the picture's right
    for plain, turned in zip(SETUPS[name].beams, SETUPS[name].before(yaw).beams, strict=True):
        before, after = np.array(plain.towards), np.array(turned.towards)
        assert after @ gaze == pytest.approx(before[2])
        assert after[1] == before[1] and np.linalg.norm(after) == pytest.approx(1.0)
        assert after @ np.cross([0, 1, 0], gaze) == pytest.approx(before[0])  # the same side
        assert (turned.share, turned.sharpness) == (plain.share, plain.sharpness)


@pytest.mark.parametrize("degrees", [-40.0, 0.0, 40.0])
def test_portrait_light_follows_the_head_unless_told_not_to(scene, head, degrees: float) -> None:
    import bpy

    from facestage_blender.rig.face_rig import build_rig, head_yaw
    from facestage_blender.scene.stage import build_stage

    stage = joined(fibonacci_stage(60, radiance=1.0), fibonacci_stage(60, behind=True))
    empty = build_stage(scene, stage)
    empty.rotation_euler = (0.3, 0.1, 1.0)  # the stage's own turn says nothing of the head's
    rig = build_rig(scene, head, "default", empty)
    rig.rotation_euler.z = np.radians(degrees)
    bpy.context.view_layer.update()
    assert head_yaw(scene) == pytest.approx(np.radians(degrees))

    def key(**how: object) -> float:
        """Degrees to the picture's right that the light comes from."""
        assert bpy.ops.facestage.relight(**how) == {"FINISHED"}
        radiance, outward = radiance_of(scene)
        x, _, z = radiance.mean(axis=1) @ outward
        return float(np.degrees(np.arctan2(x, z)))

    plain = key(direction="loop", follow_head=False)
    assert key(direction="loop") - plain == pytest.approx(degrees, abs=3.0)
    assert key(direction="left") == pytest.approx(key(direction="left", follow_head=False))


def test_a_rim_is_behind_where_there_are_lights(scene) -> None:
    from facestage_blender.scene.relight import relight
    from facestage_blender.scene.stage import build_stage

    front, behind = fibonacci_stage(20, radiance=2.0), fibonacci_stage(20, behind=True)
    for stage, share in ((joined(front, behind), 0.2), (front, 0.0)):
        build_stage(scene, stage)
        relight(scene, "key_fill_rim")
        radiance, outward = radiance_of(scene)
        level = radiance.mean(axis=1)
        rim = level[outward[:, 2] < -0.3].sum() / level.sum()
        assert rim == pytest.approx(share, abs=0.05)


def test_lights_shine_alone_one_after_the_other(scene) -> None:
    import bpy

    from facestage_blender.scene.stage import build_stage, require_stage, stage_lights

    stage = fibonacci_stage(4, radiance=1.0)
    stage = stage.with_radiance(np.array([[3.0, 2, 1], [1, 1, 1], [0, 0, 0], [0.5, 0.5, 1]]))
    build_stage(scene, stage)
    stage_lights(require_stage(scene))[1].facestage_light.state = "OFF"
    before = radiance_of(scene)[0]
    seen = []
    for _ in range(4):
        assert bpy.ops.facestage.next_light() == {"FINISHED"}
        radiance = radiance_of(scene)[0]
        assert (radiance.sum(axis=1) > 0).sum() == 1
        seen.append(int(radiance.sum(axis=1).argmax()))
        assert radiance.mean(axis=1).sum() == pytest.approx(11 / 3, rel=1e-4)
    assert seen == [0, 2, 3, 0]
    np.testing.assert_allclose(radiance[0] / radiance[0, 0], [1, 2 / 3, 1 / 3], rtol=1e-5)
    assert bpy.ops.facestage.relight(direction="fitted") == {"FINISHED"}
    np.testing.assert_allclose(radiance_of(scene)[0], before, rtol=1e-5)
    assert stage_lights(require_stage(scene))[1].facestage_light.state == "OFF"


def test_every_name_has_its_words() -> None:
    assert all(setup.label and setup.help for setup in LIGHT_FROM.values())
    assert len({setup.label for setup in LIGHT_FROM.values()}) == len(LIGHT_FROM)
