"""Which kernels are compiled is reported."""

from __future__ import annotations

from numba import njit

from simloop.common.compile_listener import listening


def test_every_compiled_kernel_is_reported_once():
    heard = []

    @njit
    def fresh(x):
        return x + 1

    with listening(lambda name, count: heard.append((name, count))) as listener:
        fresh(1)
        fresh(2)
        fresh(1.0)
    fresh(True)
    assert heard == [("fresh", 1), ("fresh", 2)] and listener.count == 2
