"""Shows what a fit is good for: the face relit from every side and in other expressions.

python blender_scenes/showcase.py --result DIR --out DIR [--samples 32]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from scene_setup import face_model, options_of, run

from facestage.contract.result import Result
from facestage_blender.exchange.write_back import apply_result
from facestage_blender.headless import pipeline
from facestage_blender.pictures.render import render_linear, save_png, srgb
from facestage_blender.rig.face_rig import build_rig, read_weights, set_weights
from facestage_blender.scene.frames import LIGHT_DIRECTIONS
from facestage_blender.scene.relight import relight, restore_lights
from facestage_blender.scene.stage import build_stage

EXPRESSIONS = {
    "smile": {
        "mouthSmileLeft": 0.8,
        "mouthSmileRight": 0.8,
        "cheekSquintLeft": 0.5,
        "cheekSquintRight": 0.5,
    },
    "surprise": {"jawOpen": 0.75, "browInnerUp": 0.9, "eyeWideLeft": 0.6, "eyeWideRight": 0.6},
    "anger": {
        "browDownLeft": 0.9,
        "browDownRight": 0.9,
        "noseSneerLeft": 0.6,
        "noseSneerRight": 0.6,
        "mouthFrownLeft": 0.4,
    },
    "pucker": {"mouthPucker": 0.9},
    "wink": {"eyeBlinkLeft": 1.0, "mouthSmileLeft": 0.6},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--result", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--samples", type=int, default=32)
    options = options_of(parser)
    result = Result.load(options.result.resolve())
    out = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    model = face_model(result.model)
    scene = pipeline.empty_scene()
    rig = build_rig(scene, model, result.model, build_stage(scene, result.stage))
    apply_result(scene, result)

    def picture(name: str) -> None:
        save_png(
            out / f"{name}.png", srgb(render_linear(scene, options.samples, denoise=True)[..., :3])
        )

    for side in LIGHT_DIRECTIONS:
        relight(scene, side)
        picture(f"light_{side}")
    restore_lights(scene)
    _, fitted = read_weights(rig)
    for name, weights in EXPRESSIONS.items():
        set_weights(rig, {}, {key: weights.get(key, 0.0) for key in fitted})
        picture(f"expression_{name}")
    set_weights(rig, {}, fitted)
    pipeline.save_blend(out / "showcase.blend")
    print(f"Pictures and scene: {out}")


if __name__ == "__main__":
    run(main)
