"""What the commands share: options, Ctrl-C, and figures as JSON."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

INTERRUPTED = 130

Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Any key of the scenario, e.g. goal=[3.0,2.5]"),
]
JsonFile = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write the figures as JSON.")
]


@contextmanager
def stop_asked() -> Iterator[Callable[[], bool]]:
    """Tells whether Ctrl-C or a SIGTERM has come: asked for now and then, it cuts nothing off.

    An exception raised wherever the run happens to be could end in the middle of a compiled
    kernel or of what is being written.
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
    from simloop.common.terminal import compiling

    with compiling(notes) as report:
        yield report


def check_json(path: Path | None) -> None:
    from simloop.common.files import check_file

    if path is not None:
        check_file(path, "--json")


def write_json(path: Path | None, figures: dict[str, Any]) -> None:
    from simloop.common.files import write_text

    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(figures, indent=2) + "\n")
