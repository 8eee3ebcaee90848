"""Colors of irises, eyeballs and teeth from a picture of known ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.face_model import EYES, TEETH
from facestage.contract.light_stage import LightStage
from facestage.fit.face.state import State
from facestage.fit.forward.reflectance import (
    EYE_ROUGHNESS,
    EYE_SPECULAR,
    WET_ROUGHNESS,
    WET_SPECULAR,
)
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.eyes_seen import EyesSeen
from facestage.fit.textures.eyes.eye_picture import eye_picture
from facestage.fit.textures.eyes.lid_shade import faded
from facestage.fit.textures.eyes.part_color import (
    BROWNEST,
    HIDDEN_MAX,
    HIDDEN_MAX_SURELY,
    Look,
    parts_of,
)
from facestage.fit.textures.eyes.part_color import part_colors as found_colors
from reference.painted_face import SIDE, PaintedFace, painted_face

BLUE = np.array([0.05, 0.09, 0.14])


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=64, key_side=0.3)


@pytest.fixture(scope="module")
def smiling(face: PaintedFace) -> State:
    names = face.forward.geometry.model.expression_names
    weights = {
        "jawOpen": 0.25,
        "mouthUpperUpLeft": 0.8,
        "mouthUpperUpRight": 0.8,
        "mouthLowerDownLeft": 0.8,
    }
    close = replace(face.state.camera, focal_px=900.0)
    return replace(
        face.state, camera=close, expression=np.array([weights.get(name, 0.0) for name in names])
    )


def picture(face: PaintedFace, state: State, log_change: np.ndarray) -> Look:
    """The face with ``log_change`` (m, 3) added to its vertices' log albedo."""
    y, x = np.mgrid[:SIDE, :SIDE]
    surface = face.forward.surface(state, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5)
    eye = face.forward.geometry.triangle_part[surface.triangle] == EYES
    rough = np.where(eye, EYE_ROUGHNESS, WET_ROUGHNESS)
    terms = face.forward.light_terms(state, surface, face.stage, 16, 5, roughness=rough)
    logs = (face.forward.log_albedo(state) + log_change)[surface.corners]
    albedo = np.exp(np.einsum("pi,pic->pc", surface.weights, logs))
    image = face.forward.shade(
        state, surface, terms, albedo, c_spec=np.where(eye, EYE_SPECULAR, WET_SPECULAR)
    )
    column, row = surface.pixels.astype(int).T
    color, skin = np.zeros((SIDE, SIDE, 3)), np.zeros((SIDE, SIDE))
    color[row, column] = image.color
    skin[row, column] = face.forward.geometry.fitted[surface.triangle]
    return Look(color, np.ones((SIDE, SIDE), bool), skin)


def part_colors(forward: ForwardModel, state: State, stage: LightStage, look: Look) -> np.ndarray:
    """(m, 3) what to add to the vertices' log albedo."""
    return found_colors(forward, state, stage, look).log_change


def by_name(face: PaintedFace, values: np.ndarray, name: str) -> np.ndarray:
    part = next(part for part in parts_of(face.forward.geometry) if part.name == name)
    return values[part.vertices]


def blue_eyes(face: PaintedFace, state: State) -> Look:
    """The face with BLUE irises."""
    geometry = face.forward.geometry
    iris = next(part for part in parts_of(geometry) if part.name == "iris").vertices
    change = np.zeros_like(geometry.log_albedo)
    change[iris] = np.log(BLUE) - geometry.log_albedo[iris]
    return picture(face, state, change)


def test_blue_eyes_are_found(face: PaintedFace, smiling: State):
    geometry = face.forward.geometry
    change = np.zeros_like(geometry.log_albedo)
    iris = next(part for part in parts_of(geometry) if part.name == "iris").vertices
    change[iris] = np.log(BLUE) - geometry.log_albedo[iris].mean(axis=0)
    found = by_name(
        face, part_colors(face.forward, smiling, face.stage, picture(face, smiling, change)), "iris"
    )[0]
    print("log change of the iris", found.round(2), "true", change[iris][0].round(2))
    # 0.05 where the highlight is taken for that of a dry eye
    assert np.abs(found - change[iris][0]).mean() < 0.035
    assert found[2] > found[0] + 0.5


