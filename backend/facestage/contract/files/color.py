"""Color as pictures hold it: linear Rec. 709, and sRGB where a screen or a file wants codes."""

from __future__ import annotations

import numpy as np

# Luminance of linear red, green and blue (ITU-R BT.709).
REC709 = (0.2126, 0.7152, 0.0722)


def srgb_to_linear(value: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, decoding; 0..1 in and out, any shape."""
    return np.where(
        value <= 0.04045, value / 12.92, ((np.maximum(value, 0.0) + 0.055) / 1.055) ** 2.4
    )


def linear_to_srgb(value: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, encoding; 0..1 in and out, any shape."""
    return np.where(
        value <= 0.0031308, value * 12.92, 1.055 * np.maximum(value, 0.0031308) ** (1 / 2.4) - 0.055
    )
