"""Grey images as maps of the ground."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from simloop.common.errors import InputError
from simloop.messages import FloatArray

_MOST_PIXELS = 16_000_000


def read_grey(file: str) -> FloatArray:
    """(rows, columns) from 0, black, to 1, white; row 0 is the smallest y, the image's lower edge.

    Raises InputError for what cannot be read.
    """
    try:
        data = Path(file).read_bytes()
    except OSError as error:
        raise InputError(f"image {file}: cannot be read: {error.strerror}") from None
    raw = np.frombuffer(data, np.uint8)
    try:
        image = cv2.imdecode(raw, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH) if len(raw) else None
    except cv2.error:
        image = None
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"image {file}: not a PNG image of 8 or 16 bits")
    if image.size > _MOST_PIXELS:
        raise InputError(f"image {file}: more than {_MOST_PIXELS} pixels")
    white = 255.0 if image.dtype == np.uint8 else 65535.0
    return np.ascontiguousarray(image[::-1].astype(np.float64) / white)
