"""Carry a trajectory by wheel odometry to the instants between its scans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simloop.geometry.se2 import between_all, compose_all, wrap_angles
from simloop.messages import FloatArray
from simloop.replay.clocks import rising_part

MOST_GAP_S = 1.0
"""A gap in the odometry that is longer than this is not bridged, s."""

MEASURED, IN_GAP, OUTSIDE, LOST = range(4)
"""Whether there is a pose at an instant; if not: the odometry has a gap there, the instant lies
outside the trajectory, or a scan beside it has no pose."""

_MOST = np.array([1e8, 1e8, 1e6])  # of x, y, m, and yaw, rad: larger poses have lost millimetres

_Places = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Odometry:
    """The odometry lines of a log. There are more of them than scans.

    Attributes:
        clocks_s: the lines' times (m,) by each clock of the log, s; they may be wrong.
        poses: (m, 3) odom_from_base, m, m, rad; they may be wrong. The frame need not be that of
            the scans' odometry, because only motions are used.
    """

    clocks_s: tuple[FloatArray, ...]
    poses: FloatArray

    def usable(self, clock: int) -> OdometryTrack:
        """Return the lines that can be used.

        Args:
            clock: index of the clock.

        Returns:
            The lines with a plausible pose and a stamp that rises.
        """
        good = are_plausible(self.poses)
        t_s, poses = self.clocks_s[clock][good], self.poses[good]
        rising = rising_part(t_s)
        return OdometryTrack(t_s[rising], poses[rising])


@dataclass(frozen=True, slots=True, eq=False)
class OdometryTrack:
    """Poses by odometry, with gaps.

    Attributes:
        t_s: (m,) rising, s.
        poses: (m, 3) odom_from_base, m, m, rad.
    """

    t_s: FloatArray
    poses: FloatArray

    def at(self, when_s: FloatArray) -> tuple[FloatArray, _Places]:
        """Interpolate, linearly in x and y and over the shorter turn in yaw.

        Args:
            when_s: (k,) instants, s.

        Returns:
            (k, 3) poses, and (k,) the piece without a gap in which each instant lies; -1 in a gap
            longer than ``MOST_GAP_S`` and outside the track, where the pose has no meaning.
        """
        if not len(self.t_s):
            return np.full((len(when_s), 3), np.nan), np.full(len(when_s), -1)
        before, after, exact, inside = _around(self.t_s, when_s)
        span = self.t_s[after] - self.t_s[before]
        pieces = np.concatenate([[0], np.cumsum(np.diff(self.t_s) > MOST_GAP_S)])
        known = exact | (inside & (span <= MOST_GAP_S))
        share = _share(self.t_s, before, after, when_s)
        return (
            _blend(self.poses[before], self.poses[after], share),
            np.where(known, pieces[before], -1),
        )


def are_plausible(poses: FloatArray) -> NDArray[np.bool_]:
    """Tell which poses are numbers that can be computed with.

    Args:
        poses: (n, 3) x, y, yaw, m, m, rad.

    Returns:
        (n,) whether each is finite and not too large.
    """
    return np.asarray((np.abs(poses) <= _MOST).all(axis=1))  # False for NaN


def carry(
    t_s: FloatArray, poses: FloatArray, tracks: Sequence[OdometryTrack], when_s: FloatArray
) -> tuple[FloatArray, _Places]:
    """Compute the poses of a trajectory between its scans.

    The pose before an instant is carried forward by odometry, and the pose after it back. The two
    are blended by time. If the odometry reaches from one of the two scans only, because it has a
    gap, that one counts. So does the last scan after the end, and the first one before the start,
    but for no longer than the longest time between two scans.

    Args:
        t_s: (n,) times of the scans, rising, s.
        poses: (n, 3) base_link at the scans in any fixed frame, m, m, rad; NaN where unknown.
        tracks: the odometry. A later track is used where the ones before have a gap.
        when_s: (k,) instants, s.

    Returns:
        (k, 3) poses, NaN where there is none; and (k,) ``MEASURED``, or why there is none. At the
        exact time of a scan the pose is the scan's.
    """
    before, after, exact, inside = _around(t_s, when_s)
    before[when_s > t_s[-1]] = len(t_s) - 1
    reach_s = float(np.diff(t_s).max()) if len(t_s) > 1 else 0.0
    near = (when_s >= t_s[0] - reach_s) & (when_s <= t_s[-1] + reach_s)
    found, missing = np.full((len(when_s), 3), np.nan), near & ~exact
    found[exact] = poses[after[exact]]
    share = _share(t_s, before, after, when_s)
    for track in tracks:
        (odom, piece), (at_scans, pieces) = track.at(when_s), track.at(t_s)
        forward, backward = (
            compose_all(poses[scan], between_all(at_scans[scan], odom)) for scan in (before, after)
        )
        ahead, back = ((piece >= 0) & (pieces[scan] == piece) for scan in (before, after))
        one = np.where(ahead[:, None], forward, backward)
        other = np.where(back[:, None], backward, one)  # the same twice if only one is reached
        reached = missing & (ahead | back)
        found[reached] = _blend(one, other, share)[reached]
        missing &= ~reached
    why = np.where(np.isfinite(found).all(axis=1), MEASURED, LOST)
    why[missing & inside], why[(missing & ~inside) | ~near] = IN_GAP, OUTSIDE
    return found, why


def _around(
    t_s: FloatArray, when_s: FloatArray
) -> tuple[_Places, _Places, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the indices before and after each instant, whether it is exactly at the latter (then
    both are the same), and whether it lies within the times."""
    after = np.clip(np.searchsorted(t_s, when_s, side="left"), 0, len(t_s) - 1)
    exact = t_s[after] == when_s
    before = np.maximum(np.where(exact, after, after - 1), 0)
    return before, after, exact, exact | ((when_s > t_s[0]) & (when_s < t_s[-1]))


def _share(t_s: FloatArray, before: _Places, after: _Places, when_s: FloatArray) -> FloatArray:
    """Return (k,) where each instant lies between the two times, from 0 to 1."""
    span = t_s[after] - t_s[before]
    some = span > 0.0
    return np.where(some, (when_s - t_s[before]) / np.where(some, span, 1.0), 0.0)


def _blend(first: FloatArray, second: FloatArray, share: FloatArray) -> FloatArray:
    """Return (k, 3) poses between two, over the shorter turn in yaw."""
    step = second - first
    step[:, 2] = wrap_angles(step[:, 2])
    out = first + share[:, None] * step
    out[:, 2] = wrap_angles(out[:, 2])
    return np.asarray(out)
