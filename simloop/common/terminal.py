"""Show progress and tables in the terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn

from simloop.common.errors import printable


@contextmanager
def compiling(console: Console) -> Iterator[Callable[[str, int], None]]:
    """Show which kernel is being compiled. Show nothing if all kernels are cached.

    Args:
        console: The console to use.

    Yields:
        A function to call with a kernel's name and number before it is compiled.
    """
    status = console.status("")
    began = False

    def report(name: str, count: int) -> None:
        nonlocal began
        text = f"compiling kernel {count}: {name} (later runs use the cache)"
        if console.is_terminal:
            status.update(text)
        if not began:
            began = True
            if console.is_terminal:
                status.start()
            else:
                console.print("compiling kernels for this run (later runs use the cache)")

    try:
        yield report
    finally:
        if began:
            status.stop()


@contextmanager
def progress_bar(
    console: Console, distance_m: float, time_limit_s: float
) -> Iterator[Callable[[float, float], None]]:
    """Show the robot's progress and the simulated time, if the console is a terminal.

    Args:
        console: The console to use. Nothing is shown if it is not a terminal.
        distance_m: Distance to the goal at the start, m.
        time_limit_s: The run's time limit, simulated s.

    Yields:
        A function to call with the simulated time, s, and the distance to the goal, m.
    """
    columns = (
        TextColumn("{task.fields[t]:6.1f} s simulated (limit {task.fields[limit]:g} s)"),
        BarColumn(bar_width=32),
        TextColumn("{task.fields[to_go]:5.2f} m to go"),
    )
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    with bar:
        task = bar.add_task("", total=1.0, t=0.0, limit=time_limit_s, to_go=distance_m)

        def advance(sim_time_s: float, to_go_m: float) -> None:
            share = 1.0 - to_go_m / distance_m if distance_m > 0.0 else 1.0
            bar.update(task, completed=max(0.0, share), t=sim_time_s, to_go=to_go_m)

        yield advance


@contextmanager
def counting(console: Console, what: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show how many of a number of items are done, if the console is a terminal.

    Args:
        console: The console to use. Nothing is shown if it is not a terminal.
        what: Name of the items, e.g. ``scans``.
        total: Number of items.

    Yields:
        A function to call with the number of items done.
    """
    columns = (
        TextColumn(what),
        BarColumn(bar_width=32),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
    )
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("", total=total)
        yield lambda done: bar.update(task, completed=done)


@contextmanager
def checking(console: Console) -> Iterator[Callable[[str, int], None]]:
    """Show the progress of checks, if the console is a terminal.

    Args:
        console: The console to use. Nothing is shown if it is not a terminal.

    Yields:
        A function to call with the name of the last check and the number of checks done.
    """
    status = console.status("checking")
    if console.is_terminal:
        status.start()
    try:
        yield lambda group, count: status.update(f"{count} checks done: {group}")
    finally:
        status.stop()


def print_table(
    console: Console, title: str, header: Sequence[str], rows: Sequence[Sequence[str]]
) -> None:
    """Print a table. Its lines are never wrapped, so that scripts can read it.

    Args:
        console: The console to print to.
        title: A line above the table; empty for no such line.
        header: The columns' names.
        rows: The rows, each with one text per column.
    """
    header = [_visible(cell) for cell in header]
    rows = [[_visible(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]

    def line(cells: Sequence[str]) -> str:
        return "  ".join(f"{cell:{width}}" for cell, width in zip(cells, widths, strict=True))

    if title:
        console.print(f"[bold]{escape(_visible(title))}[/]", highlight=False)
    console.print(f"  [dim]{escape(line(header).rstrip())}[/]", highlight=False, soft_wrap=True)
    for row in rows:
        console.print(f"  {escape(line(row).rstrip())}", highlight=False, soft_wrap=True)


def print_lines(console: Console, lines: Iterable[str], prefix: str = "") -> None:
    """Print sentences as they are, one line each.

    Args:
        console: The console to print to.
        lines: The sentences. They may quote a file.
        prefix: What stands before each of them.
    """
    for line in lines:
        text = f"{prefix}{printable(line)}"
        console.print(text, markup=False, highlight=False, soft_wrap=True)


def _visible(text: str) -> str:
    """Show control characters, which may come from a file, as escapes."""
    return "".join(one if one.isprintable() else ascii(one)[1:-1] for one in text)
