"""What MediaPipe's own 52 weights say of a film with known ones, each frame searched for itself.

``facestage bench --sequence`` says so beside the fit. This wants ``pip install ai-edge-litert``
(LiteRT, Apache-2.0), too.

    python tools/mediapipe_weights.py frames/ --truth truth.npz
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from facestage.bench.mediapipe_weights import WEIGHTS, PeerMissingError, mediapipe_weights
from facestage.images.image_io import read_photograph
from facestage.landmarks.finder import SCHEME, FaceFinder
from facestage.landmarks.model_file import open_model


def main() -> int:
    """Print each weight's correlation with the truth; 2: something is missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("frames", type=Path, help="folder of pictures, one a frame")
    parser.add_argument(
        "--truth", type=Path, required=True, help="npz with expression (F, e) and names (e,)"
    )
    parser.add_argument("--landmark-model", type=Path, help="face_landmarker.task")
    options = parser.parse_args()
    finder = FaceFinder(open_model(options.landmark_model))
    found, start = [], time.process_time()
    for path in sorted(options.frames.glob("*.png")):
        faces = finder.find(read_photograph(path)).faces
        found.append(faces[0].landmarks.points if faces else np.full((478, 2), np.nan))
    try:
        said = mediapipe_weights(found, SCHEME, options.landmark_model)
    except PeerMissingError as error:
        print(error, file=sys.stderr)
        return 2
    seconds = time.process_time() - start
    with np.load(options.truth, allow_pickle=False) as truth:
        names, weights = truth["names"].tolist(), truth["expression"]
    seen = np.isfinite(said).all(axis=1)
    print(f"{seen.sum()} of {len(said)} frames, {seconds / len(said):.2f} s of processor time each")
    for name, number in WEIGHTS.items():
        true = weights[seen, names.index(name)]
        correlation = np.corrcoef(said[seen, number], true)[0, 1]
        slope = np.polyfit(true, said[seen, number], 1)[0]
        print(f"{name}: correlation {correlation:.3f}, {slope:.2f} of the true weight's change")
    return 0


if __name__ == "__main__":
    sys.exit(main())
