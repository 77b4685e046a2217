"""Options of commands that keep their runs in a folder, and a check that no output is an input."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated

import typer

from simloop.common.errors import InputError

OWN_FILES = ("journal.jsonl", "campaign.json", "results.parquet", "report.html")
"""The files of a campaign's folder."""

Redo = Annotated[
    str | None,
    typer.Option(metavar="errors", help="Do the runs again that ended with the outcome error."),
]
Repair = Annotated[
    bool,
    typer.Option("--repair", help="Keep what is whole of damaged files in DIR, with a copy."),
]


def check_redo(redo: str | None) -> None:
    """Check the value of ``--redo``.

    Args:
        redo: The value; None if the option is not given.

    Raises:
        InputError: If it is not ``errors``.
    """
    if redo not in (None, "errors"):
        raise InputError(f"--redo {redo}: unknown; write --redo errors")


def check_apart(outputs: Mapping[str, Path | None], inputs: Iterable[str | Path]) -> None:
    """Refuse an output that would overwrite an input or another output.

    Args:
        outputs: Files that are written, by the option (or the name) that gives them; None for an
            option that is not given.
        inputs: Files that are read. Those that do not exist are left out.

    Raises:
        InputError: If two of them are the same file, also through links.
    """
    read = {_identity(Path(one)): str(one) for one in inputs if os.path.exists(one)}
    written: dict[object, str] = {}
    for option, path in outputs.items():
        if path is None or (path.exists() and not path.is_file()):
            continue  # a device such as /dev/null can be written twice
        one = _identity(path)
        if one in read:
            raise InputError(f"{option} {path}: this would overwrite the input {read[one]}")
        if one in written:
            raise InputError(f"{option} {path}: the same file as {written[one]}")
        written[one] = f"{option} {path}"


def _identity(path: Path) -> object:
    """Identify a file by what it is, or by its full path if it does not exist."""
    try:
        status = path.stat()
        return status.st_dev, status.st_ino
    except OSError:
        return os.path.realpath(path)
