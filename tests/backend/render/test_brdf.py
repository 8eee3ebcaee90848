"""Cook-Torrance conserves energy and is reciprocal, and the fast lobe equals the reference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from facestage.contract.brdf import F0, K_DIFFUSE, K_SPECULAR, ROUGHNESS_MAX, ROUGHNESS_MIN
from reference.rendering.cook_torrance import cook_torrance, ggx, normalize, schlick, skin, smith

NORMAL = np.array([0.0, 0.0, 1.0])
ROUGHNESSES = [ROUGHNESS_MIN, 0.1, 0.2, 0.4, 0.7, ROUGHNESS_MAX]


def hemisphere(heights: np.ndarray, azimuths: np.ndarray) -> np.ndarray:
    """(..., 3) directions of n.l ``heights`` and ``azimuths``."""
    ring = np.sqrt(1 - heights**2)
    return np.stack(
        np.broadcast_arrays(ring * np.cos(azimuths), ring * np.sin(azimuths), heights), axis=-1
    )


def specular_albedo(cosine: float, roughness: float, side: int = 1500) -> float:
    """Directional-hemispherical reflectance of the lobe: integral over half vectors, where D is
    smooth.
    """
    alpha = roughness**2
    view = np.array([np.sqrt(1 - cosine**2), 0, cosine])
    # Half vectors sampled in proportion to D (n.h), by inversion; the Jacobian to directions is 4
    # (v.h).
    u = (np.arange(side) + 0.5) / side
    height = np.sqrt((1 - u) / (1 + (alpha**2 - 1) * u))
    half = hemisphere(height[:, None], 2 * np.pi * (np.arange(64) + 0.5) / 64)
    vh = half @ view
    light = 2 * vh[..., None] * half - view
    nl = light[..., 2]
    value = (
        smith(np.maximum(nl, 1e-9), np.asarray(cosine), alpha)
        * schlick(vh)
        * vh
        / (cosine * half[..., 2])
    )
    return float(np.where((nl > 0) & (vh > 0), value, 0).mean())


@pytest.mark.parametrize("roughness", [0.3, 0.6, 1.0])
def test_ggx_projects_to_unit_area(roughness: float):
    height = (np.arange(200000) + 0.5) / 200000
    assert 2 * np.pi * (ggx(height, roughness**2) * height).mean() == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("roughness", [0.5, 1.0])
def test_the_two_ways_to_integrate_the_lobe_agree(roughness: float):
    for cosine in (0.3, 0.8):
        heights, azimuths = (np.arange(800) + 0.5) / 800, 2 * np.pi * (np.arange(400) + 0.5) / 400
        light = hemisphere(heights[:, None], azimuths)
        view = np.array([np.sqrt(1 - cosine**2), 0, cosine])
        direct = 2 * np.pi * (cook_torrance(NORMAL, light, view, roughness) * light[..., 2]).mean()
        assert specular_albedo(cosine, roughness) == pytest.approx(direct, rel=2e-3)


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_white_furnace_returns_no_more_than_it_gets(roughness: float):
    """Bihemispherical reflectance of the whitest skin with the strongest dielectric layer is at
    most 1.
    """
    cosines = (np.arange(64) + 0.5) / 64
    lobe = np.array([specular_albedo(cosine, roughness, 400) for cosine in cosines])
    total = K_DIFFUSE * 1.0 + K_SPECULAR * 1.0 * 2 * float((lobe * cosines).mean())
    print(
        f"roughness {roughness}: white furnace returns {total:.4f} of 1 (specular "
        f"{total - K_DIFFUSE:.4f})"
    )
    assert 0.9 < total <= 1.0
    assert (lobe > 0.2 * F0).all() and (lobe <= 1).all()


unit = st.tuples(st.floats(0.01, 1), st.floats(0, 2 * np.pi))


@given(unit, unit, st.floats(ROUGHNESS_MIN, ROUGHNESS_MAX), st.floats(0, 1), st.floats(0, 1))
def test_reciprocity(light: tuple, view: tuple, roughness: float, albedo: float, c_spec: float):
    light_direction, view_direction = (
        hemisphere(*map(np.array, light)),
        hemisphere(*map(np.array, view)),
    )
    forth = skin(NORMAL, light_direction, view_direction, albedo, c_spec, roughness)
    back = skin(NORMAL, view_direction, light_direction, albedo, c_spec, roughness)
    assert forth >= 0
    np.testing.assert_allclose(forth, back, rtol=1e-9, atol=1e-12)


def fast_lobe(
    normal: np.ndarray, light: np.ndarray, view: np.ndarray, roughness: float
) -> np.ndarray:
    """The renderer's (n.l) D V F for rows of unit vectors, in float32."""
    import mitsuba as mi

    from facestage.render.brdf import specular_lobe

    half = normalize(light + view)

    def put(values: np.ndarray) -> mi.Float:
        return mi.Float(values.astype(np.float32))

    nl, nv, nh = ((normal * other).sum(1) for other in (light, view, half))
    lobe = specular_lobe(
        put(nl),
        put(nv),
        put((np.cross(normal, half) ** 2).sum(1)),
        put(nh),
        put((view * half).sum(1)),
        mi.Float(roughness),
    )
    return np.array(lobe.value)


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_the_renderers_lobe_equals_the_reference(renderer: str, roughness: float):
    random = np.random.default_rng(3)
    normal = normalize(random.normal(size=(4000, 3)))
    view = normalize(normal + 1.2 * random.normal(size=(4000, 3)))
    mirror = 2 * normal * (normal * view).sum(1, keepdims=True) - view
    # Half of the directions near the highlight, where a sharp lobe loses digits.
    spread = np.where(np.arange(4000)[:, None] % 2, 1.0, 2 * roughness**2)
    light = normalize(mirror + spread * random.normal(size=(4000, 3)))
    keep = ((normal * light).sum(1) > 0.02) & ((normal * view).sum(1) > 0.02)
    normal, view, light = normal[keep], view[keep], light[keep]
    expected = (normal * light).sum(1) * cook_torrance(normal, light, view, roughness)
    error = np.abs(fast_lobe(normal, light, view, roughness) - expected) / (
        expected + 1e-4 * expected.max()
    )
    print(
        f"roughness {roughness}: largest relative error {error.max():.1e}, median "
        f"{np.median(error):.1e}"
    )
    assert error.max() < 1e-3


