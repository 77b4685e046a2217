"""Say what takes long, so that nobody thinks that the program hangs."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console


@contextmanager
def said_if_slow(console: Console, text: str, after_s: float = 1.0) -> Iterator[None]:
    """Print a line if what is done in the ``with`` block is not done soon.

    Args:
        console: The console to print to.
        text: What is being done, e.g. ``building the world``.
        after_s: Time after which the line is printed, s.

    Yields:
        Nothing.
    """

    def say() -> None:
        console.print(f"{text} ...", markup=False, highlight=False, soft_wrap=True)

    timer = threading.Timer(after_s, say)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()