def test_the_picture_of_the_eyes_is_blue_too(face: PaintedFace, smiling: State):
    geometry = face.forward.geometry
    iris = next(part for part in parts_of(geometry) if part.name == "iris").vertices
    change = np.zeros_like(geometry.log_albedo)
    change[iris] = np.log(BLUE) - geometry.log_albedo[iris]
    found = part_colors(face.forward, smiling, face.stage, picture(face, smiling, change))
    drawn = eye_picture(geometry, geometry.log_albedo + found)
    assert drawn is not None
    blue = drawn[drawn[..., 2] > 1.3 * drawn[..., 0]]
    error = np.abs(np.log(np.median(blue, axis=0) / BLUE))
    print("log error of the drawn iris", error.round(2), "of", len(blue), "texels")
    assert len(blue) > 10_000
    assert error.max() < 0.25


def test_teeth_keep_to_what_teeth_can_be(face: PaintedFace, smiling: State):
    geometry = face.forward.geometry
    change = np.zeros_like(geometry.log_albedo)
    teeth = next(part for part in parts_of(geometry) if part.name == "teeth").vertices
    change[teeth] = [-0.1, -0.1, -1.5]
    found = by_name(
        face,
        part_colors(face.forward, smiling, face.stage, picture(face, smiling, change)),
        "teeth",
    )[0]
    assert -0.7 < found[2] - found[0] < -0.1


def test_teeth_keep_their_color_in_a_shadow_that_the_photo_lacks(face: PaintedFace, smiling: State):
    """Lips of a fitted face keep light from them: they seem lighter than white, and are not white
    for that; nor are those beside skin that is as grey as they.
    """
    geometry = face.forward.geometry
    crown = next(part for part in parts_of(geometry) if part.name == "teeth").vertices
    yellow = np.array([0.15, 0.0, -0.15])
    for lighter in (0.0, 1.5):
        change = np.zeros_like(geometry.log_albedo)
        change[crown] = yellow + lighter
        look = picture(face, smiling, change)
        grey = look.color.mean(axis=2, keepdims=True) * [1.0, 0.95, 0.9]
        skin = look.skin[..., None] > 0.5
        for seen in (look, replace(look, color=np.where(skin, 0.3 * grey, look.color))):
            found = by_name(face, part_colors(face.forward, smiling, face.stage, seen), "teeth")
            hue = np.median(found[:, 0] - found[:, 2])
            print(f"{lighter} lighter: red over blue {hue:.2f}")
            assert hue == pytest.approx(0.3, abs=0.12)


def test_white_teeth_are_found_and_gums_stay(face: PaintedFace, smiling: State):
    """Teeth as light as the photo shows them: before, a seventh of the way."""
    geometry = face.forward.geometry
    change = np.zeros_like(geometry.log_albedo)
    change[geometry.triangles[geometry.triangle_part == TEETH]] = 0.3
    found = part_colors(face.forward, smiling, face.stage, picture(face, smiling, change))
    teeth = by_name(face, found, "teeth")
    print("log change of the teeth", np.quantile(teeth, (0.1, 0.5, 0.9)).round(2))
    assert np.median(teeth) == pytest.approx(0.3, abs=0.08)
    crown = next(part for part in parts_of(geometry) if part.name == "teeth").vertices
    gums = np.unique(geometry.triangles[geometry.triangle_part == TEETH])
    gums = gums[~crown[gums]]
    assert len(gums) > 100 and not found[gums].any()


def test_the_lips_shadow_is_taken_off_the_teeth(face: PaintedFace, smiling: State):
    """One side of the teeth is darker in the photo than light on the mesh says; of the lower teeth
    lips hide most, so that they say little of it.
    """
    geometry = face.forward.geometry
    change = np.zeros_like(geometry.log_albedo)
    crown = next(part for part in parts_of(geometry) if part.name == "teeth").vertices
    left = geometry.mean[:, 0] > 0.008
    change[crown & left] = -0.3
    found = part_colors(face.forward, smiling, face.stage, picture(face, smiling, change))
    y, x = np.mgrid[:SIDE, :SIDE]
    surface = face.forward.surface(smiling, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5)
    shown = np.bincount(surface.corners.ravel(), minlength=len(left)) >= 8
    sides = [np.median(found[crown & shown & side]) for side in (left, ~left)]
    print("left and right", np.round(sides, 2))
    assert sides[1] - sides[0] == pytest.approx(0.3, abs=0.13)


