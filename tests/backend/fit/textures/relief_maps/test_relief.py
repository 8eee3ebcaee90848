"""Relief of a painted face: light on it, and what paint alone must not become."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.texture_maps import NORMAL
from facestage.fit.forward.shading import Image
from facestage.fit.forward.surface_frame import FrameField, turned
from facestage.fit.given.seen_normals import SeenNormals
from facestage.fit.textures.relief_maps.height_field import Spread
from facestage.fit.textures.relief_maps.relief import Relief, ReliefSeen, normal_map
from facestage.fit.textures.relief_maps.relief_evidence import About, Caution, difference, evidence
from facestage.fit.textures.shown import Shown
from facestage.render.light_terms import Asked
from reference.painted_face import PaintedFace, painted_face

TEXELS = 256


@pytest.fixture(scope="module")
def face(renderer: str) -> PaintedFace:
    return painted_face(texels=TEXELS, key_side=0.3)


def frames_of(face: PaintedFace) -> FrameField:
    return FrameField.of(face.forward.geometry, face.forward.geometry.at(face.state))


def bumps(face: PaintedFace) -> Relief:
    """Waves of 12 mm with slopes of a tenth."""
    atlas, geometry = face.atlas, face.forward.geometry
    place = 1e3 * atlas.bake(geometry.at(face.state))
    height = 0.14 * np.sin(place[..., 0] * 2 * np.pi / 12) * np.sin(place[..., 1] * np.pi / 6)
    height = np.where(atlas.skin, height, 0.0).astype(np.float32)
    frames = frames_of(face).at(atlas.triangle, atlas.weights.astype(np.float64))
    return Relief(height, normal_map(atlas, frames, height), np.zeros_like(height))


def shown(face: PaintedFace, surface_map: np.ndarray | None, color: np.ndarray | None) -> Shown:
    """The photo of the relief, or of ``color``, as a fit sees it that knows neither."""
    surface = face.surface
    asked = Asked(by_roughness=True, by_surface=True)
    plain_terms = face.forward.light_terms(face.state, surface, face.stage, 16, 5, asked)
    plain = face.forward.shade(face.state, surface, plain_terms)
    photo = plain.color if color is None else plain.color * np.exp(color)
    uvs = face.forward.uvs(surface)
    if surface_map is not None:
        bent = frames_of(face).mapped(surface, uvs, surface_map, face.state.rotation)
        terms = face.forward.light_terms(face.state, bent, face.stage, 16, 5, asked)
        photo = face.forward.shade(face.state, bent, terms).color
    return replace(face.shown(photo), image=plain)


def test_light_on_the_relief_is_the_picture_that_is_traced_again(face: PaintedFace):
    relief = bumps(face)
    seen = shown(face, relief.normal, None)
    lit = relief.lit(seen, face.forward.geometry, face.state)
    error = np.abs(lit.image.color - seen.photo).sum()
    change = np.abs(seen.image.color - seen.photo).sum()
    print(f"to first order, {error / change:.3f} of the change is missed; 0.2 allowed")
    assert error < 0.2 * change


def test_no_relief_changes_no_light(face: PaintedFace):
    """Whatever the skin's own way of sending light back: what leaves it unevenly too."""
    state = replace(face.state, translucency=0.8)
    asked = Asked(by_roughness=True, by_surface=True)
    terms = face.forward.light_terms(state, face.surface, face.stage, 4, 5, asked)
    image = face.forward.shade(state, face.surface, terms)
    assert image.excess is not None
    seen = replace(face.shown(image.color), image=image)
    flat = np.broadcast_to(NORMAL.default, (8, 8, 3)).astype(np.float32)
    relief = Relief(np.zeros((8, 8), np.float32), flat, np.zeros((8, 8), np.float32))
    lit = relief.lit(seen, face.forward.geometry, state)
    np.testing.assert_allclose(lit.image.color, image.color, rtol=1e-4, atol=1e-6)


