"""Read pictures that others made as brightness: PNG, PGM, JPEG, BMP and TIFF files.

Pillow reads a picture's size before its pixels, and its transparency and orientation together.
OpenCV does not. A PGM is read here: Pillow takes a microsecond for each byte of padding in its
header or of a plain picture, and OpenCV does not scale a PGM by its own maximum.
"""

from __future__ import annotations

import io
import logging
import re
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps

from simloop.common.errors import InputError
from simloop.common.input_files import read_bytes
from simloop.common.limits import PICTURE_BYTES, PIXELS, TEXT_BYTES, check_limit

FORMATS = ("PNG", "JPEG", "BMP", "TIFF")
"""The formats that are read besides PGM, by Pillow's names."""

# Pillow also logs what it then raises as an error; without a handler that goes to the terminal.
logging.getLogger("PIL").addHandler(logging.NullHandler())

# Spaces and comments, and a number. The possessive ``+`` never tries a shorter gap again, so the
# time is linear in the length.
_HEADER_NUMBER = re.compile(rb"(?:\s|#[^\n]*\n){0,65536}+(\d{1,10})(?!\d)")
_ROUND = 1e-3  # of a floating-point pixel, less than half a step of 8 bits
_COMMENT = re.compile(rb"#[^\n]*")


class Picture(NamedTuple):
    """A picture without its colours.

    Attributes:
        levels: (rows, columns) uint8 or uint16, brightness: the sum of the colours, where 0 is
            black and ``white`` is white. Row 0 is the upper edge.
        white: The level of white: 255, 65535, or 765 for three colours of 8 bits.
        opacity: (rows, columns) uint8, 0 where the picture is transparent to 255; None if all of
            it is opaque.
    """

    levels: NDArray[np.uint8] | NDArray[np.uint16]
    white: int
    opacity: NDArray[np.uint8] | None


def read_picture(path: Path, most_pixels: int = PIXELS, *, as_shown: bool = True) -> Picture:
    """Read a picture.

    Args:
        path: The file. Its content tells its format.
        most_pixels: Largest number of pixels.
        as_shown: Turn the picture as its EXIF orientation asks for, as a viewer does.

    Returns:
        The picture. Colours of 16 bits are read with 8 bits, grey with all 16.

    Raises:
        InputError: If the file cannot be read, is no such picture, is cut off, or is too large.
    """
    data = read_bytes(path, PICTURE_BYTES)
    if data[:2] in (b"P2", b"P5"):
        return _read_pgm(path, data, most_pixels)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what matters is an error
        image = _open(path, data, most_pixels)
        try:
            image.load()
            return _levels(ImageOps.exif_transpose(image) if as_shown else image)
        except MemoryError:
            raise InputError(f"{path}: takes more memory than there is") from None
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        except Exception as error:
            # Pillow's readers raise whatever a damaged file makes them stumble over.
            raise InputError(f"{path}: damaged or cut off: {error}") from None


def _open(path: Path, data: bytes, most_pixels: int) -> Image.Image:
    """Read the header of a picture, and check the size that it tells."""
    try:
        image: Image.Image = Image.open(io.BytesIO(data), formats=FORMATS)
    except Image.DecompressionBombError:
        raise InputError(f"{path}: more than {most_pixels:,} pixels") from None
    except Exception:
        kinds = "PNG, PGM, JPEG, BMP or TIFF"
        raise InputError(f"{path}: not a picture that can be read ({kinds})") from None
    _check_size(path, *image.size, most_pixels)
    return image


def _check_size(path: Path, columns: int, rows: int, most_pixels: int) -> None:
    if not 0 < columns * rows <= most_pixels:
        raise InputError(f"{path}: {columns} x {rows} pixels; 1 to {most_pixels:,} are allowed")


