"""How close EEVEE is to Cycles on a saved scene of Facestage's, for docs/transport.md.

blender -b SCENE.blend --python tools/compare_engines.py -- [SAMPLES]

EEVEE wants a screen. Direct light alone, 256 pixels, skin that is opaque, that sends its light
unevenly, and that light wanders in; both pictures are blurred by a pixel and a half, because Cycles
is not denoised. Means are over the head but for two pixels along its outline.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np

SIDE_PX, BLUR_PX, SAMPLES = 256, 1.5, 96
GROUP = "Facestage Skin"
# What the skin's inputs are set to.
SKINS = {
    "opaque": {"Subsurface": 0.0, "Translucency": 0.0},
    "uneven": {"Subsurface": 0.0, "Translucency": 1.0},
    "wandering": {"Subsurface": 1.0, "Scattering": 1.0},
}


def main() -> None:
    """Print a line for each skin."""
    samples = int(sys.argv[-1]) if sys.argv[-1].isdigit() else SAMPLES
    scene = bpy.context.scene
    _prepare(scene, samples)
    for name, inputs in SKINS.items():
        for node in _skins():
            for socket, value in inputs.items():
                node.inputs[socket].default_value = value
        eevee, cycles = (_render(scene, engine) for engine in (_eevee(), "CYCLES"))
        print(f"{name}: {_compared(eevee, cycles)}", flush=True)


def _skins() -> Iterator[Any]:
    for material in bpy.data.materials:
        node = material.node_tree.nodes.get(GROUP) if material.node_tree else None
        if node is not None and node.get("facestage_scatters"):
            yield node


def _eevee() -> str:
    return "BLENDER_EEVEE_NEXT" if (4, 2) <= bpy.app.version < (5, 0) else "BLENDER_EEVEE"


def _prepare(scene: Any, samples: int) -> None:
    render = scene.render
    render.resolution_x = render.resolution_y = SIDE_PX
    render.resolution_percentage, render.film_transparent = 100, True
    render.use_compositing = render.use_sequencer = False
    render.filter_size = 1.0
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.eevee.taa_render_samples = max(samples // 3, 1)
    cycles = scene.cycles
    cycles.samples, cycles.use_denoising, cycles.pixel_filter_type = samples, False, "BOX"
    cycles.use_adaptive_sampling = False
    for name in ("max", "diffuse", "glossy", "transmission", "volume"):
        setattr(cycles, f"{name}_bounces", 0)


def _render(scene: Any, engine: str) -> np.ndarray:
    """(h, w, 4) linear."""
    scene.render.engine = engine
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "picture.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        image.colorspace_settings.name, image.alpha_mode = "Non-Color", "CHANNEL_PACKED"
        pixels = np.array(image.pixels[:], np.float32).reshape(image.size[1], image.size[0], 4)
        bpy.data.images.remove(image)
    return pixels


def _compared(found: np.ndarray, wanted: np.ndarray) -> str:
    head = (found[..., 3] > 0.999) & (wanted[..., 3] > 0.999)
    inside = head.copy()
    for _ in range(2):
        inside[1:-1, 1:-1] &= (
            inside[:-2, 1:-1] & inside[2:, 1:-1] & inside[1:-1, :-2] & inside[1:-1, 2:]
        )
    one, other = (_blurred(picture[..., :3], head)[inside] for picture in (found, wanted))
    error = np.mean((np.clip(one, 0, 1) - np.clip(other, 0, 1)) ** 2)
    ratio = " ".join(f"{each:.3f}" for each in one.mean(axis=0) / other.mean(axis=0))
    return f"{-10 * np.log10(error):.1f} dB, mean {ratio} of Cycles'"


def _blurred(picture: np.ndarray, where: np.ndarray) -> np.ndarray:
    """By a Gaussian, of what lies ``where`` alone."""
    reach = np.arange(-5, 6)
    weights = np.exp(-0.5 * (reach / BLUR_PX) ** 2)

    def spread(values: np.ndarray) -> np.ndarray:
        for axis in (0, 1):
            values = sum(
                weight * np.roll(values, shift, axis)
                for shift, weight in zip(reach, weights, strict=True)
            )
        return values

    inside = where[..., None].astype(float)
    return spread(picture * inside) / np.maximum(spread(inside), 1e-9)


if __name__ == "__main__":
    main()
