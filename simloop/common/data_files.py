"""Find the data files: beside the package in a checkout, inside it in an installed wheel."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent


def models_dir() -> Path:
    """Find the directory of ``tracked_ugv.xml`` and ``arenas/``.

    Returns:
        The directory.

    Raises:
        FileNotFoundError: If there is none.
    """
    return _data_dir("models", "tracked_ugv.xml")


def scenarios_dir() -> Path:
    """Find the directory of the scenario files.

    Returns:
        The directory.

    Raises:
        FileNotFoundError: If there is none.
    """
    return _data_dir("scenarios", ".")


def own_files() -> list[Path]:
    """List the models and scenarios that belong to simloop.

    Returns:
        All files of both directories.

    Raises:
        FileNotFoundError: If there is no such directory.
    """
    folders = (models_dir(), scenarios_dir())
    return [path for folder in folders for path in folder.rglob("*") if path.is_file()]


def _data_dir(name: str, witness: str) -> Path:
    places = (_PACKAGE / "_data" / name, _PACKAGE.parent / name)
    for place in places:
        if (place / witness).exists():
            return place
    raise FileNotFoundError(
        f"simloop's {name} directory is missing: it is neither {places[0]} nor {places[1]}"
    )
