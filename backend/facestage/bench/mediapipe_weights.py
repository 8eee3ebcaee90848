"""MediaPipe's own 52 weights, straight from the landmarks of each frame: the peer of a sequence.

Their network lies beside the landmarks' in the file that *Detect Landmarks* fetches; OpenCV cannot
run it, so this wants ``pip install ai-edge-litert`` (LiteRT, Apache-2.0).
"""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.landmarks import MEDIAPIPE
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
NETWORK, COUNT = "face_blendshapes.tflite", 52


class PeerMissingError(Exception):
    """Why there are no weights to compare with, as a sentence."""


def mediapipe_weights(
    landmarks: Sequence[Float[np.ndarray, "landmarks 2"]], scheme: str, model: Path | None = None
) -> Float[np.ndarray, "frames 52"]:
    """Of frames with ``landmarks`` in pixels; NaN where there are none. ``model``:
    face_landmarker.task. Raises PeerMissingError.
    """
    if scheme != MEDIAPIPE:
        raise PeerMissingError(f"MediaPipe's weights skipped: the landmarks are {scheme}'s.")
    try:
        from ai_edge_litert.interpreter import Interpreter  # type: ignore[import-not-found]
    except ImportError:
        raise PeerMissingError(
            "MediaPipe's weights skipped: they need LiteRT (pip install ai-edge-litert)."
        ) from None
    with zipfile.ZipFile(open_model(model).path) as bundle:
        network = Interpreter(model_content=bundle.read(NETWORK))
    network.allocate_tensors()
    ends = network.get_input_details()[0]["index"], network.get_output_details()[0]["index"]
    found = np.full((len(landmarks), COUNT), np.nan)
    for index, points in enumerate(landmarks):
        asked = points[POINTS].astype(np.float32)
        if np.isfinite(asked).all():
            network.set_tensor(ends[0], asked[None])
            network.invoke()
            found[index] = network.get_tensor(ends[1])
    return found
