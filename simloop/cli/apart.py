"""Options of commands that keep their runs in a folder, and a check that no output is an input."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated

import typer

from simloop.common.errors import InputError

OWN_FILES = ("journal.jsonl", "campaign.json", "results.parquet", "report.html")
"""The files of a campaign's folder."""

_MORE_FILES = ("failures/**/*", "*.damaged*")

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
    """Refuse an output that cannot be written, or would overwrite an input or another output.

    Args:
        outputs: Files that are written, by the option (or the name) that gives them; None for an
            option that is not given.
        inputs: Files that are read. They need not exist.

    Raises:
        InputError: If an output cannot be written, is one of simloop's own files, or is the same
            file as an input or another output, also through links.
    """
    from simloop.common.files import FilePlan

    plan = FilePlan()
    for one in inputs:
        plan.reads(Path(one), f"the input {one}")
    for option, path in outputs.items():
        plan.writes(path, option)
    plan.check()


def files_in(folder: Path) -> list[Path]:
    """List the files of a campaign.

    Args:
        folder: The folder of its journal.

    Returns:
        The files that every such folder has, whether or not they exist; then the recordings of
        failed runs and the copies of damaged files that are there.
    """
    found = [folder / name for name in OWN_FILES]
    for pattern in _MORE_FILES:
        found += sorted(path for path in folder.glob(pattern) if path.is_file())
    return found


def outputs_of(out: Path) -> dict[str, Path | None]:
    """Name the files of the folder of ``--out`` for `check_apart`.

    Args:
        out: The folder of a journal.

    Returns:
        The files that every run of the command writes, each by a name for error messages.
    """
    return {f"{name} of --out": out / name for name in OWN_FILES}