def test_the_model_s_own_colors_stay(face: PaintedFace, smiling: State):
    change = np.zeros_like(face.forward.geometry.log_albedo)
    found = part_colors(face.forward, smiling, face.stage, picture(face, smiling, change))
    assert np.abs(found).max() < 0.35


def test_lids_and_lashes_do_not_darken_the_whites(face: PaintedFace, smiling: State):
    # Of a photo's eyes half and more is lid, lash or shadow where the mesh has the white.
    geometry = face.forward.geometry
    look = picture(face, smiling, np.zeros_like(geometry.log_albedo))
    shade = np.where(np.random.default_rng(0).random((SIDE, SIDE, 1)) < 0.55, 0.2, 1.0)
    found = part_colors(face.forward, smiling, face.stage, replace(look, color=look.color * shade))
    white = by_name(face, found, "white")[0]
    print("log change of the whites", white.round(2))
    assert np.abs(white).max() < 0.15  # the median of all: -0.8


def test_flesh_beside_the_whites_goes_with_them(face: PaintedFace, smiling: State):
    geometry = face.forward.geometry
    change = np.zeros_like(geometry.log_albedo)
    white = next(part for part in parts_of(geometry) if part.name == "white").vertices
    change[white] = -0.4
    found = part_colors(face.forward, smiling, face.stage, picture(face, smiling, change))
    flesh = geometry.new_index[geometry.model.regions["eye_corners"]]
    assert found[white].max() < -0.1
    np.testing.assert_array_equal(found[flesh], np.broadcast_to(found[white][0], (len(flesh), 3)))


def test_no_iris_is_purple(face: PaintedFace, smiling: State):
    geometry = face.forward.geometry
    iris = next(part for part in parts_of(geometry) if part.name == "iris").vertices
    change = np.zeros_like(geometry.log_albedo)
    change[iris] = np.log([0.06, 0.02, 0.06]) - geometry.log_albedo[iris].mean(axis=0)
    found = part_colors(face.forward, smiling, face.stage, picture(face, smiling, change))
    color = geometry.log_albedo[iris].mean(axis=0) + by_name(face, found, "iris")[0]
    print("iris", np.exp(color).round(3))
    assert color[1] > min(color[0], color[2]) - 0.2  # as seen: -1.1


def test_closed_and_masked_eyes_are_not_painted(face: PaintedFace, smiling: State):
    geometry = face.forward.geometry
    skin = np.zeros_like(geometry.log_albedo)
    eyes = [part.vertices for part in parts_of(geometry) if part.name != "teeth"]
    for vertices in eyes:
        skin[vertices] = np.log([0.5, 0.3, 0.22]) - geometry.log_albedo[vertices]
    look = picture(face, smiling, skin)
    assert not by_name(face, part_colors(face.forward, smiling, face.stage, look), "iris").any()
    masked = replace(look, usable=np.zeros((SIDE, SIDE), bool))
    assert not part_colors(face.forward, smiling, face.stage, masked).any()


def test_dark_glasses_are_not_the_color_of_eyes(face: PaintedFace, smiling: State):
    """Where much around the eyes is hidden, what shows between is not theirs."""
    look = blue_eyes(face, smiling)
    rows, columns = face.forward.box(smiling, face.forward.geometry.triangle_part == EYES)
    usable = look.usable.copy()
    usable[rows, columns] &= look.skin[rows, columns] < 0.5
    hidden = replace(look, usable=usable)
    blue, none = (
        by_name(face, part_colors(face.forward, smiling, face.stage, each), "iris")
        for each in (look, hidden)
    )
    assert blue.any() and not none.any()


