"""The shade of the lid: how deep it is, and where it lies on eyes that look elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.textures.eyes.eye_picture import EyePlane, eye_picture
from facestage.fit.textures.eyes.lid_shade import DEEPEST, USUAL, LidShade, faded, shade_depth
from facestage.models.anatomy.regions import IRIS_RADIUS
from reference.painted_face import PaintedFace, painted_face


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=64)


def with_expression(face: PaintedFace, **weights: float):
    names = face.forward.geometry.model.expression_names
    return replace(face.state, expression=np.array([weights.get(name, 0.0) for name in names]))


def test_a_known_depth_is_found():
    rng = np.random.default_rng(2)
    below = rng.uniform(0, 1.2, 400)
    for true in (0.3, 2.0):
        darker = true * np.exp(-below / 0.25) + 0.2 * rng.normal(size=400)
        found = shade_depth(darker, below)
        print("depth", found, "true", true)
        assert abs(found - true) < 0.2
    assert shade_depth(np.zeros(0), np.zeros(0)) == pytest.approx(USUAL)
    assert shade_depth(np.full(400, 9.0), np.zeros(400)) == DEEPEST
    assert shade_depth(np.full(400, -9.0), np.zeros(400)) == 0.0


def test_the_border_is_that_of_the_upper_lid(face: PaintedFace):
    geometry = face.forward.geometry
    shade = LidShade.of(geometry, face.state, 1.5)
    assert shade is not None
    for side, border in enumerate(shade.borders):
        assert (np.diff(border[:, 0]) > 0).all()
        middle = np.interp(0.0, *border.T)
        assert 0.002 < middle < 0.007  # above the pupil, about where the iris ends
        at = np.array([[0.0, middle], [0.0, middle - 0.25 * IRIS_RADIUS], [0.0, -0.01]])
        np.testing.assert_allclose(
            shade.log_change(at, side), -1.5 * np.exp([0.0, -1.0, -40.0]), atol=0.01
        )


def test_lids_that_sink_and_eyes_that_turn_move_it(face: PaintedFace):
    geometry = face.forward.geometry

    def middle(**weights: float) -> np.ndarray:
        shade = LidShade.of(geometry, with_expression(face, **weights), 1.0)
        assert shade is not None
        return np.array([np.interp(0.0, *border.T) for border in shade.borders])

    rest = middle()
    assert (middle(eyeBlinkLeft=0.5, eyeBlinkRight=0.5) < rest - 0.0015).all()
    # The left eye alone.
    one = middle(eyeBlinkLeft=0.5) - rest
    assert one[0] < -0.0015 and abs(one[1]) < 1e-4
    # The lids follow the gaze, not wholly: an eye that looks down shows more above its middle.
    down = middle(eyeLookDownLeft=1.0, eyeLookDownRight=1.0) - rest
    print("border, of eyes that look down", down)
    assert (np.abs(down) < 0.003).all()


def test_the_picture_is_dark_below_the_lid(face: PaintedFace):
    geometry = face.forward.geometry
    plain = eye_picture(geometry, geometry.log_albedo)
    shaded = eye_picture(geometry, geometry.log_albedo, LidShade.of(geometry, face.state, 1.5))
    assert plain is not None and shaded is not None
    share = shaded / plain
    assert share.max() <= 1.0 + 1e-6
    assert share.min() < 1.05 * np.exp(-1.5)
    # Far below the lid. Beside the eyes the picture has what lies nearest, be it shaded or not.
    assert (share > 0.95).mean() > 0.2


def test_models_without_lids_have_no_shade(face: PaintedFace):
    geometry = face.forward.geometry
    model = replace(geometry.model, landmarks={"ibug68": geometry.model.landmarks["ibug68"]})
    assert LidShade.of(FaceGeometry(model), face.state, 1.0) is None
    assert EyePlane.of(geometry) is not None
    assert faded(np.array([-1.0, 0.0])).tolist() == [1.0, 1.0]
