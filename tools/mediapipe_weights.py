"""What MediaPipe's own 52 weights say of a film with known ones: the peer of ``facestage track``.

The network lies beside the landmarks' in the file that *Detect Landmarks* fetches; OpenCV cannot
run it, so this wants ``pip install ai-edge-litert`` (LiteRT, Apache-2.0). It gets the landmarks
that the tracker finds, frame by frame, as MediaPipe gives it its own.

    python tools/mediapipe_weights.py frames/ --truth truth.npz
"""

from __future__ import annotations

import argparse
import sys
import time
import zipfile
from pathlib import Path

import numpy as np

from facestage.images.image_io import read_photograph
from facestage.landmarks.finder import FaceFinder
from facestage.landmarks.model_file import open_model

# Of the 478 points those that the network looks at, and the names of what it says (MediaPipe,
# face_blendshapes_graph.cc).
# fmt: off
POINTS = [
    0, 1, 4, 5, 6, 7, 8, 10, 13, 14, 17, 21, 33, 37, 39, 40, 46, 52, 53, 54, 55, 58, 61, 63, 65, 66,
    67, 70, 78, 80, 81, 82, 84, 87, 88, 91, 93, 95, 103, 105, 107, 109, 127, 132, 133, 136, 144,
    145, 146, 148, 149, 150, 152, 153, 154, 155, 157, 158, 159, 160, 161, 162, 163, 168, 172, 173,
    176, 178, 181, 185, 191, 195, 197, 234, 246, 249, 251, 263, 267, 269, 270, 276, 282, 283, 284,
    285, 288, 291, 293, 295, 296, 297, 300, 308, 310, 311, 312, 314, 317, 318, 321, 323, 324, 332,
    334, 336, 338, 356, 361, 362, 365, 373, 374, 375, 377, 378, 379, 380, 381, 382, 384, 385, 386,
    387, 388, 389, 390, 397, 398, 400, 402, 405, 409, 415, 454, 466, 468, 469, 470, 471, 472, 473,
    474, 475, 476, 477,
]
# fmt: on
# Its number of each, by the name that ICT-FaceKit gives it.
WEIGHTS = {
    "jawOpen": 25,
    "mouthSmile_L": 44,
    "mouthSmile_R": 45,
    "eyeBlink_L": 9,
    "eyeBlink_R": 10,
    "browInnerUp_L": 3,
    "browInnerUp_R": 3,
}
NETWORK = "face_blendshapes.tflite"


def main() -> int:
    """Print each weight's correlation with the truth; 2: something is missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("frames", type=Path, help="folder of pictures, one a frame")
    parser.add_argument(
        "--truth", type=Path, required=True, help="npz with expression (F, e) and names (e,)"
    )
    parser.add_argument("--landmark-model", type=Path, help="face_landmarker.task")
    options = parser.parse_args()
    try:
        from ai_edge_litert.interpreter import Interpreter  # type: ignore[import-not-found]
    except ImportError:
        print("This tool needs LiteRT: pip install ai-edge-litert", file=sys.stderr)
        return 2
    model = open_model(options.landmark_model)
    finder = FaceFinder(model)
    with zipfile.ZipFile(model.path) as bundle:
        network = Interpreter(model_content=bundle.read(NETWORK))
    network.allocate_tensors()
    ends = network.get_input_details()[0]["index"], network.get_output_details()[0]["index"]
    found, seconds = [], 0.0
    for path in sorted(options.frames.glob("*.png")):
        photograph = read_photograph(path)
        start = time.process_time()
        faces = finder.find(photograph).faces
        if faces:
            points = faces[0].landmarks.points[POINTS]
            network.set_tensor(ends[0], points[None].astype(np.float32))
            network.invoke()
            found.append(network.get_tensor(ends[1]).copy())
        else:
            found.append(np.full(52, np.nan))
        seconds += time.process_time() - start
    with np.load(options.truth, allow_pickle=False) as truth:
        names, weights = truth["names"].tolist(), truth["expression"]
    said = np.array(found)
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