def test_relief_is_found_where_light_tells_of_it(
    face: PaintedFace, monkeypatch: pytest.MonkeyPatch
):
    """At 1.3 mm a pixel the waves are too long for the share of relief to be asked for."""
    monkeypatch.setattr(
        "facestage.fit.textures.relief_maps.relief.spread_of", lambda *_found: Spread(0.01, 0.06)
    )
    relief = bumps(face)
    pixels = shown(face, relief.normal, None)
    seen = ReliefSeen(face.forward.geometry, face.atlas)
    seen.add(pixels, face.state)
    found = seen.found
    assert found is not None
    assert seen._seen is not None
    inner = seen._seen.weight > 0.3 * np.median(seen._seen.weight[seen._seen.weight > 0])
    right, true = (difference(each, 1)[inner] for each in (found.height, relief.height))
    alike = float(right @ true / np.sqrt((right @ right) * (true @ true)))
    print(f"slopes to the right {alike:.2f} alike")
    assert alike > 0.6
    # The normals that pixels see are nearer to the true ones than the mesh's.
    flat, mapped = (angle(face, relief, each) for each in (None, found))
    print(f"normals off by {flat:.2f} degrees, with the map {mapped:.2f}")
    assert mapped < 0.85 * flat
    # About them the light is the traced one: highlights are no linear function of slopes.
    again = seen.again()
    assert again is not None
    again.add(pixels, face.state, traced(face, found))
    assert again.found is not None
    nearer = angle(face, relief, again.found)
    print(f"a second time {nearer:.2f}")
    assert nearer < 0.97 * mapped
    # Where a freckle was found the first time, less is taken for relief the second.
    freckled = replace(found, pigment=np.full_like(found.pigment, -2.0))
    last = ReliefSeen(face.forward.geometry, face.atlas, (freckled, Spread(0.01, 0.06)))
    last.add(pixels, face.state, traced(face, found))
    assert last.found is not None
    assert last.found.height.std() < 0.5 * again.found.height.std()


def test_what_is_found_about_the_true_relief_is_that(
    face: PaintedFace, monkeypatch: pytest.MonkeyPatch
):
    """Pixels that leave nothing over say the relief's own slopes, times the light's derivative."""
    relief = bumps(face)
    frames, atlas = frames_of(face), face.atlas
    spacing = np.zeros(atlas.skin.shape)
    spacing[atlas.covered] = 2.0
    pixels = shown(face, relief.normal, None)
    image = traced(face, relief)
    pixels = replace(pixels, photo=image.color)
    # What light is off by in long waves is taken from the smooth skin; here there is none.
    monkeypatch.setattr(
        "facestage.fit.textures.relief_maps.relief_evidence.AGAIN", Caution(5.0, 0.5, 1e4)
    )
    seen = evidence(pixels, face.state, frames, spacing, atlas.skin, About(relief.height, image))
    slopes = np.stack([difference(relief.height, 1), difference(relief.height, 0)])
    expected = (seen.slope * slopes).sum(axis=0)
    error = (seen.value - expected)[seen.weight > 0]
    mean = error.sum() / seen.weight.sum()
    rest = np.abs(error - mean * seen.weight[seen.weight > 0]).sum()
    print(f"{rest / np.abs(expected).sum():.4f} of it off")
    assert rest < 0.02 * np.abs(expected).sum()


def traced(face: PaintedFace, relief: Relief) -> Image:
    """The light on a relief, as the photo of it has it."""
    seen = shown(face, None, None)
    bent = relief.on(seen, face.forward.geometry, face.state)
    asked = Asked(by_roughness=True, by_surface=True)
    terms = face.forward.light_terms(face.state, bent, face.stage, 16, 5, asked)
    return face.forward.shade(face.state, bent, terms)


