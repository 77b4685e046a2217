"""Pictures as text that goes straight into an HTML page."""

from __future__ import annotations

import base64
import io
from typing import Any


def embedded(data: bytes, kind: str = "png", alt: str = "") -> str:
    """An image's bytes as an ``img`` element."""
    text = base64.b64encode(data).decode()
    return f'<img alt="{alt}" src="data:image/{kind};base64,{text}">'


def drawn(figure: Any, alt: str = "") -> str:
    """A matplotlib figure as an ``img`` element."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    out = io.BytesIO()
    FigureCanvasAgg(figure).print_png(out)
    return embedded(out.getvalue(), "png", alt)
