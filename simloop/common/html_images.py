"""Make HTML pages from templates, with embedded images, so that a page needs no other file."""

from __future__ import annotations

import base64
import importlib
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from simloop.common.errors import InputError


def check_libraries(option: str, names: Sequence[str] = ("jinja2", "matplotlib")) -> None:
    """Check that the libraries of a report are installed.

    Args:
        option: The option that asks for the report, for the error message.
        names: The libraries.

    Raises:
        InputError: If one is missing.
    """
    for name in names:
        try:
            importlib.import_module(name)
        except ImportError:
            raise InputError(
                f"{option} needs the library {name}: pip install 'simloop[report]'"
            ) from None


def filled(
    template: Path, values: Mapping[str, Any], figure: Callable[..., str] | None = None
) -> str:
    """Fill a page's template. Texts are escaped unless the template marks them as safe.

    Args:
        template: The template's file.
        values: The template's variables.
        figure: The template's filter ``figure``, which formats a number; None if it has none.

    Returns:
        HTML text.
    """
    jinja2 = importlib.import_module("jinja2")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    if figure is not None:
        environment.filters["figure"] = figure
    text: str = environment.from_string(template.read_text(encoding="utf-8")).render(**values)
    return text


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