def _pgm_header(path: Path, data: bytes, most_pixels: int) -> tuple[int, int, int, int]:
    """Read columns, rows, the level of white, and where the pixels begin."""
    at, numbers = 2, []
    for _ in range(3):
        found = _HEADER_NUMBER.match(data, at)
        if found is None:
            raise InputError(f"{path}: not a PGM picture: its header ends at byte {at}")
        numbers.append(int(found[1]))
        at = found.end()
    columns, rows, white = numbers
    _check_size(path, columns, rows, most_pixels)
    if not 0 < white < 65536 or not data[at : at + 1].isspace():
        raise InputError(f"{path}: not a PGM picture: white is {white}; 1 to 65535 are allowed")
    return columns, rows, white, at + 1


def _read_pgm(path: Path, data: bytes, most_pixels: int) -> Picture:
    """Read a binary (P5) or plain (P2) PGM of 8 or 16 bits, scaled by its own level of white."""
    columns, rows, white, at = _pgm_header(path, data, most_pixels)
    count, kind = columns * rows, np.dtype(np.uint8) if white < 256 else np.dtype(">u2")
    if data[:2] == b"P5":
        body = memoryview(data)[at : at + count * kind.itemsize]
        whole = len(body) == count * kind.itemsize
        flat = np.frombuffer(body, kind) if whole else np.zeros(0, kind)
    else:
        check_limit(len(data), TEXT_BYTES, f"{path}: size of a plain PGM", "bytes")
        text = _COMMENT.sub(b"", data[at:])
        flat = _numbers(text.decode("latin-1"), count)
    if len(flat) != count or int(flat.max()) > white or int(flat.min()) < 0:
        raise InputError(
            f"{path}: cut off, or values that are not {columns} x {rows} numbers of 0 to {white}"
        )
    full = 255 if white < 256 else 65535
    table = np.round(np.arange(white + 1) * (full / white)).astype(kind.newbyteorder("="))
    return Picture(table[flat].reshape(rows, columns), full, None)


def _numbers(text: str, count: int) -> NDArray[np.int64]:
    """Read whole numbers, up to the first thing that is none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return np.fromstring(text, dtype=np.int64, count=count, sep=" ")
        except ValueError:
            return np.zeros(0, np.int64)


def _levels(image: Image.Image) -> Picture:
    """Read the brightness of a picture of any mode."""
    mode, opacity = image.mode, None
    if mode in ("I;16", "I;16L", "I;16B"):
        levels = np.asarray(image).astype(np.uint16)
        hidden = image.info.get("transparency")
        if isinstance(hidden, int):
            opacity = np.where(levels == hidden, 0, 255).astype(np.uint8)
        return Picture(levels, 65535, opacity)
    if mode == "F":
        shares = np.asarray(image)
        if not np.isfinite(shares).all():
            raise ValueError("a pixel is not a finite number")
        low, high = float(shares.min()), float(shares.max())
        if low < -_ROUND or high > 1.0 + _ROUND:
            # What is white there cannot be told: 255, 65535, or a length in some unit.
            raise InputError(
                f"floating-point pixels from {low:.4g} to {high:.4g}; only 0 (black) to 1 (white) "
                "are read: save it with 8 or 16 bits a pixel"
            )
        return Picture(np.rint(np.clip(shares, 0.0, 1.0) * 65535.0).astype(np.uint16), 65535, None)
    if mode == "I":
        raise ValueError("32 bits a pixel; at most 16 are read")
    grey = mode in ("1", "L", "LA", "La")
    clear = image.has_transparency_data
    if grey and not clear:
        return Picture(np.asarray(image.convert("L")), 255, None)
    bands = np.asarray(image.convert(("LA" if grey else "RGBA") if clear else "RGB"))
    if clear:
        opacity = bands[..., -1].copy()
        opacity = None if opacity.min() == 255 else opacity
        bands = bands[..., :-1]
    if grey:
        return Picture(bands[..., 0].copy(), 255, opacity)
    return Picture(bands.sum(axis=2, dtype=np.uint16), 765, opacity)
