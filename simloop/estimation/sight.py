"""Judge from its scans whether the LiDAR sees, so that silence can count as free space.

Three figures of each scan are compared:

    firm      beams that came back next to another one that came back; a surface gives such pairs,
              and stray beams of a sensor that loses most of them do not
    silent    beams that did not come back, as did none of their neighbours
    missing   silent beams that cross a surface of the map that was measured a moment ago

A LiDAR that sees misses nothing. One that misses more than it measures is blind. One that has never
measured anything may be blind or stand on open ground, and nothing it sends can tell which. A few
posts prove a sensor too, if nearly all that comes back is firm.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Sequence
from enum import Enum

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray

_LEAST_SHARE, _LEAST_BEAMS = 1.0 / 72.0, 2  # so many beams make a figure: 5 of 360
_PROOF_SHARE = 1.0 / 12.0  # so many firm beams prove that the sensor works: 30 of 360
_NEAR_ALL = 0.75  # or fewer, if at least this share of all that came back is firm ...
_PROOF_SCANS = 3  # ... in so many scans in a row: a few posts, and not strays
_BLIND_SHARE = 0.5  # more missing beams than this share: the sensor is blind
_SEES_SHARE = 0.3  # a blind sensor sees again below this share
_THIN_SHARE = 0.3  # more missing beams than this share: silence does not count as free
_STREWN_SHARE = 1.0 / 6.0  # more changes than this between answer and silence: strewn silence
_SCANS_TO_DECIDE = 2  # scans in a row that make a sensor blind, or make it see again
_SMOOTH_SHARE = 0.2  # at least this share of three beams in a row lie on one smooth surface
_QUANTILE_OF_NOISE = 0.2533  # that quantile of the size of a noise of one
_NOISE_BEAMS = 180  # an estimate takes as many scans as have so many beams together
_NOISE_SCANS = 5  # the median over so many estimates counts


class Sight(Enum):
    """How well the LiDAR sees."""

    CLEAR = "clear"
    THIN = "thin"
    BLIND = "blind"
    UNPROVEN = "unproven"


def silent_beams(ranges_m: FloatArray) -> NDArray[np.bool_]:
    """Find the beams that did not come back, as did neither of their neighbours.

    A beam that passes an edge may miss what its neighbour hits. So a lone silent beam says nothing.

    Args:
        ranges_m: (n,) ranges of a whole turn in order of angle, m; inf where nothing came back.

    Returns:
        (n,) whether a beam and both neighbours are silent.
    """
    silent = ~np.isfinite(ranges_m)
    return np.asarray(silent & np.roll(silent, 1) & np.roll(silent, -1))


def firm_beams(ranges_m: FloatArray) -> int:
    """Count the beams that came back next to another one that came back.

    Args:
        ranges_m: (n,) as in `silent_beams`.

    Returns:
        Their number.
    """
    answered = np.isfinite(ranges_m)
    return int(np.sum(answered & (np.roll(answered, 1) | np.roll(answered, -1))))


def _changes(ranges_m: FloatArray) -> int:
    """Count how often answer and silence change around a turn (n,)."""
    answered = np.isfinite(ranges_m)
    return int(np.sum(answered != np.roll(answered, 1)))


def range_noise(scans: Sequence[FloatArray]) -> float:
    """Estimate the noise of the ranges from beams that lie side by side.

    On a straight wall the ranges of a beam's neighbours give its own range, however far apart the
    beams are. A low quantile of what they are off is not moved by edges and thin things.

    Args:
        scans: Scans of about the same place, each as in `silent_beams`.

    Returns:
        Standard deviation of a range, m; NaN without any three beams in a row that came back.
    """
    off = np.concatenate([_off_the_walls(ranges_m) for ranges_m in scans])
    return float(np.quantile(off, _SMOOTH_SHARE)) / _QUANTILE_OF_NOISE if len(off) else math.nan


@njit(cache=True)
def _off_the_walls(ranges_m: FloatArray) -> FloatArray:
    """How far each range is off the straight line through its neighbours' ends.

    Each one is divided by how much more than the noise of one range it varies.

    Args:
        ranges_m: (n,) as in `silent_beams`.

    Returns:
        (k,) for the beams that came back between neighbours that came back, m.
    """
    n, count = ranges_m.shape[0], 0
    off = np.empty(n)
    # Along a line, 1 / range is a sinusoid of the angle: 1/a + 1/c = 2 cos(step) / b.
    twice = 2.0 * math.cos(2.0 * math.pi / max(n, 1))
    for i in range(n):
        a, c = ranges_m[i - 1], ranges_m[(i + 1) % n]
        both = a + c
        if both > 0.0 and math.isfinite(both) and math.isfinite(ranges_m[i]):
            by_a, by_c = twice * (c / both) ** 2, twice * (a / both) ** 2
            one = abs(ranges_m[i] - twice * a * c / both)
            off[count] = one / math.sqrt(1.0 + by_a * by_a + by_c * by_c)
            count += 1
    return off[:count]


class SightMonitor:
    """Keeps the verdict on the LiDAR over its scans.

    Attributes:
        sight: The verdict.
        noise_m: Noise of the ranges, m, see `range_noise`; 0 before it is known.
        silence_is_free: Whether a beam of the last scan that did not come back shows free space.
    """

    def __init__(self, open_ground: bool) -> None:
        """open_ground: whether the ground is known to be open, so that silence proves nothing."""
        self._proven = open_ground
        self._bad = self._good = self._sound = 0
        self.sight = Sight.CLEAR
        self.silence_is_free = True
        self.noise_m = 0.0
        self._noise: deque[float] = deque(maxlen=_NOISE_SCANS)
        self._scans: deque[FloatArray] = deque()

    def measure_noise(self, ranges_m: FloatArray) -> None:
        """Take the noise of a scan into account.

        Args:
            ranges_m: (n,) as in `silent_beams`.
        """
        self._scans.append(ranges_m)
        while (len(self._scans) - 1) * len(ranges_m) >= _NOISE_BEAMS:
            self._scans.popleft()
        noise = range_noise(self._scans)
        if math.isfinite(noise):
            self._noise.append(noise)
            self.noise_m = statistics.median(self._noise)

    def judge(self, ranges_m: FloatArray, missing: int, known_missing: int) -> Sight:
        """Take a scan.

        Args:
            ranges_m: (n,) as in `silent_beams`.
            missing: Silent beams that cross a surface that was measured in one of the last scans.
            known_missing: Silent beams that cross any surface of the map.

        Returns:
            The verdict after this scan.
        """
        beams, firm = len(ranges_m), firm_beams(ranges_m)
        least = max(_LEAST_BEAMS, round(_LEAST_SHARE * beams))
        answered = int(np.isfinite(ranges_m).sum())
        self._sound = self._sound + 1 if firm >= max(least, _NEAR_ALL * answered) else 0
        self._proven |= firm >= max(_LEAST_BEAMS, _PROOF_SHARE * beams)
        self._proven |= self._sound >= _PROOF_SCANS
        share = missing / (missing + firm) if missing >= least else 0.0
        of_all = known_missing / (known_missing + firm) if known_missing + firm else 0.0
        # What hides behind an edge, or over which a tilted robot looks, lies side by side. Beams
        # that get lost are strewn all round.
        thin = share > _THIN_SHARE and _changes(ranges_m) > _STREWN_SHARE * beams
        self.silence_is_free = self._proven and not (thin or share > _BLIND_SHARE)
        self._bad = self._bad + 1 if share > _BLIND_SHARE else 0
        self._good = self._good + 1 if firm >= least and of_all < _SEES_SHARE else 0
        if not self._proven:
            self.sight = Sight.UNPROVEN
        elif self._bad >= _SCANS_TO_DECIDE:
            self.sight = Sight.BLIND
        elif self.sight is not Sight.BLIND or self._good >= _SCANS_TO_DECIDE:
            self.sight = Sight.THIN if thin else Sight.CLEAR
        return self.sight
