"""Embed images in an HTML page, so that the page needs no other file."""

from __future__ import annotations

import base64
import io
from typing import Any


def embedded(data: bytes, kind: str = "png", alt: str = "") -> str:
    """Make an HTML ``img`` element from an image file's bytes.

    Args:
        data: The bytes of the image file.
        kind: The image format: ``png`` or ``jpeg``.
        alt: The text that is shown if the image cannot be shown.

    Returns:
        The element.
    """
    text = base64.b64encode(data).decode()
    return f'<img alt="{alt}" src="data:image/{kind};base64,{text}">'


def drawn(figure: Any, alt: str = "") -> str:
    """Draw a matplotlib figure as an HTML ``img`` element.

    Args:
        figure: The figure.
        alt: The text that is shown if the image cannot be shown.

    Returns:
        The element, with a PNG image inside.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    out = io.BytesIO()
    FigureCanvasAgg(figure).print_png(out)
    return embedded(out.getvalue(), "png", alt)