def test_irises_that_no_photo_shows_are_dark_in_dark_faces(face: PaintedFace, smiling: State):
    geometry = face.forward.geometry
    black = Look(np.zeros((SIDE, SIDE, 3)), np.zeros((SIDE, SIDE), bool), np.zeros((SIDE, SIDE)))

    def iris(darker: float) -> np.ndarray:
        """Luminance of the irises of somebody whose skin is so much darker, of the logarithm."""
        basis = geometry.albedo_basis[:3, geometry.fitted_vertices].mean(axis=2)
        tones = np.linalg.lstsq(basis.T, np.full(basis.shape[1], -darker), rcond=None)[0]
        albedo = np.zeros_like(smiling.albedo)
        albedo[:3] = tones
        found = found_colors(face.forward, replace(smiling, albedo=albedo), face.stage, black)
        assert not found.told
        logs = by_name(face, geometry.log_albedo + found.log_change, "iris")
        return np.median(np.exp(logs) @ [0.2126, 0.7152, 0.0722])

    model = iris(0.0)
    assert iris(-0.6) == iris(0.15) == model
    assert model > 1.1 * iris(0.5) > 1.2 * iris(0.9)
    assert iris(1.5) == pytest.approx(iris(2.5)) == pytest.approx(0.03, rel=0.05)


def test_eyes_between_painted_lids_are_found(face: PaintedFace, smiling: State):
    """Half of what surrounds them is hidden, and landmarks find their own pixels."""
    look = blue_eyes(face, smiling)
    rows, columns = face.forward.box(smiling, face.forward.geometry.triangle_part == EYES)
    skin = np.argwhere(look.skin[rows, columns] > 0.5) + np.array([rows.start, columns.start])
    usable = look.usable.copy()
    usable[tuple(skin[::2].T)] = False
    share = 1 - usable[rows, columns].mean()
    assert HIDDEN_MAX < share < HIDDEN_MAX_SURELY
    hidden = replace(look, usable=usable)
    none, blue = (
        by_name(face, part_colors(face.forward, smiling, face.stage, each), "iris")
        for each in (hidden, replace(hidden, eyes=seen_eyes(face, smiling)))
    )
    assert blue.any() and not none.any()


