"""Builds the light stage around a face rig.

python blender_scenes/light_stage.py --out stage.blend [--model default] [--lights 20]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from scene_setup import face_model, options_of, run

from facestage_blender.headless import pipeline
from facestage_blender.rig.face_rig import build_rig
from facestage_blender.scene.camera import ensure_camera, set_resolution
from facestage_blender.scene.stage import build_stage, default_stage, facestage_collection


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--model", default="default")
    parser.add_argument("--lights", type=int, default=20)
    options = options_of(parser)
    model = face_model(options.model)
    scene = pipeline.empty_scene()
    empty = build_stage(scene, default_stage(options.lights, radius=1.0, side=0.2))
    build_rig(scene, model, options.model, empty)
    ensure_camera(scene, facestage_collection(scene))
    set_resolution(scene, 768, 768)
    pipeline.save_blend(options.out.resolve())
    print(f"Scene: {options.out}")


if __name__ == "__main__":
    run(main)
