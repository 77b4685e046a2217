"""Write figures as JSON that every reader takes: without NaN and infinity."""

from __future__ import annotations

import json
import math
from typing import Any


def json_text(figures: Any) -> str:
    """Format figures as JSON.

    Args:
        figures: Tables, lists, texts and numbers.

    Returns:
        The text, indented, with a line break at its end. A number that is not finite is null, as
        JSON has no such numbers.
    """
    try:
        return json.dumps(figures, indent=2, allow_nan=False) + "\n"
    except ValueError:
        return json.dumps(_finite(figures), indent=2, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part) for part in value]
    return value
