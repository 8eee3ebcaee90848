"""Photographs a made-up person whose truth is known.

python blender_scenes/synthetic_photo.py --out DIR [--seed 7] [--samples 128]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from scene_setup import face_model, options_of, run

from facestage_blender.headless import pipeline
from facestage_blender.synthetic.cases.person import random_person
from facestage_blender.synthetic.photograph import render_person


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--samples", type=int, default=128)
    options = options_of(parser)
    model = face_model()
    person = random_person(model, options.seed)
    render_person(
        pipeline.empty_scene(), model, person, options.out.resolve(), options.samples, options.seed
    )
    print(f"Photo and truth: {options.out}")


if __name__ == "__main__":
    run(main)
