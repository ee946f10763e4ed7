"""Whether a PNG is a picture: it can be read, and something is drawn on it."""

import io

import numpy as np
from matplotlib.image import imread


def ink(png: bytes) -> float:
    """Share of a picture's pixels that differ from its corner, the background."""
    pixels = np.asarray(imread(io.BytesIO(png), format="png"))
    assert min(pixels.shape[:2]) > 100
    return float(np.mean(np.any(pixels != pixels[0, 0], axis=-1)))


def is_drawn(png: bytes) -> bool:
    """Lines, letters and axes cover some hundredths of a figure; a blank one has none."""
    return 0.01 < ink(png) < 0.9