def angle(face: PaintedFace, true: Relief, found: Relief | None) -> float:
    """Degrees between the normals that pixels see and the true relief's."""
    geometry = face.forward.geometry
    pixels = SeenNormals.of(
        face.forward,
        face.state,
        geometry.at(face.state) + face.state.translation,
        np.arange(len(geometry.mean)),
    )
    seen = pixels.found_normals(None if found is None else found.normal)
    return pixels.angle(seen, pixels.found_normals(true.normal), np.eye(3))


def test_blotches_are_no_relief(face: PaintedFace):
    """Whatever its contrast, what has no direction stays pigment."""
    rng = np.random.default_rng(0)
    spots = np.zeros(len(face.surface.pixels))
    for centre in face.surface.points[rng.choice(len(spots), 150)]:
        distance = np.linalg.norm(face.surface.points - centre, axis=1)
        spots -= 0.2 * np.exp(-0.5 * (distance / 0.002) ** 2)
    seen = ReliefSeen(face.forward.geometry, face.atlas)
    seen.add(shown(face, None, spots[:, None] * np.array([0.8, 1.0, 1.1])), face.state)
    found = seen.found
    slope = 0.0 if found is None else np.abs(found.normal[..., :2] - 0.5).max()
    print(f"largest slope engraved {2 * slope:.3f}")
    assert slope < 0.01


def test_a_normal_map_is_that_of_its_height(face: PaintedFace):
    relief, atlas = bumps(face), face.atlas
    frames = frames_of(face).at(atlas.triangle, atlas.weights.astype(np.float64))
    axes = (*frames.tangents, frames.normals)
    values = 2 * relief.normal[atlas.covered].astype(np.float64) - 1
    normals = sum(values[:, k, None] * axis for k, axis in enumerate(axes))
    place = 1e3 * face.forward.geometry.at(face.state)[atlas.corners]
    x, y = np.einsum("ti,tix->tx", atlas.weights, place)[:, :2].T
    k = 2 * np.pi / 12
    slope = np.stack(
        [
            0.14 * k * np.cos(k * x) * np.sin(k * y),
            0.14 * k * np.sin(k * x) * np.cos(k * y),
            np.zeros_like(x),
        ],
        axis=1,
    )
    slope -= frames.normals * np.einsum("tx,tx->t", slope, frames.normals)[:, None]
    cosine = np.einsum("tx,tx->t", normals, turned(frames.normals, slope))
    # At the back of the head triangles are too large for waves of 12 mm in the map's frames.
    front = atlas.skin[atlas.covered] & (frames.normals[:, 2] > 0)
    error = np.degrees(np.arccos(np.clip(cosine, -1, 1)))[front]
    print(f"median {np.median(error):.3f} degrees off, slopes of 4 degrees")
    assert np.median(error) < 0.3


def test_a_thinned_lattice_shows_every_second_pixel_each_way(face: PaintedFace):
    """What is left is what was there."""
    whole = shown(face, None, None)
    whole = whole.with_gloss(np.zeros(len(whole.uvs)), np.full(len(whole.uvs), 0.01))
    part = whole.thinned(len(whole.uvs) // 3)
    assert whole.thinned(len(whole.uvs)) is whole
    places = part.image.surface.pixels
    assert 0.2 < len(places) / len(whole.uvs) < 0.3
    assert (np.diff(np.unique(places[:, 0])) == 2).all()
    row = {tuple(place): k for k, place in enumerate(whole.image.surface.pixels)}
    index = np.array([row[tuple(place)] for place in places])
    for name in ("photo", "uvs", "clipped", "clear", "doubt", "feature", "lips", "crease"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[index], name)
    np.testing.assert_array_equal(part.image.color, whole.image.color[index])
    for name, each in vars(part.image.terms).items():
        if name not in ("pairs", "indirect") and each.size:
            np.testing.assert_array_equal(each, getattr(whole.image.terms, name)[index], name)
    assert part.image.terms.specular_by_roughness.size
    assert part.rougher is not None and len(part.rougher) == len(places)