def test_the_renderers_lobe_is_reciprocal(renderer: str):
    random = np.random.default_rng(4)
    normal = normalize(random.normal(size=(500, 3)))
    light = normalize(normal + 0.7 * random.normal(size=(500, 3)))
    view = normalize(normal + 0.7 * random.normal(size=(500, 3)))
    nl, nv = (normal * light).sum(1), (normal * view).sum(1)
    keep = (nl > 0.05) & (nv > 0.05)
    forth = fast_lobe(normal[keep], light[keep], view[keep], 0.4) / nl[keep]
    back = fast_lobe(normal[keep], view[keep], light[keep], 0.4) / nv[keep]
    np.testing.assert_allclose(forth, back, rtol=2e-4)


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_a_normal_that_faces_away_shows_no_highlight_from_behind(renderer: str, roughness: float):
    """Interpolated normals do at a silhouette: the half vector may then lie below the surface, even
    opposite the normal, where no facet faces.
    """
    import mitsuba as mi

    from facestage.render.brdf import HalfVector, lobe_about, view_cosine

    view = np.array([np.sqrt(1 - 0.03**2), 0, -0.03])
    # The mirrored gaze as by a surface that faces the other way, and directions all around it.
    about = np.random.default_rng(5).normal(size=(4000, 3)) * [0.05, 0.02, 0.01]
    light = normalize(np.array([-view[0], 0, 0.029]) + about)
    light = light[light[:, 2] > 0]
    normal, towards, to_light = (
        mi.Vector3f(*np.broadcast_to(each, light.shape).T.astype(np.float32))
        for each in (NORMAL, view, light)
    )
    nv = view_cosine(normal, towards)
    half = HalfVector.between(to_light, towards)
    lobe = lobe_about(half, normal, towards, to_light.z, nv, mi.Float(roughness))
    behind = (light + view)[:, 2] < 0
    assert behind.mean() > 0.2
    for name, values in vars(lobe).items():
        assert (np.array(values)[behind] == 0).all(), name
