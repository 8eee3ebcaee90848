"""Pictures of a fitted scene: the fit over the photo, its textures on the face, new light, a new
expression.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np

from facestage.contract.files.color import srgb_to_linear
from facestage.contract.result import LIGHT_PROBE, Result

from ..pictures.images import image_pixels, load_image
from ..pictures.render import Crop, read_pixels, render_linear, srgb
from ..rig.face_rig import read_weights, require_rig, set_weights
from ..scene.relight import relight, restore_lights

BACKDROP = 0.02  # linear grey behind a face that is not where the photo was
SURPRISE = {
    "jawOpen": 0.75,
    "browInnerUp": 0.9,
    "browOuterUpLeft": 0.6,
    "browOuterUpRight": 0.6,
    "eyeWideLeft": 0.5,
    "eyeWideRight": 0.5,
    "mouthFunnel": 0.25,
}
LIGHT_FROM = "left"


def showcase(
    scene: bpy.types.Scene, result: Result, photo: Path, crop: Crop, samples: int
) -> dict[str, np.ndarray]:
    """Caption -> sRGB picture (h, w, 3) in 0..1. Leaves lights and sliders as the fit had them."""
    rig = require_rig(scene)
    background = srgb_to_linear(_shown(photo, crop))
    fit = render_linear(scene, samples, crop=crop, denoise=True)
    pictures = {
        "photo": srgb(background),
        "fit": srgb(fit[..., :3] + background * (1 - fit[..., 3:])),
        "albedo": _texture_on_face(scene, rig, "Albedo", crop),
        "specular": _texture_on_face(scene, rig, "Specular", crop),
        "light probe": light_probe(result),
    }
    relight(scene, LIGHT_FROM)
    pictures[f"relit from the {LIGHT_FROM}"] = _on_backdrop(
        render_linear(scene, samples, crop=crop, denoise=True)
    )
    _, fitted = read_weights(rig)
    set_weights(rig, {}, {name: SURPRISE.get(name, 0.0) for name in fitted})
    pictures["new expression"] = _on_backdrop(
        render_linear(scene, samples, crop=crop, denoise=True)
    )
    set_weights(rig, {}, fitted)
    restore_lights(scene)
    return pictures


def light_probe(result: Result) -> np.ndarray:
    """(h, w, 3) the fitted light as a lat-long map, its brightest light just below white."""
    assert result.folder is not None
    pixels = read_pixels(result.folder / LIGHT_PROBE)[..., :3]
    return srgb((pixels / max(1e-9, float(pixels.max()))) ** 0.5)


def _on_backdrop(pixels: np.ndarray) -> np.ndarray:
    return srgb(pixels[..., :3] + BACKDROP * (1 - pixels[..., 3:]))


def _shown(photo: Path, crop: Crop) -> np.ndarray:
    """The crop of the photo as stored, enlarged like the renders."""
    image = load_image(photo)
    pixels = image_pixels(image)[..., :3]
    left, top, right, bottom = crop.box
    pixels = pixels[top:bottom, left:right]
    height, width = crop.size
    y = np.clip((np.arange(height) + 0.5) / crop.scale - 0.5, 0, pixels.shape[0] - 1)
    x = np.clip((np.arange(width) + 0.5) / crop.scale - 0.5, 0, pixels.shape[1] - 1)
    return _bilinear(pixels, y, x)


def _bilinear(pixels: np.ndarray, y: np.ndarray, x: np.ndarray) -> np.ndarray:
    top, left = np.floor(y).astype(int), np.floor(x).astype(int)
    bottom, right = (
        np.minimum(top + 1, pixels.shape[0] - 1),
        np.minimum(left + 1, pixels.shape[1] - 1),
    )
    b, a = (y - top)[:, None, None], (x - left)[None, :, None]
    upper = pixels[top][:, left] * (1 - a) + pixels[top][:, right] * a
    lower = pixels[bottom][:, left] * (1 - a) + pixels[bottom][:, right] * a
    return upper * (1 - b) + lower * b


def _texture_on_face(
    scene: bpy.types.Scene, rig: bpy.types.Object, name: str, crop: Crop
) -> np.ndarray:
    """The face shining with one of its textures, lights left out."""
    with _shining(rig, name):
        pixels = render_linear(scene, 16, crop=crop)
    # A specular map has no color space; 0..SPECULAR_MAX is shown as black to white.
    color = srgb(pixels[..., :3]) if name == "Albedo" else np.clip(pixels[..., :3] / 2, 0, 1)
    return color * pixels[..., 3:] + srgb(np.array(BACKDROP)) * (1 - pixels[..., 3:])


@contextmanager
def _shining(rig: bpy.types.Object, name: str) -> Iterator[None]:
    """For the block, the rig's materials emit their texture ``name`` instead of reflecting
    light.
    """
    undo = []
    try:
        for material in rig.data.materials:
            tree = material.node_tree
            output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
            before = output.inputs["Surface"].links[0].from_socket
            emission = tree.nodes.new("ShaderNodeEmission")
            tree.links.new(tree.nodes[name].outputs["Color"], emission.inputs["Color"])
            tree.links.new(emission.outputs[0], output.inputs["Surface"])
            undo.append((tree, emission, before, output))
        yield
    finally:
        for tree, emission, before, output in undo:
            tree.nodes.remove(emission)
            tree.links.new(before, output.inputs["Surface"])
