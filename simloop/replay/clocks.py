"""Give times to the scans of a log. The order of the scans is that of the file, whatever they say.

The stamps of a log may be zero, rounded, or fall. So a clock counts only where it rises: at the
stamps of a longest rising sequence. The other scans get times between those of their neighbours.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simloop.messages import FloatArray

MADE_UP_S = 1.0
"""Time between two scans if no clock of the log rises, s."""

_LAST_S = 4e9  # stamps outside this range, in the year 2096, are no seconds since 1970
_UNITS = (("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9))
_LEAST_SHARE = 0.02  # share of the scans that must have a stamp in the rising sequence
_LEAST_IN_ORDER = 0.5  # share of the scans whose stamp must lie between its neighbours' stamps


@dataclass(frozen=True, slots=True, eq=False)
class Times:
    """Times of the scans of a log.

    Attributes:
        t_s: (n,) rising, s.
        clocks_s: each clock of the log, (n,); NaN where a stamp is not in its rising sequence.
        measured: whether ``t_s`` comes from a clock; else it only counts the scans.
        note: what was done to the stamps; empty if nothing.
    """

    t_s: FloatArray
    clocks_s: tuple[FloatArray, ...]
    measured: bool
    note: str


def unit_of(stamps: FloatArray) -> tuple[str, float]:
    """Find the unit of stamps that are too large for seconds since 1970.

    Args:
        stamps: (n,) stamps of a clock; NaN where there is none.

    Returns:
        The unit's name, and how many of it make a second: ``seconds`` and 1 if the stamps may be
        seconds, or if no unit makes them so.
    """
    known = np.abs(stamps[np.isfinite(stamps)])
    middle = float(np.median(known)) if len(known) else 0.0
    if middle > _LAST_S:
        for name, in_a_second in _UNITS:
            if middle <= _LAST_S * in_a_second:
                return name, in_a_second
    return "seconds", 1.0


def choose_times(clocks: Sequence[FloatArray]) -> Times:
    """Find the times of the scans by the clock that rises best.

    Args:
        clocks: one or more clocks (n,), s, the preferred one first; NaN where there is no stamp.

    Returns:
        The times.
    """
    rising = [np.where(rising_part(clock), clock, np.nan) for clock in clocks]
    known = [int(np.count_nonzero(np.isfinite(clock))) for clock in rising]
    best = max(range(len(clocks)), key=known.__getitem__)  # the first of equals
    n, kept = len(clocks[0]), tuple(rising)
    if known[best] == n:
        note = "not all stamps of the laser rise; the logger's clock is used" if best else ""
        return Times(rising[best], kept, True, note)
    if known[best] >= max(2.0, _LEAST_SHARE * n) and _in_order(clocks[best], rising[best]):
        t_s = _between(rising[best])
        if (np.diff(t_s) > 0.0).all():
            which = "the logger's stamps" if best else "the stamps"
            note = f"{n - known[best]} of {n} of {which} do not rise; their times are interpolated"
            return Times(t_s, kept, True, note)
    strange = all(not (np.abs(clock) <= _LAST_S).any() for clock in clocks)
    why = "the stamps are no seconds since 1970" if strange else "the stamps do not rise"
    note = f"{why}; the scans are taken in the order of the file, 1 s apart"
    return Times(MADE_UP_S * np.arange(n, dtype=np.float64), kept, False, note if n > 1 else "")


def rising_part(stamps: FloatArray) -> NDArray[np.bool_]:
    """Find a longest strictly rising sequence of stamps.

    Args:
        stamps: (n,) s.

    Returns:
        (n,) whether a stamp belongs to it; False for stamps that are no seconds since 1970.
    """
    valid = np.abs(stamps) <= _LAST_S  # False for NaN
    if valid.all() and (np.diff(stamps) > 0.0).all():
        return valid
    # ends[k] is the least stamp at which a rising sequence of k + 1 stamps ends, at index last[k].
    ends: list[float] = []
    last: list[int] = []
    before = np.full(len(stamps), -1)
    for i in np.flatnonzero(valid).tolist():
        stamp = float(stamps[i])
        k = bisect_left(ends, stamp)
        if k < len(ends) and ends[k] == stamp:
            continue  # of equal stamps, the first counts
        before[i] = last[k - 1] if k else -1
        ends[k : k + 1], last[k : k + 1] = [stamp], [i]
    part, at = np.zeros(len(stamps), np.bool_), last[-1] if last else -1
    while at >= 0:
        part[at], at = True, int(before[at])
    return part


def _in_order(stamps: FloatArray, rising: FloatArray) -> bool:
    """Return whether most stamps lie between the neighbours in the rising sequence."""
    least = np.maximum.accumulate(np.where(np.isnan(rising), -np.inf, rising))
    most = np.minimum.accumulate(np.where(np.isnan(rising), np.inf, rising)[::-1])[::-1]
    inside = (least <= stamps) & (stamps <= most)
    return bool(np.count_nonzero(inside) >= _LEAST_IN_ORDER * len(stamps))


def _between(rising: FloatArray) -> FloatArray:
    """Fill the gaps (NaN) by interpolation; at both ends go on by the median step."""
    at = np.flatnonzero(np.isfinite(rising))
    index, stamps = np.arange(len(rising)), rising[at]
    step = float(np.median(np.diff(stamps) / np.diff(at)))
    t_s = np.interp(index, at, stamps)
    t_s[: at[0]] = stamps[0] - step * (at[0] - index[: at[0]])
    t_s[at[-1] + 1 :] = stamps[-1] + step * (index[at[-1] + 1 :] - at[-1])
    return t_s
