"""How shadows move: the Jacobian with shadow edges against central finite differences of well-sampled pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from facestage.fit.parameters import Layout, State
from facestage.fit.photometric import jacobian_blocks
from facestage.fit.shading import Image
from facestage.fit.shadow_edges import MOVES_SHADOWS, ShadowEdges, shadow_edges
from reference.shadow_scene import shadow_scene
from reference.synthetic_scene import Scene

SAMPLES, SEED = 256, 6
# Steps that move the shadow by about a tenth of its penumbra.
STEPS = {
    "pose": np.array([5e-3, 5e-3, 5e-3, 1e-3, 1e-3, 2e-3]), "focal": 5e-3, "identity": 0.25, "expression": 0.25,
}  # fmt: skip
SUM_BOUND, CORRELATION_BOUND = 0.10, 0.9


@dataclass(frozen=True)
class Penumbra:
    """The wall's pixels that see a part of the lamp, and what the two Jacobians say of them."""

    scene: Scene
    image: Image
    partly: np.ndarray  # (P,) bool
    edges: ShadowEdges
    frozen: np.ndarray  # (3 P, size) visibility held fixed
    moving: np.ndarray  # (3 P, size)


def picture(scene: Scene, state: State, pixels: np.ndarray, derivatives: bool = False) -> Image:
    surface = scene.forward.surface(state, pixels)
    terms = scene.forward.light_terms(state, surface, scene.stage, SAMPLES, SEED, derivatives)
    return scene.forward.shade(state, surface, terms)


def jacobian(scene: Scene, image: Image, edges: ShadowEdges | None) -> np.ndarray:
    layout = Layout(scene.state)
    dense = [
        block.dense
        for block in jacobian_blocks(scene.forward, scene.state, image, layout, layout.mask(MOVES_SHADOWS), edges)
    ]
    return np.concatenate(dense).astype(float)


def everything(image: Image) -> np.ndarray:
    return np.ones(len(image.color), bool)


def wall_pixels(scene: Scene) -> np.ndarray:
    """(P, 2) pixels whose whole neighbourhood shows the wall."""
    height, width = scene.state.camera.height, scene.state.camera.width
    y, x = np.mgrid[:height, :width]
    surface = scene.forward.surface(scene.state, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5)
    wall = np.zeros((height, width), bool)
    column, row = surface.pixels.astype(int).T
    wall[row, column] = surface.corners.max(axis=1) < len(scene.geometry.mean) - 9
    inner = wall.copy()
    for shift in (-2, -1, 1, 2):
        inner &= np.roll(wall, shift, axis=0) & np.roll(wall, shift, axis=1)
    rows, columns = np.nonzero(inner)
    return np.stack([columns, rows], axis=1) + 0.5


@pytest.fixture(scope="module")
def penumbra(renderer: str) -> Penumbra:
    scene = shadow_scene()
    pixels = wall_pixels(scene)
    image = picture(scene, scene.state, pixels, derivatives=True)
    tracer, state, surface = scene.forward._tracer, scene.state, image.surface
    matrix = np.eye(4)
    matrix[:3, 3] = -state.translation
    whole = tracer.light_terms(
        surface.points - state.translation, surface.normals, surface.facing, -surface.rays,
        scene.stage.transformed(matrix), state.roughness, SAMPLES, SEED, shadows=False,
    )  # fmt: skip
    share = image.terms.diffuse[:, 0] / whole.diffuse[:, 0]
    edges = shadow_edges(scene.forward, scene.state, image, scene.stage, SEED, everything(image), lines=8)
    return Penumbra(
        scene, image, (share > 0.02) & (share < 0.98), edges, jacobian(scene, image, None), jacobian(scene, image, edges)
    )


def differences(penumbra: Penumbra, block: str) -> Iterator[tuple[str, int, np.ndarray, np.ndarray]]:
    """Name, column, pixels to compare (P,) and d color / d parameter (P,), the mean of the channels."""
    scene, image = penumbra.scene, penumbra.image
    layout = Layout(scene.state)
    where = layout.slices[block]
    for offset, step in enumerate(np.broadcast_to(STEPS[block], where.stop - where.start)):
        increment = np.zeros(layout.size)
        increment[where.start + offset] = step
        plus = picture(scene, layout.apply(scene.state, increment), image.surface.pixels)
        minus = picture(scene, layout.apply(scene.state, -increment), image.surface.pixels)
        same = (plus.surface.triangle == image.surface.triangle) & (minus.surface.triangle == image.surface.triangle)
        wanted = ((plus.color - minus.color) / (2 * step)).mean(axis=1)
        yield f"{block}[{offset}]", where.start + offset, same & penumbra.partly, wanted


def column(matrix: np.ndarray, index: int) -> np.ndarray:
    """(P,) a column, the mean of the channels."""
    return matrix[:, index].reshape(-1, 3).mean(axis=1)


def test_the_scene_has_a_soft_shadow(penumbra: Penumbra):
    print(f"{penumbra.partly.sum()} of {len(penumbra.partly)} pixels in penumbra, {len(penumbra.edges.pixel)} crossings")
    assert penumbra.partly.sum() > 200
    assert 0.02 < penumbra.edges.penumbra < 0.5


def correlation(found: np.ndarray, wanted: np.ndarray) -> float:
    """Pearson's; 0 for a derivative that is 0 everywhere."""
    return float(np.corrcoef(found, wanted)[0, 1]) if found.std() > 0 else 0.0


@pytest.mark.parametrize("block", MOVES_SHADOWS)
def test_every_parameter_that_moves_the_shadow(penumbra: Penumbra, block: str, tmp_path: Path):
    for name, index, compared, wanted in differences(penumbra, block):
        frozen, moving = column(penumbra.frozen, index)[compared], column(penumbra.moving, index)[compared]
        wanted = wanted[compared]
        size = np.abs(wanted).sum()
        off = {key: abs(found.sum() - wanted.sum()) / size for key, found in (("with", moving), ("without", frozen))}
        like = {key: correlation(found, wanted) for key, found in (("with", moving), ("without", frozen))}
        error = {
            key: float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))
            for key, found in (("with", moving), ("without", frozen))
        }
        print(
            f"{name:14s} {compared.sum():4d} pixels: sum off by {100 * off['with']:.1f} % (without edges "
            f"{100 * off['without']:.0f} %), allowed {100 * SUM_BOUND:.0f} %, margin {SUM_BOUND / off['with']:.0f}x; "
            f"correlation {like['with']:.3f} (without {like['without']:.3f}); error {error['with']:.2f} "
            f"(without {error['without']:.2f})"
        )
        np.savez(tmp_path / f"{name}.npz", pixels=penumbra.image.surface.pixels[compared], wanted=wanted, found=moving)
        assert compared.sum() > 100
        assert off["with"] < SUM_BOUND, f"see {tmp_path}"
        assert like["with"] > CORRELATION_BOUND
        assert error["with"] < 0.5 * error["without"]
