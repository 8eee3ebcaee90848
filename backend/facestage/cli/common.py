"""What several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

MODELS = (
    "default (built in), ict:PATH (ICT-FaceKit), flame:PATH, bfm:PATH (Basel Face Model), gnm:PATH "
    "(GNM Head), rig:FILE (a mesh exported from Blender) or npz:FILE (any of them as saved by "
    "facestage model)"
)


def add_finding(command: Any) -> None:
    """The options of every command that finds faces."""
    command.add_argument(
        "--face",
        type=int,
        metavar="K",
        help="which face of several: 1 is the largest (default), 2 the next, ...",
    )
    command.add_argument(
        "--landmark-model",
        type=Path,
        metavar="FILE",
        help="MediaPipe's face_landmarker.task (default: $FACESTAGE_LANDMARK_MODEL, the "
        "cache, else fetched once)",
    )
