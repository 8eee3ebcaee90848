"""The picture that is shown while a fit runs: the photo and the fit, side by side."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from facestage.contract.files.atomic import atomic_file
from facestage.report.color import exposure, shrink, to_image

PREVIEW_SIDE = 400  # pixels; larger ones take longer to compress than a step may spare


def write_preview(path: Path, photo: np.ndarray, render: np.ndarray) -> None:
    """Write ``photo`` and ``render`` (h, w, 3) linear beside each other as a small sRGB PNG.

    Whoever watches ``path`` sees the previous preview or this one, never half of it. Both pictures
    have the exposure of the photo and are shrunk to at most PREVIEW_SIDE pixels.
    """
    pair = np.concatenate([_small(photo), _small(render)], axis=1)
    with atomic_file(Path(path)) as temporary:
        to_image(exposure(photo) * pair).save(temporary, format="PNG", compress_level=1)


def _small(linear: np.ndarray) -> np.ndarray:
    """The picture at preview size; of a large one only every so many pixels are read, for speed."""
    stride = max(1, max(linear.shape[:2]) // (2 * PREVIEW_SIDE))
    return shrink(linear[::stride, ::stride], PREVIEW_SIDE)
