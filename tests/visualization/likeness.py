"""How like two pictures are to an eye: structural similarity (Wang et al., IEEE Trans. Image Proc. 13(4), 2004)."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter

Pixels = NDArray[np.float64]
SIZE = (400, 300)
_SIGMA, _C1, _C2 = 1.5, (0.01 * 255) ** 2, (0.03 * 255) ** 2


def picture(data: bytes, size: tuple[int, int] = SIZE) -> Pixels:
    """Return an image file's colours (height, width, 3), 0 to 255, at a size at which drivers hardly differ."""
    image = Image.open(io.BytesIO(data)).convert("RGB")
    return np.asarray(image.resize(size, Image.Resampling.BOX), dtype=float)


def likeness(one: Pixels, other: Pixels) -> Pixels:
    """Return how like they are around each pixel (height, width), 1 for the same; the worst of the three colours."""

    def blurred(values: Pixels) -> Pixels:
        return gaussian_filter(values, (_SIGMA, _SIGMA, 0.0))

    mean, other_mean = blurred(one), blurred(other)
    variance, other_variance = blurred(one**2) - mean**2, blurred(other**2) - other_mean**2
    shared = blurred(one * other) - mean * other_mean
    top = (2.0 * mean * other_mean + _C1) * (2.0 * shared + _C2)
    bottom = (mean**2 + other_mean**2 + _C1) * (variance + other_variance + _C2)
    return np.asarray((top / bottom).min(axis=2))


def mean_likeness(one: Pixels, other: Pixels) -> float:
    """Return the mean over the picture."""
    return float(likeness(one, other).mean())
