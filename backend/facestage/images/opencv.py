"""OpenCV, imported so that it reads EXR and says nothing of its own."""

from __future__ import annotations

import os
from typing import Any

from facestage.contract.errors import BackendUnavailableError

# Packages of one module take each other's place.
REMEDY = (
    "pip uninstall opencv-python opencv-python-headless opencv-contrib-python, then "
    "pip install --force-reinstall opencv-contrib-python-headless"
)


def opencv() -> Any:
    """The module ``cv2``.

    Raises BackendUnavailableError where another of OpenCV's packages has taken the place of the one
    with all modules.
    """
    # OpenCV reads EXR only when this is set before its first import.
    os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"
    import cv2

    if not hasattr(cv2, "ximgproc"):
        raise BackendUnavailableError(
            f"OpenCV {cv2.__version__} at '{cv2.__file__}' lacks its module ximgproc; run: "
            f"{REMEDY}."
        )
    # What is wrong with a file is said once, by the error it raises. OpenCV 4.12 moved the
    # function.
    (cv2.setLogLevel if hasattr(cv2, "setLogLevel") else cv2.utils.logging.setLogLevel)(0)
    return cv2
