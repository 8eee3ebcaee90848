"""Two photos of the synthetic face with a texture that its basis does not know, each in a light of
its own: what stereo has to match.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_erosion, zoom
from scipy.spatial.transform import Rotation

from facestage.contract.camera import Camera
from facestage.fit.face.state import State
from facestage.fit.forward.shading import sample_bilinear
from facestage.fit.stereo.overlap import Sight
from reference.synthetic_scene import Scene, moved

# Freckles along a side of the square that the skin is unwrapped to, and texels for each.
FRECKLES, TEXELS = 110, 4
CONTRAST = 0.1


def turned(scene: Scene, degrees: float, side: int = 200) -> State:
    """The scene's person about the vertical axis, larger than in the scene."""
    camera = Camera(side, side, 2.1 * side, (0.5 * side, 0.5 * side))
    rotation = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    return replace(scene.state, rotation=rotation, camera=camera)


def speckles(person: int, contrast: float = CONTRAST) -> np.ndarray:
    """(n, n) of the logarithm of the skin's reflectance."""
    random = np.random.default_rng(person)
    return contrast * zoom(random.normal(size=(FRECKLES, FRECKLES)), TEXELS, order=3)


def photo(
    scene: Scene, state: State, texture: np.ndarray, light: tuple[float, float, float]
) -> np.ndarray:
    """(h, w, 3) under soft light from a direction; a pixel is the mean of four places in it."""
    height, width = state.camera.height, state.camera.width
    total = np.zeros((height, width, 3))
    y, x = np.mgrid[:height, :width]
    for part in range(4):
        offset = 0.25 + 0.5 * np.array([part % 2, part // 2])
        pixels = np.stack([x.ravel(), y.ravel()], axis=1) + offset
        surface = scene.forward.surface(state, pixels)
        detail = sample_bilinear(texture, scene.forward.uvs(surface))
        shading = 0.3 + 0.2 * (surface.normals @ np.array(light))
        column, row = surface.pixels.astype(int).T
        total[row, column] += 0.25 * (shading * np.exp(detail))[:, None] * [0.9, 0.6, 0.5]
    return total


def sight(scene: Scene, color: np.ndarray, state: State) -> Sight:
    """A photo with the face where a fit has it."""
    # The open mesh ends where a head goes on: its border is no skin.
    inside = binary_erosion(color[..., 0] > 0, iterations=4)
    return Sight(scene.forward, state, color, inside)


def pair(scene: Scene, first: State, second: State) -> tuple[np.ndarray, np.ndarray]:
    """Photos of one person, the second darker and in other light."""
    texture = speckles(1)
    return (
        photo(scene, first, texture, (0.5, 0.5, 0.7)),
        0.3 * photo(scene, second, texture, (-0.8, 0.3, 0.5)),
    )


def wrong(state: State) -> State:
    """A guess some pixels off: another nose, another width, another pose."""
    return moved(
        state,
        pose=[0.01, -0.015, 0.005, 0.0005, -0.0004, 0.004],
        identity=[0.5, 0.3, -0.8, 0.4],
        expression=[-0.1, 0.1, -0.1],
    )
