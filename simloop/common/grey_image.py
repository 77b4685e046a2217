"""Read grey images that describe the ground: heights or friction."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simloop.common.pictures import read_picture
from simloop.messages import FloatArray

_MOST_PIXELS = 16_000_000


def read_grey(file: str) -> FloatArray:
    """Read a grey image.

    Args:
        file: A picture, e.g. a PNG file with 8 or 16 bits per pixel. Colours are averaged, and
            transparency has no meaning.

    Returns:
        (rows, columns) brightness from 0 (black) to 1 (white). Row 0 is the lower edge of the
        image, so that y grows with the row.

    Raises:
        InputError: If the file cannot be read, is not such an image, or is too large.
    """
    picture = read_picture(Path(file), _MOST_PIXELS)
    return np.ascontiguousarray(picture.levels[::-1].astype(np.float64) / picture.white)
