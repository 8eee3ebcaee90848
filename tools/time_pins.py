"""Time a drag of a pin in Blender: processor time of each move of the mouse, and how it ends.

    facestage model default --out head.npz
    OPENBLAS_NUM_THREADS=1 python tools/time_pins.py head.npz

Noisy landmarks of a random face (478, half a pixel; photo of 512 pixels) place the face; then the
corner of the mouth is dragged away in 20 moves. docs/pins.md has the table.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import bpy
import numpy as np

import addon_utils  # isort: skip

from facestage.contract.face_model import FaceModel
from facestage.contract.files.storage import write_json
from facestage.contract.landmarks import MEDIAPIPE

SIDE, MOVES = 512, 20
MOUTH_CORNER = 61  # of MediaPipe's points
STEP = np.array([0.5, -0.5])  # pixels
NOISE = 0.5  # pixels


def main() -> None:
    """Print a line for each model."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("models", nargs="+", type=Path, metavar="NPZ")
    models = parser.parse_args().models
    with tempfile.TemporaryDirectory() as folder:
        for path in models:
            print(timed(FaceModel.load(path), Path(folder)))


def timed(model: FaceModel, folder: Path) -> str:
    """What a drag takes on the rig of ``model``."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    addon_utils.enable("facestage_blender", default_set=True)
    from facestage_blender.landmarks.editing import choose_landmarks
    from facestage_blender.pins import overlay
    from facestage_blender.pins.pinning import Pinning, Setting, place_by_landmarks
    from facestage_blender.pins.solver import Guess, positions
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.rig.landmark_points import landmark_points
    from facestage_blender.scene.stage import ensure_stage

    scene, random = bpy.context.scene, np.random.default_rng(0)
    photo = folder / "photo.png"
    picture = bpy.data.images.new("photo", SIDE, SIDE)
    picture.filepath_raw, picture.file_format = str(photo), "PNG"
    picture.save()
    bpy.ops.facestage.choose_photo(filepath=str(photo))
    rig = build_rig(scene, model, "default", ensure_stage(scene))
    setting = Setting.of(scene)
    shapes = setting.shapes(*landmark_points(rig, MEDIAPIPE)[1:])
    start = setting.guess()
    weights = np.where(shapes.low < 0, 0.7, 0.15) * random.normal(size=len(shapes.low))
    truth = Guess(start.to_camera, np.maximum(weights, shapes.low)).turned(
        np.r_[0.1, 0.25, 0.05, 0.02, 0.01, -0.1, 0 * weights], start.to_camera[:3, 3]
    )
    pixels = setting.lens.project(positions(shapes, truth))
    noisy = pixels + NOISE * random.normal(size=pixels.shape)
    write_json(folder / "landmarks.json", {"scheme": MEDIAPIPE, "points": noisy.tolist()})
    choose_landmarks(scene, folder / "landmarks.json")
    place_by_landmarks(scene)

    def wire() -> None:
        to_camera = setting.guess().to_camera
        points = overlay.shown_vertices(rig, bpy.context.evaluated_depsgraph_get())
        seen = setting.lens.project(points @ to_camera[:3, :3].T + to_camera[:3, 3])
        overlay.wire_color(seen, overlay.drawn_mesh(rig).front_edges(seen))

    at = pixels[MOUTH_CORNER]
    began = time.process_time()
    pinning = Pinning(scene)
    before = setting.lens.project(positions(shapes, pinning.guess))
    pin = pinning.grab(at)
    hold = 1e3 * (time.process_time() - began)
    wire()
    times = np.array(
        [
            [
                _milliseconds(partial(pinning.move, pin, at + STEP * (move + 1))),
                _milliseconds(bpy.context.view_layer.update),
                _milliseconds(wire),
            ]
            for move in range(MOVES)
        ]
    )
    spent = np.median(times, axis=0)
    away = float(np.linalg.norm(pinning.shown[pin] - pinning.pins.points[pin]))
    after = setting.lens.project(positions(shapes, pinning.guess))
    moved = float(np.median(np.linalg.norm(after - before, axis=1)))
    return (
        f"{model.name}: solver {spent[0]:.1f} ms, shape keys {spent[1]:.1f} ms, wireframe "
        f"{spent[2]:.1f} ms, together {spent.sum():.1f} ms; taking hold {hold:.0f} ms; the pin "
        f"ends {away:.3f} px off, the landmarks' median moves by {moved:.2f} px"
    )


def _milliseconds(act: Callable[[], object]) -> float:
    """Processor time."""
    began = time.process_time()
    act()
    return 1e3 * (time.process_time() - began)


if __name__ == "__main__":
    main()