def seen_eyes(face: PaintedFace, state: State) -> EyesSeen:
    """What landmarks would know of the eyes: all that shows of them, each from its own top on."""
    y, x = np.mgrid[:SIDE, :SIDE]
    surface = face.forward.surface(state, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5)
    column, row = surface.pixels.astype(int).T
    iris, white, eye = np.zeros((3, SIDE, SIDE), bool)
    for part in parts_of(face.forward.geometry):
        for name, mask in (("iris", iris), ("white", white)):
            if part.name == name:
                mask[row, column] = part.vertices[surface.corners].all(axis=1)
    eye[row, column] = face.forward.geometry.triangle_part[surface.triangle] == EYES
    top = np.where(eye.any(axis=0), eye.argmax(axis=0), 0)
    radius = 0.5 * np.ptp(np.nonzero(iris[:, : SIDE // 2])[1])
    return EyesSeen(iris, white, np.where(eye, (y - top) / radius, np.nan))


def test_lids_over_the_fitted_iris_are_left_out(face: PaintedFace, smiling: State):
    """Where a fit lies too low, half of its iris is lid in the photo; landmarks know better."""
    geometry = face.forward.geometry
    iris = next(part for part in parts_of(geometry) if part.name == "iris").vertices
    change = np.zeros_like(geometry.log_albedo)
    change[iris] = np.log([0.025, 0.016, 0.011]) - geometry.log_albedo[iris]
    look, seen = picture(face, smiling, change), seen_eyes(face, smiling)
    lid = seen.iris & (seen.below_lid > np.median(seen.below_lid[seen.iris]))
    look = replace(look, color=np.where(lid[..., None], [0.3, 0.2, 0.15], look.color))
    errors = {
        name: np.abs(
            by_name(face, part_colors(face.forward, smiling, face.stage, each), "iris")[0]
            - change[iris].mean(axis=0)
        ).mean()
        for name, each in (
            ("mesh", look),
            ("landmarks", replace(look, eyes=replace(seen, iris=seen.iris & ~lid))),
        )
    }
    print("log error of the iris", errors)
    assert errors["landmarks"] < 0.4 < 0.8 < errors["mesh"]


def test_dark_eyes_between_narrow_lids_are_found(face: PaintedFace, smiling: State):
    """Their whites, in the shade and tinted by the lids, look like skin; landmarks know better."""
    geometry = face.forward.geometry
    parts = {part.name: part.vertices for part in parts_of(geometry)}
    change = np.zeros_like(geometry.log_albedo)
    change[parts["white"]] = np.log([0.12, 0.08, 0.055]) - geometry.log_albedo[parts["white"]]
    change[parts["iris"]] = np.log([0.02, 0.014, 0.01]) - geometry.log_albedo[parts["iris"]]
    look = picture(face, smiling, change)
    known = replace(look, eyes=seen_eyes(face, smiling))
    guessed, found = (
        by_name(face, part_colors(face.forward, smiling, face.stage, each), "iris")[0]
        for each in (look, known)
    )
    true = change[parts["iris"]].mean(axis=0)
    print("iris", found.round(2), "true", true.round(2), "without landmarks", guessed.round(2))
    assert not guessed.any() and np.abs(found - true).mean() < 0.45


def test_brown_eyes_are_not_orange(face: PaintedFace, smiling: State):
    """A photo without any blue in them."""
    geometry = face.forward.geometry
    change = np.zeros_like(geometry.log_albedo)
    iris = next(part for part in parts_of(geometry) if part.name == "iris").vertices
    change[iris] = np.log([0.06, 0.02, 0.001]) - geometry.log_albedo[iris]
    found = part_colors(face.forward, smiling, face.stage, picture(face, smiling, change))
    red, green, blue = (geometry.log_albedo + found)[iris].mean(axis=0)
    print("iris", np.exp([red, green, blue]).round(3))
    assert red > green > blue and red - blue < BROWNEST[2] + 0.01
    assert red - green < BROWNEST[1] + 0.01


def test_whites_are_not_blue_and_teeth_have_hues_of_teeth(face: PaintedFace, smiling: State):
    geometry = face.forward.geometry
    look = picture(face, smiling, np.zeros_like(geometry.log_albedo))
    blue = replace(look, color=look.color * [0.7, 1.0, 1.4], eyes=seen_eyes(face, smiling))
    found = geometry.log_albedo + part_colors(face.forward, smiling, face.stage, blue)
    for name, bluest, greenest in (("white", 0.0, np.inf), ("teeth", -0.15, -0.04)):
        red, green, other = np.median(by_name(face, found, name), axis=0)
        assert other <= red + bluest + 1e-6 and green <= red + greenest + 1e-6


def test_a_tinted_photo_says_no_hue(face: PaintedFace, smiling: State):
    geometry = face.forward.geometry
    change = np.zeros_like(geometry.log_albedo)
    iris = next(part for part in parts_of(geometry) if part.name == "iris").vertices
    change[iris] = np.log(BLUE) - geometry.log_albedo[iris].mean(axis=0)
    look = replace(picture(face, smiling, change), tinted=True)
    found = by_name(face, part_colors(face.forward, smiling, face.stage, look), "iris")[0]
    assert np.ptp(found) < 0.02 and abs(found.mean() - change[iris][0].mean()) < 0.2


def test_the_shade_of_the_lid_is_no_color(face: PaintedFace, smiling: State):
    geometry = face.forward.geometry
    look = picture(face, smiling, np.zeros_like(geometry.log_albedo))
    seen, true = seen_eyes(face, smiling), 1.8
    shade = np.exp(-true * np.nan_to_num(faded(seen.below_lid)))
    shaded = replace(look, color=look.color * shade[..., None], eyes=seen)
    found = found_colors(face.forward, smiling, face.stage, shaded)
    white = by_name(face, found.log_change, "white")[0]
    iris = by_name(face, found.log_change, "iris")[0]
    print("depth", found.lid_shade, "white", white.round(2), "iris", iris.round(2))
    assert found.lid_shade is not None and abs(found.lid_shade - true) < 0.4
    assert np.abs(white).max() < 0.06
    assert np.abs(iris).max() < 0.1  # with the shade left in: 0.24
    assert found_colors(face.forward, smiling, face.stage, look).lid_shade is None
