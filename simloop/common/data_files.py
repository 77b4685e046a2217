"""Where the data files lie: beside the package in a checkout, inside it in an installed wheel."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent


def models_dir() -> Path:
    """Directory of ``tracked_ugv.xml`` and ``arenas/``. Raises FileNotFoundError if absent."""
    return _data_dir("models", "tracked_ugv.xml")


def scenarios_dir() -> Path:
    """Directory of the scenario files. Raises FileNotFoundError if absent."""
    return _data_dir("scenarios", ".")


def _data_dir(name: str, witness: str) -> Path:
    places = (_PACKAGE / "_data" / name, _PACKAGE.parent / name)
    for place in places:
        if (place / witness).exists():
            return place
    raise FileNotFoundError(f"simloop's {name} are missing: looked in {places[0]} and {places[1]}")
