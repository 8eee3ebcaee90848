"""Derivatives of the summed light terms against central finite differences of the same kernel."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.light_stage import fibonacci_stage
from facestage.render.light_terms import Asked
from reference.rendering.cook_torrance import normalize
from reference.rendering.meshes import lit_points, plane, seen_points, sphere

SAMPLES, SEED = 4, 9
# Every light has a color of its own, so that no channel can stand for another.
RADIANCE = np.random.default_rng(2).uniform(0.2, 2.0, (5, 3))
ROUGHNESSES = [0.2, 0.4, 0.8]


class Kernel:
    """The tracer at one scene, without shadows (the derivatives keep visibility fixed)."""

    def __init__(self, tracer_of) -> None:
        mesh = sphere().joined(plane())
        seen = seen_points(mesh, 16)
        self.stage = fibonacci_stage(5, radius=0.7, side=0.15)
        towards = normalize(self.stage.position[None] - seen.points[:, None])
        # Away from grazing angles, where a light enters or leaves the half space between the two
        # sides.
        clear = (seen.normals * seen.views).sum(1) > 0.15
        clear &= (np.abs(np.einsum("px,plx->pl", seen.normals, towards)) > 0.15).all(1)
        rows = (seen.points, seen.normals, seen.facing, seen.views)
        self.points, self.normals, self.facing, self.views = (array[clear] for array in rows)
        self.tracer = tracer_of(mesh)

    def __call__(self, points=None, normals=None, roughness=0.4, derivatives=False):
        points = self.points if points is None else points
        normals = self.normals if normals is None else normals
        lit = lit_points((points, normals, self.facing, self.views), self.stage, roughness)
        asked = Asked(shadows=False, by_surface=derivatives, by_roughness=derivatives)
        return self.tracer.light_terms(lit, SAMPLES, SEED, asked, radiance=RADIANCE)


@pytest.fixture(scope="module")
def kernel(tracer_of) -> Kernel:
    return Kernel(tracer_of)


def check(
    name: str, found: np.ndarray, plus: np.ndarray, minus: np.ndarray, step: float, bound: float
) -> None:
    """Assert and print the 99th percentile of |found - difference| over the typical size of the
    derivative.
    """
    wanted = (plus.astype(float) - minus.astype(float)) / (2 * step)
    typical = np.sqrt((wanted**2).mean())
    error = float(np.percentile(np.abs(found - wanted), 99) / typical)
    print(
        f"{name}: error {error:.1e} of the derivative's size, allowed {bound:.0e}, margin "
        f"{bound / error:.0f}x"
    )
    assert typical > 0 and error < bound


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_by_normal(kernel: Kernel, roughness: float):
    terms = kernel(roughness=roughness, derivatives=True)
    random = np.random.default_rng(1)
    step = 0.0125 * roughness**2  # a small part of the lobe's width
    for trial in range(3):
        tangent = normalize(np.cross(kernel.normals, random.normal(size=kernel.normals.shape)))
        plus, minus = (
            kernel(
                normals=np.cos(step) * kernel.normals + sign * np.sin(step) * tangent,
                roughness=roughness,
            )
            for sign in (1, -1)
        )
        for kind in ("diffuse", "specular"):
            along = np.einsum("pcx,px->pc", getattr(terms, f"{kind}_by_normal"), tangent)
            name = f"{kind} by normal, roughness {roughness}, direction {trial}"
            check(
                name,
                along,
                getattr(plus, kind) @ RADIANCE,
                getattr(minus, kind) @ RADIANCE,
                step,
                5e-3,
            )


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_by_depth(kernel: Kernel, roughness: float):
    terms = kernel(roughness=roughness, derivatives=True)
    step = 1e-3
    plus, minus = (
        kernel(points=kernel.points - sign * step * kernel.views, roughness=roughness)
        for sign in (1, -1)
    )
    for kind in ("diffuse", "specular"):
        name = f"{kind} by depth, roughness {roughness}"
        sums = getattr(plus, kind) @ RADIANCE, getattr(minus, kind) @ RADIANCE
        check(name, getattr(terms, f"{kind}_by_depth"), *sums, step, 5e-3)


@pytest.mark.parametrize("roughness", [0.06, *ROUGHNESSES, 0.99])
def test_by_roughness(kernel: Kernel, roughness: float):
    terms = kernel(roughness=roughness, derivatives=True)
    step = 2e-3 * roughness
    plus, minus = kernel(roughness=roughness + step), kernel(roughness=roughness - step)
    sums = plus.specular @ RADIANCE, minus.specular @ RADIANCE
    check(f"specular by roughness at {roughness}", terms.specular_by_roughness, *sums, step, 5e-3)
    np.testing.assert_array_equal(plus.diffuse, minus.diffuse)


def test_the_diffuse_term_is_linear_in_the_normal(kernel: Kernel):
    terms = kernel(derivatives=True)
    np.testing.assert_allclose(
        np.einsum("pcx,px->pc", terms.diffuse_by_normal, kernel.normals),
        terms.diffuse @ RADIANCE,
        rtol=1e-4,
        atol=1e-7,
    )
