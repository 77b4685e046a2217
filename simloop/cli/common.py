"""Common parts of the commands: options, a clean stop at Ctrl-C, and figures as JSON."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from simloop.cli.edge import INTERRUPTED

__all__ = [
    "INTERRUPTED",
    "JsonFile",
    "NumberOfWorkers",
    "Overrides",
    "check_json",
    "compiling_shown",
    "stop_asked",
    "write_json",
]

Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help='Change a key of the scenario, e.g. "goal=[3.0,2.5]"; repeatable.',
    ),
]
JsonFile = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write all figures as JSON.")
]
NumberOfWorkers = Annotated[
    int, typer.Option(min=0, max=256, help="Number of processes; 0: as many as cores.")
]


@contextmanager
def stop_asked() -> Iterator[Callable[[], bool]]:
    """Store Ctrl-C and SIGTERM instead of raising KeyboardInterrupt.

    The command checks for them at places where it can stop. An exception could interrupt a
    compiled kernel or a file that is being written.

    Yields:
        A function that tells whether a signal has arrived.
    """
    heard: list[int] = []
    signals = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(one, lambda number, _: heard.append(number)) for one in signals]
    try:
        yield lambda: bool(heard)
    finally:
        for one, handler in zip(signals, before, strict=True):
            signal.signal(one, handler)


@contextmanager
def compiling_shown(notes: Console) -> Iterator[Callable[[str, int], None]]:
    """Show which kernels are being compiled.

    Args:
        notes: Console for the messages.

    Yields:
        A function to call with a kernel's name and number before it is compiled.
    """
    # Imported here because rich's progress bars would slow down ``simloop --help``.
    from simloop.common.terminal import compiling

    with compiling(notes) as report:
        yield report


def check_json(path: Path | None, read: Mapping[Path, str] | None = None) -> None:
    """Check that the file of ``--json`` can be written, and replaces nothing that is read.

    Args:
        path: The file; None if ``--json`` is not given.
        read: Files that the command reads, each with what it is.

    Raises:
        InputError: If the file cannot be written, or is one of those that are read.
    """
    from simloop.common.files import FilePlan

    if path is None:
        return
    plan = FilePlan()
    plan.reads_all(read or {})
    plan.writes(path, "--json")
    plan.check()


def write_json(path: Path | None, figures: dict[str, Any]) -> None:
    """Write the file of ``--json``.

    Args:
        path: The file; its directory is created if needed. None if ``--json`` is not given.
        figures: The figures to write.

    Raises:
        InputError: If the file cannot be written.
    """
    from simloop.common.files import make_directory, write_text
    from simloop.common.json_text import json_text

    if path is not None:
        make_directory(path.parent)
        write_text(path, json_text(figures))
