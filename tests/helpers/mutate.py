"""Damage files at random, as a fuzzer does: bits, bytes, cuts, doubled and swapped pieces."""

from __future__ import annotations

import numpy as np

NASTY = (
    b"", b"\x00", b"\xff" * 4, b"-1", b"nan", b"1e999", b"9" * 400, b"[" * 300, b"{a: " * 50,
    b"&a [*a]", b"\n", b"\t", b"# ", b"'", b"\x1b[31m", b"99999 99999", b"<<: *n\n", b"! ",
    "\u00e9\u2028".encode(), b"\xef\xbb\xbf",
)  # fmt: skip


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Damage a file in one to four places.

    Args:
        data: The whole file.
        rng: Random generator of all draws.

    Returns:
        The damaged file.
    """
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(0, len(out) + 1))
        size = int(rng.integers(0, 1 + min(12, len(out) - at)))
        kind = rng.integers(6)
        if kind == 0 and at < len(out):
            out[at] ^= 1 << int(rng.integers(8))
        elif kind == 1 and at < len(out):
            out[at] = int(rng.integers(256))
        elif kind == 2:
            del out[at : at + size]
        elif kind == 3:
            out[at:at] = out[at : at + size] * int(rng.integers(1, 4))
        elif kind == 4:
            out[at : at + size] = NASTY[int(rng.integers(len(NASTY)))]
        elif rng.random() < 0.2:
            del out[at:]
    return bytes(out)
