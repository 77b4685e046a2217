"""Read grey images that describe the ground: heights or friction."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from simloop.common.errors import InputError
from simloop.common.input_files import read_bytes
from simloop.common.limits import PICTURE_BYTES
from simloop.common.pictures import check_picture_size
from simloop.messages import FloatArray

_MOST_PIXELS = 16_000_000


def read_grey(file: str) -> FloatArray:
    """Read a grey image.

    Args:
        file: A PNG file with 8 or 16 bits per pixel.

    Returns:
        (rows, columns) brightness from 0 (black) to 1 (white). Row 0 is the lower edge of the
        image, so that y grows with the row.

    Raises:
        InputError: If the file cannot be read, is not such an image, or is too large.
    """
    check_picture_size(Path(file), _MOST_PIXELS)
    raw = np.frombuffer(read_bytes(Path(file), PICTURE_BYTES), np.uint8)
    try:
        image = cv2.imdecode(raw, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH) if len(raw) else None
    except cv2.error:
        image = None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"image {file}: not a PNG image of 8 or 16 bits")
    white = 255.0 if image.dtype == np.uint8 else 65535.0
    return np.ascontiguousarray(image[::-1].astype(np.float64) / white)
