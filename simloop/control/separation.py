"""Speed and separation: the robot stands before anything that moves can be where it is.

After ISO/TS 15066 and the passive safety of Macek et al. 2009: from the velocity that is asked for
the robot can be stopped, and until it stands no mover, going on as it goes and a little aside or
faster, comes within a margin of its outline. What then runs into it finds it standing.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.config import TrackerConfig, VehicleConfig
from simloop.control.collision_monitor import CollisionMonitor, stopping_limits
from simloop.geometry.footprint import arc_end, rectangle_distance
from simloop.messages import FloatArray, MoverTracks

_STEP_S = 0.05
_PARTS = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1)
_GROWS_MPS, _GROWS_SHARE = 0.1, 0.3  # how fast a mover's disc grows about its prediction
_DECELERATION_MPS2 = 1.0  # of an emergency stop
_MARGIN_M = 0.06
_STANDS_MPS = 0.1  # slower, a mover is taken to stand
_AWAY = -0.5  # cosine of its course to where the robot is, below which it goes away
_LITTLE_MPS, _LITTLE_RADPS = 0.1, 0.3  # with no more left to do, to get out of the way is
_FORESEEN_S, _LOOK_S = 1.5, 0.1
_THREAT_M, _WORTH_M = 0.10, 0.05
_DODGES_MPS, _DODGES_RADPS = (-0.4, -0.2, 0.2, 0.4), (0.0, 0.6, -0.6, 1.2, -1.2)
_STALE_NS = 600_000_000  # since movers were last looked for: with no news it is best to stand
_RESTLESS_S = 0.2  # a standing robot needs to get under way
_STANDING_NS = 50_000_000  # so long told to stand, it does
_PATIENCE_NS = 3_000_000_000  # for ever it cannot stand, where something is thrown back and forth
_KEEP_NS = 300_000_000  # how long a dodge is kept to


@njit(cache=True)
def gap_after(
    pose: FloatArray, ahead: float, turned: float, t: float, mover: FloatArray, half: FloatArray
) -> float:
    """m between the footprint, ``ahead`` m along an arc and ``turned`` rad round from ``pose``
    (3,), and a mover (7,) ``t`` s on: x, y, vx, vy in map, radius. half: (2,) of the footprint."""
    cx, cy = arc_end(ahead, turned)
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    dx = mover[0] + mover[2] * t - pose[0] - cos * cx + sin * cy
    dy = mover[1] + mover[3] * t - pose[1] - sin * cx - cos * cy
    cos, sin = math.cos(pose[2] + turned), math.sin(pose[2] + turned)
    apart = rectangle_distance(cos * dx + sin * dy, cos * dy - sin * dx, half[0], half[1])
    return apart - mover[4]


@njit(cache=True)
def _comes(mover: FloatArray, pose: FloatArray) -> bool:
    """Whether a mover, next to ``pose`` (2+), is not clearly on its way from there."""
    dx, dy = pose[0] - mover[0], pose[1] - mover[1]
    towards = mover[2] * dx + mover[3] * dy
    return mover[6] > _STANDS_MPS and towards > _AWAY * mover[6] * math.hypot(dx, dy)


@njit(cache=True)
def stays_clear(
    pose: FloatArray, speed: float, rate: float, movers: FloatArray, limits: FloatArray
) -> bool:
    """Whether no mover comes within reach before the robot, at (speed, rate) now, has stopped.

    Arguments as of ``safe_part``. What is too near already must not come nearer; what is, and is
    on its way here, lets nothing be safe but to stand.
    """
    reaction, brake, yaw_brake, margin = limits[0], limits[1], limits[2], limits[5]
    half = limits[3:5]
    braking = max(abs(speed) / brake, abs(rate) / yaw_brake)
    until = reaction + braking
    for k in range(movers.shape[0]):
        first = gap_after(pose, 0.0, 0.0, 0.0, movers[k], half) - margin
        if first < 0.0 and _comes(movers[k], pose):
            return False
        for step in range(1, math.ceil(until / _STEP_S) + 1):
            t = min(step * _STEP_S, until)
            slowed = max(0.0, t - reaction)
            gone = t - (0.5 * slowed * slowed / braking if braking > 0.0 else 0.0)
            ahead, turned = speed * gone, rate * gone
            gap = gap_after(pose, ahead, turned, t, movers[k], half) - margin
            if gap < (movers[k, 5] * t if first >= 0.0 else first - 1e-6):
                return False
            # It may turn round at once: as far from where it is now as it can come by then.
            gap = gap_after(pose, ahead, turned, 0.0, movers[k], half)
            if gap < min(movers[k, 6] * t, first):
                return False
    return True


@njit(cache=True)
def safe_part(
    pose: FloatArray, speed: float, rate: float, movers: FloatArray, limits: FloatArray
) -> float:
    """The greatest of a few parts, 0 to 1, of a velocity, m/s and rad/s, that is safe at ``pose``.

    movers: (n, 7) x, y, vx, vy in map, radius, by how much it grows and its pace, m/s. limits: (6,)
    reaction, s, decelerations, m/s^2 and rad/s^2, half the footprint's length and width, margin, m.
    """
    for part in _PARTS:
        if stays_clear(pose, part * speed, part * rate, movers, limits):
            return part
    return 0.0


@njit(cache=True)
def least_gap(
    pose: FloatArray, speed: float, rate: float, movers: FloatArray, half: FloatArray, until: float
) -> float:
    """m, the least to come between the footprint and any mover as it is foreseen, over ``until`` s
    of an arc at (speed, rate)."""
    least = np.inf
    steps = math.ceil(until / _LOOK_S)
    for k in range(movers.shape[0]):
        for step in range(steps + 1):
            t = step * _LOOK_S
            gap = gap_after(pose, speed * t, rate * t, t, movers[k], half)
            least = min(least, gap - movers[k, 5] * t)
    return least


def is_restless(
    pose: FloatArray, movers: FloatArray, tracks: MoverTracks, limits: FloatArray
) -> bool:
    """Whether something that moved of late is so near to a robot that stands at ``pose`` (3,) that
    it may be at its side before that has got away: better to stand, and be touched standing.

    movers, (n, 7), and limits as of ``safe_part``, the former made of the tracks.
    """
    gaps = np.array([gap_after(pose, 0.0, 0.0, 0.0, mover, limits[3:5]) for mover in movers])
    near = gaps < limits[5] + _RESTLESS_S * tracks.pace_mps
    return bool((near & (tracks.pace_mps > _STANDS_MPS)).any())


class Separation:
    """Holds a body velocity back for what moves, and gets out of its way."""

    def __init__(
        self, config: TrackerConfig, vehicle: VehicleConfig, monitor: CollisionMonitor
    ) -> None:
        self._monitor = monitor
        self._limits = stopping_limits(config, vehicle, _DECELERATION_MPS2, _MARGIN_M)
        self._dodge, self._dodge_ns = (0.0, 0.0), 0
        self._moved_ns = 0

    def allow(
        self,
        speed: float,
        rate: float,
        pose: FloatArray,
        tracks: MoverTracks | None,
        t_ns: int,
        dodges: bool = True,
    ) -> tuple[float, float, str]:
        """The velocity, m/s and rad/s, that is safe at ``pose`` (3,) among what moves, and its
        mode: none where it is the one asked for, ``yield`` for a part of it, or ``dodge``.

        dodges: whether it may be another one, that leads out of something's way.
        """
        told = self._allow(speed, rate, pose, tracks, t_ns, dodges)
        if told[0] != 0.0 or told[1] != 0.0:
            self._moved_ns = t_ns
        return told

    def _allow(
        self,
        speed: float,
        rate: float,
        pose: FloatArray,
        tracks: MoverTracks | None,
        t_ns: int,
        dodges: bool,
    ) -> tuple[float, float, str]:
        """``allow``, but for remembering since when the robot has been told to stand."""
        if tracks is None:
            return speed, rate, ""
        if t_ns - tracks.t_ns > _STALE_NS:
            return 0.0, 0.0, "yield"
        movers = discs_at(tracks, t_ns)
        stood_ns = t_ns - self._moved_ns
        restless = stood_ns > _STANDING_NS and is_restless(pose, movers, tracks, self._limits)
        if restless and stood_ns < _PATIENCE_NS:
            return 0.0, 0.0, "yield"
        part = safe_part(pose, speed, rate, movers, self._limits)
        little = abs(speed) * part < _LITTLE_MPS and abs(rate) * part < _LITTLE_RADPS
        dodge = self._aside(pose, movers, t_ns) if dodges and little and not restless else None
        if dodge is not None:
            return *dodge, "dodge"
        moves = speed != 0.0 or rate != 0.0
        return speed * part, rate * part, "yield" if moves and part < 1.0 else ""

    def _aside(self, pose: FloatArray, movers: FloatArray, t_ns: int) -> tuple[float, float] | None:
        """A velocity out of the way of what is coming; None where to stand is as good."""
        half = self._limits[3:5]
        stood = least_gap(pose, 0.0, 0.0, movers, half, _FORESEEN_S)
        if stood > _THREAT_M:
            return None
        if t_ns < self._dodge_ns and stays_clear(pose, *self._dodge, movers, self._limits):
            return self._monitor.allow(*self._dodge, pose)
        best, chosen = stood + _WORTH_M, None
        for speed in _DODGES_MPS:
            for rate in _DODGES_RADPS:
                gap = least_gap(pose, speed, rate, movers, half, _FORESEEN_S)
                if gap > best and stays_clear(pose, speed, rate, movers, self._limits):
                    free = self._monitor.look_along(speed, rate, pose)[0]
                    if free >= 1.0:
                        best, chosen = gap, (speed, rate)
        if chosen is None:
            return None
        self._dodge, self._dodge_ns = chosen, t_ns + _KEEP_NS
        return chosen


def discs_at(tracks: MoverTracks, t_ns: int) -> FloatArray:
    """(n, 7) of the tracks at an instant, as ``safe_part`` has them."""
    pace = np.hypot(*tracks.velocity_mps.T)
    grows = _GROWS_MPS + _GROWS_SHARE * pace
    return np.column_stack(
        (
            tracks.places_at(t_ns),
            tracks.velocity_mps,
            tracks.radius_m + tracks.std_m,
            grows,
            pace,
        )
    )
