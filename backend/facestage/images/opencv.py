"""OpenCV, imported so that it reads EXR and says nothing of its own."""

from __future__ import annotations

import os
from typing import Any


def opencv() -> Any:
    """The module ``cv2``."""
    # OpenCV reads EXR only when this is set before its first import.
    os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"
    import cv2

    # What is wrong with a file is said once, by the error it raises. OpenCV 4.12 moved the
    # function.
    (cv2.setLogLevel if hasattr(cv2, "setLogLevel") else cv2.utils.logging.setLogLevel)(0)
    return cv2
