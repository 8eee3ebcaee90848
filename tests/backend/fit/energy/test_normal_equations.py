"""The structured normal equations against the plain product of the written-out Jacobian, in
float64.
"""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.energy.normal_equations import NormalEquations
from facestage.fit.energy.photo_jacobian import Jacobian
from facestage.fit.face.layout import Layout
from facestage.fit.face.unknowns import BLOCKS
from facestage.render.light_terms import Asked
from reference.dense_system import written_out
from reference.synthetic_scene import Scene

# float32 products over a block of pixels, relative to the columns' lengths.
BOUND = 2e-6


@pytest.mark.parametrize(
    "blocks", [BLOCKS, ("lights",), ("specular",), ("pose", "lights"), ("albedo", "specular")]
)
@pytest.mark.parametrize("uniform", [False, True])
def test_hessian_and_gradient(
    scene: Scene, uniform_scene: Scene, uniform: bool, blocks: tuple[str, ...]
):
    scene = uniform_scene if uniform else scene
    state, layout = scene.state, Layout(scene.state)
    y, x = np.mgrid[: state.camera.height, : state.camera.width]
    surface = scene.forward.surface(state, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5)
    terms = scene.forward.light_terms(
        state, surface, scene.stage, 2, 3, Asked(by_surface=True, by_roughness=True)
    )
    image = scene.forward.shade(state, surface, terms)
    random = np.random.default_rng(1)
    pixels = len(surface.pixels)
    residual, weights = random.normal(size=(pixels, 3)), random.uniform(0, 50, pixels)
    weights[::5] = 0
    jacobian = Jacobian(scene.forward, state, image, layout, layout.mask(blocks))
    system = NormalEquations(jacobian, layout)
    dense = written_out(jacobian, layout, pixels)
    for block in jacobian.blocks(777):
        system.add(block, residual[block.pixels], weights[block.pixels])
    hessian, gradient = system.assembled()
    weighted = dense * np.repeat(weights, 3)[:, None]
    wanted = weighted.T @ dense
    length = np.sqrt(np.diag(wanted))
    size = np.outer(length, length) + 1e-12 * wanted.max()
    error = float((np.abs(hessian - wanted) / size).max())
    scale = length * np.linalg.norm(residual.ravel() * np.sqrt(np.repeat(weights, 3))) + 1e-12
    slope = float((np.abs(gradient - weighted.T @ residual.ravel()) / scale).max())
    print(f"Hessian {error:.1e}, gradient {slope:.1e} of the columns' lengths, allowed {BOUND:g}")
    assert max(error, slope) < BOUND
    assert not hessian[:, ~layout.mask(blocks)].any() and not gradient[~layout.mask(blocks)].any()
