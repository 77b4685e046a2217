"""Tracks of things that move: clusters of a scan's points, and a Kalman filter for each.

    scan -> what has changed -> clusters -> tracks -> which points are not the map's

A cluster founds a track if part of it lies where nothing was (see ``changes``); what has a track is
followed whether it has just moved or not, until it has stood for long: then it is the map's again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.estimation.constant_velocity import ConstantVelocity
from simloop.geometry.se2 import transform_points
from simloop.messages import FloatArray, MoverTracks
from simloop.perception.changes import ChangeDetector

_APART_M, _APART_SHARE = 0.12, 0.03  # between neighbours on one thing, and more the farther
_LARGEST_M = 0.75  # radius of what is still one thing
_LEAST_MOVED = 2  # points
_CONFIRMED, _COME_M = 3, 0.12  # sightings, and how far it has come since the first
_LOST_NS = 800_000_000
_STANDS_MPS, _STANDS_NS = 0.06, 2_500_000_000
_PLACE_STD_M, _SPEED_STD_MPS = 0.04, 0.5
_ACCELERATION_MPS2 = 1.0
_FORGETS_MPS2 = 0.25  # of the pace that it had
_GATE_M, _GATE_SIGMAS = 0.25, 3.0
_LEAST_RADIUS_M, _SHRINKS, _SWELLS_M = 0.08, 0.98, 0.03
_ABOUT_M = 0.12  # round a track's disc, what of a scan is its


@njit(cache=True)
def cluster(points: FloatArray, centre: FloatArray) -> NDArray[np.int64]:
    """(n,) numbers of the clusters of points (n, 2) in the order of their beams, cast all round
    from ``centre`` (2,): a new one wherever neighbours lie apart."""
    n = points.shape[0]
    label = np.zeros(n, np.int64)
    count = 0
    for i in range(1, n):
        count += _parts(points, i - 1, i, centre)
        label[i] = count
    if n > 1 and count > 0 and not _parts(points, n - 1, 0, centre):
        for i in range(n - 1, -1, -1):
            if label[i] != count:
                break
            label[i] = 0
    return label


@njit(cache=True)
def _parts(points: FloatArray, i: int, k: int, centre: FloatArray) -> bool:
    far = math.hypot(points[i, 0] - centre[0], points[i, 1] - centre[1])
    gap = math.hypot(points[i, 0] - points[k, 0], points[i, 1] - points[k, 1])
    return gap > _APART_M + _APART_SHARE * far


def _belongs(points: FloatArray, discs: Sequence[tuple[FloatArray, float]]) -> NDArray[np.int64]:
    """(n,) number, from 1, of the disc about or next to each of points (n, 2); 0: of none."""
    gaps = np.array([np.hypot(*(points - place).T) - radius for place, radius in discs])
    return np.where(gaps.min(axis=0) < _ABOUT_M, 1 + gaps.argmin(axis=0), 0)


@dataclass(slots=True)
class _Thing:
    """A cluster as a disc in map; moved: how many of its points lie where nothing was."""

    centre: FloatArray
    radius: float
    moved: int


class _Track(ConstantVelocity):
    """``confirmed``: seen often enough, and come far enough, to be believed; ``pace``: m/s, the
    fastest of late."""

    def __init__(self, number: int, thing: _Thing, t_ns: int) -> None:
        super().__init__(thing.centre, t_ns, _PLACE_STD_M, _SPEED_STD_MPS, _ACCELERATION_MPS2)
        self.number, self.radius = number, max(thing.radius, _LEAST_RADIUS_M)
        self.seen_ns = self.moved_ns = t_ns
        self.confirmed, self.pace = False, 0.0
        self._sightings, self._founded_m = 1, thing.centre

    def take(self, thing: _Thing, t_ns: int) -> None:
        """It has been seen."""
        self.update(thing.centre)
        self._sightings += thing.moved >= _LEAST_MOVED
        self.confirmed |= (
            self._sightings >= _CONFIRMED and math.dist(self.place, self._founded_m) > _COME_M
        )
        speed = math.hypot(*self.velocity)
        self.pace = max(speed, self.pace - 1e-9 * (t_ns - self.seen_ns) * _FORGETS_MPS2)
        self.seen_ns = t_ns
        seen = min(thing.radius, self.radius + _SWELLS_M)
        self.radius = max(_SHRINKS * self.radius, seen, _LEAST_RADIUS_M)
        if speed > _STANDS_MPS:
            self.moved_ns = t_ns


class MoverWatch:
    """One scan at a time. ``tracks`` is what is known to move, as of the last scan."""

    def __init__(self) -> None:
        self._changes = ChangeDetector()
        self._tracks: list[_Track] = []
        self._founded = 0
        self.tracks: MoverTracks | None = None

    def forget(self) -> None:
        """The robot stands elsewhere than was thought."""
        self._changes.forget()
        self._tracks.clear()
        self.tracks = None

    def discs_at(self, t_ns: int) -> FloatArray | None:
        """(n, 3) x, y, radius in map of what is thought to move, and a little about it."""
        return None if self.tracks is None else self.tracks.discs_at(t_ns, _ABOUT_M)

    def look(
        self, points_m: FloatArray, laser_m: FloatArray, pose: FloatArray, t_ns: int
    ) -> NDArray[np.bool_] | None:
        """Take a scan, points (n, 2) and the laser (2,) in base_link at ``pose`` (3,) in map.

        (n,) which of its points belong to what moves; None if none do.
        """
        points = transform_points(pose, points_m)
        centre = transform_points(pose, laser_m[None, :2])[0]
        moved = self._changes.look(points, centre)
        if self._tracks or moved.sum() >= _LEAST_MOVED:
            for track in self._tracks:
                track.predict(t_ns)
            sure = [(track.place, track.radius) for track in self._tracks if track.confirmed]
            self._follow(things_in(points, centre, moved, sure), t_ns)
        self.tracks = self._told(t_ns)
        theirs = np.zeros_like(moved)
        for track in self._tracks:
            near = np.hypot(*(points - track.place).T) < track.radius + _ABOUT_M
            theirs |= near if track.confirmed else near & moved
        return theirs if theirs.any() else None

    def _follow(self, things: list[_Thing], t_ns: int) -> None:
        pairs = sorted(
            (math.dist(track.place, thing.centre), i, k)
            for i, track in enumerate(self._tracks)
            for k, thing in enumerate(things)
            if math.dist(track.place, thing.centre) < _GATE_M + _GATE_SIGMAS * track.std_m
        )
        used_tracks: set[int] = set()
        used: set[int] = set()
        for _, i, k in pairs:
            if i not in used_tracks and k not in used:
                self._tracks[i].take(things[k], t_ns)
                used_tracks.add(i)
                used.add(k)
        self._tracks = [track for track in self._tracks if _lives(track, t_ns)]
        for k, thing in enumerate(things):
            if k not in used and thing.moved >= _LEAST_MOVED:
                self._founded += 1
                self._tracks.append(_Track(self._founded, thing, t_ns))

    def _told(self, t_ns: int) -> MoverTracks | None:
        sure = [track for track in self._tracks if track.confirmed]
        if not sure:
            return None
        return MoverTracks(
            t_ns,
            np.array([track.number for track in sure], np.int64),
            np.array([track.place for track in sure]),
            np.array([track.velocity for track in sure]),
            np.array([track.radius for track in sure]),
            np.array([track.std_m for track in sure]),
            np.array([track.pace for track in sure]),
        )


def _lives(track: _Track, t_ns: int) -> bool:
    """Whether a track is kept: seen of late, and moving of late."""
    patience = _LOST_NS if track.confirmed else _LOST_NS // 4
    return t_ns - track.seen_ns <= patience and t_ns - track.moved_ns <= _STANDS_NS


def things_in(
    points: FloatArray,
    centre: FloatArray,
    moved: NDArray[np.bool_],
    discs: Sequence[tuple[FloatArray, float]] = (),
) -> list[_Thing]:
    """The compact clusters of points (n, 2) as discs; of what is larger, the part that moved.

    discs: place (2,) and radius of what is known; a cluster of more than one is shared out.
    """
    label = cluster(points, centre)
    if discs:
        label = label * (len(discs) + 1) + _belongs(points, discs)
    order = np.argsort(label, kind="stable")
    starts = np.flatnonzero(np.diff(label[order], prepend=-1))
    things = []
    for members in np.split(order, starts[1:]):
        count = int(moved[members].sum())
        span = np.ptp(points[members], axis=0).max()
        if span > 2.0 * _LARGEST_M:
            if count < _LEAST_MOVED:
                continue
            members = members[moved[members]]
            if np.ptp(points[members], axis=0).max() > 2.0 * _LARGEST_M:
                continue
        (x, y), radius = cv2.minEnclosingCircle(points[members].astype(np.float32)[:, None])
        things.append(_Thing(np.array([x, y]), float(radius), count))
    return things
