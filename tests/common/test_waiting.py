"""A line for what takes long, and none for what does not."""

from __future__ import annotations

import io
import threading

import pytest
from rich.console import Console

from simloop.common.waiting import said_if_slow


def test_what_is_slow_is_said_once_and_what_is_quick_is_not():
    out, printed = io.StringIO(), threading.Event()

    class Listening(Console):
        def print(self, *args, **kwargs):
            super().print(*args, **kwargs)
            printed.set()

    console = Listening(file=out)
    with said_if_slow(console, "making [a] world", after_s=0.01):
        assert printed.wait(10.0)
    with said_if_slow(console, "nothing", after_s=1000.0):
        pass
    with pytest.raises(KeyError), said_if_slow(console, "nothing", after_s=1000.0):
        raise KeyError
    assert out.getvalue() == "making [a] world ...\n"
