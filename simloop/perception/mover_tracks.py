"""Tracks moving things in the LiDAR's scans: clusters of points, and a Kalman filter for each.

    scan -> points that moved -> clusters -> tracks -> points that must stay out of the map

A cluster starts a track if part of it lies where an earlier scan saw free space (see ``changes``).
A track is then followed whether its thing has just moved or not. Once it has stood still for long,
the track is dropped, and its points enter the map again.
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

_GAP_M, _GAP_SHARE = 0.12, 0.03  # neighbours farther apart are two things; share of the distance
_MOST_RADIUS_M = 0.75  # a larger cluster is a wall, or several things
_LEAST_MOVED = 2  # points of a cluster that must have moved to start a track
_LEAST_SIGHTINGS, _LEAST_WAY_M = 3, 0.12  # to confirm a track; the way is from where it began
_LOST_NS = 800_000_000
_STANDING_MPS, _STANDING_NS = 0.06, 2_500_000_000
_PLACE_STD_M, _SPEED_STD_MPS = 0.04, 0.5
_ACCELERATION_MPS2 = 1.0
_PACE_DECAY_MPS2 = 0.25
_GATE_M, _GATE_SIGMAS = 0.25, 3.0
_LEAST_RADIUS_M, _SHRINK, _GROW_M = 0.08, 0.98, 0.03  # per scan
_PADDING_M = 0.12  # round a track's disc, in which a scan's points belong to it


@njit(cache=True)
def label_clusters(points: FloatArray, laser: FloatArray) -> NDArray[np.int64]:
    """Split a full turn of the laser into clusters wherever neighbouring points lie far apart.

    Args:
        points: (n, 2) hits, m, in the order of their beams.
        laser: (2,) the laser's position, m, in the same frame.

    Returns:
        (n,) each point's cluster, numbered from 0 in the order of the beams.
    """
    n = points.shape[0]
    label = np.zeros(n, np.int64)
    count = 0
    for i in range(1, n):
        count += _is_gap(points, i - 1, i, laser)
        label[i] = count
    # A thing that stands where the sweep begins was cut in two: join its last part to the first.
    if n > 1 and count > 0 and not _is_gap(points, n - 1, 0, laser):
        for i in range(n - 1, -1, -1):
            if label[i] != count:
                break
            label[i] = 0
    return label


@njit(cache=True)
def _is_gap(points: FloatArray, i: int, k: int, laser: FloatArray) -> bool:
    """Whether points i and k belong to two things; beams spread, so it grows with the distance."""
    far = math.hypot(points[i, 0] - laser[0], points[i, 1] - laser[1])
    gap = math.hypot(points[i, 0] - points[k, 0], points[i, 1] - points[k, 1])
    return gap > _GAP_M + _GAP_SHARE * far


def _disc_of_points(
    points: FloatArray, discs: Sequence[tuple[FloatArray, float]]
) -> NDArray[np.int64]:
    """(n,) the number, from 1, of the disc that each of points (n, 2) belongs to; 0: none."""
    gaps = np.array([np.hypot(*(points - place).T) - radius for place, radius in discs])
    return np.where(gaps.min(axis=0) < _PADDING_M, 1 + gaps.argmin(axis=0), 0)


@dataclass(slots=True)
class Cluster:
    """Neighbouring points of a scan as a disc.

    Attributes:
        centre: (2,) in map, m.
        radius: m.
        moved: how many of its points lie where an earlier scan saw free space.
    """

    centre: FloatArray
    radius: float
    moved: int


class _Track(ConstantVelocity):
    """The filter of one thing. ``confirmed``: it has been seen often enough, and has come far
    enough, to be believed. ``pace``: its highest speed of late, m/s."""

    def __init__(self, number: int, cluster: Cluster, t_ns: int) -> None:
        super().__init__(cluster.centre, t_ns, _PLACE_STD_M, _SPEED_STD_MPS, _ACCELERATION_MPS2)
        self.number, self.radius = number, max(cluster.radius, _LEAST_RADIUS_M)
        self.seen_ns = self.moved_ns = t_ns
        self.confirmed, self.pace = False, 0.0
        self._sightings, self._first_place = 1, cluster.centre

    def observe(self, cluster: Cluster, t_ns: int) -> None:
        """Update with the cluster that was assigned to it."""
        self.update(cluster.centre)
        # A wall seen from a new angle seems to move, but goes nowhere: only a thing that has left
        # the place where it was first seen is confirmed.
        self._sightings += cluster.moved >= _LEAST_MOVED
        self.confirmed |= (
            self._sightings >= _LEAST_SIGHTINGS
            and math.dist(self.place, self._first_place) > _LEAST_WAY_M
        )
        speed = math.hypot(*self.velocity)
        self.pace = max(speed, self.pace - 1e-9 * (t_ns - self.seen_ns) * _PACE_DECAY_MPS2)
        self.seen_ns = t_ns
        # Half hidden, a thing looks smaller; next to another, larger. Its size follows slowly.
        seen = min(cluster.radius, self.radius + _GROW_M)
        self.radius = max(_SHRINK * self.radius, seen, _LEAST_RADIUS_M)
        if speed > _STANDING_MPS:
            self.moved_ns = t_ns

    def is_alive(self, t_ns: int) -> bool:
        """Whether to keep it: it was seen a short while ago, and it has moved of late."""
        patience = _LOST_NS if self.confirmed else _LOST_NS // 4
        return t_ns - self.seen_ns <= patience and t_ns - self.moved_ns <= _STANDING_NS


class MoverTracker:
    """Tracks moving things from scan to scan.

    Attributes:
        tracks: the confirmed tracks as of the last scan; None if there are none.
    """

    def __init__(self) -> None:
        self._changes = ChangeDetector()
        self._tracks: list[_Track] = []
        self._started = 0
        self.tracks: MoverTracks | None = None

    def reset(self) -> None:
        """Forget all tracks and scans: the robot's pose in map has jumped."""
        self._changes.reset()
        self._tracks.clear()
        self.tracks = None

    def discs_at(self, t_ns: int) -> FloatArray | None:
        """Predict where the moving things are at another instant.

        Args:
            t_ns: the instant, ns.

        Returns:
            (n, 3) x, y, radius in map, m, each a little wider than was seen; None if nothing moves.
        """
        return None if self.tracks is None else self.tracks.discs_at(t_ns, _PADDING_M)

    def update(
        self, points_m: FloatArray, laser_m: FloatArray, pose: FloatArray, t_ns: int
    ) -> NDArray[np.bool_] | None:
        """Take a scan.

        Args:
            points_m: (n, 2) hits in base_link, in the order of their beams.
            laser_m: (2,) or longer, the laser's x, y in base_link.
            pose: (3,) base_link in map at the scan's end.
            t_ns: the scan's end, ns.

        Returns:
            (n,) whether each point belongs to something that moves; None if none does.
        """
        points = transform_points(pose, points_m)
        laser = transform_points(pose, laser_m[None, :2])[0]
        moved = self._changes.detect(points, laser)
        if self._tracks or moved.sum() >= _LEAST_MOVED:
            for track in self._tracks:
                track.predict(t_ns)
            known = [(track.place, track.radius) for track in self._tracks if track.confirmed]
            self._assign(find_clusters(points, laser, moved, known), t_ns)
        self.tracks = self._confirmed_tracks(t_ns)
        # Of a track that is not confirmed only the points that moved are left out: it may yet
        # turn out to be a wall.
        theirs = np.zeros_like(moved)
        for track in self._tracks:
            near = np.hypot(*(points - track.place).T) < track.radius + _PADDING_M
            theirs |= near if track.confirmed else near & moved
        return theirs if theirs.any() else None

    def _assign(self, clusters: list[Cluster], t_ns: int) -> None:
        """Give each track its cluster, nearest pairs first; start and drop tracks."""
        pairs = sorted(
            (math.dist(track.place, cluster.centre), i, k)
            for i, track in enumerate(self._tracks)
            for k, cluster in enumerate(clusters)
            if math.dist(track.place, cluster.centre) < _GATE_M + _GATE_SIGMAS * track.std_m
        )
        used_tracks: set[int] = set()
        used: set[int] = set()
        for _, i, k in pairs:
            if i not in used_tracks and k not in used:
                self._tracks[i].observe(clusters[k], t_ns)
                used_tracks.add(i)
                used.add(k)
        self._tracks = [track for track in self._tracks if track.is_alive(t_ns)]
        for k, cluster in enumerate(clusters):
            if k not in used and cluster.moved >= _LEAST_MOVED:
                self._started += 1
                self._tracks.append(_Track(self._started, cluster, t_ns))

    def _confirmed_tracks(self, t_ns: int) -> MoverTracks | None:
        """The message about what is known to move."""
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


def find_clusters(
    points: FloatArray,
    laser: FloatArray,
    moved: NDArray[np.bool_],
    discs: Sequence[tuple[FloatArray, float]] = (),
) -> list[Cluster]:
    """Find the compact clusters of a scan.

    Args:
        points: (n, 2) hits in map, m, in the order of their beams.
        laser: (2,) the laser's position in map, m.
        moved: (n,) whether each point lies where an earlier scan saw free space.
        discs: place (2,) in map and radius of things already tracked, m. A cluster that touches
            several of them is divided among them.

    Returns:
        One disc for each cluster; of a cluster that is too large, such as a wall with a person
        before it, the part that moved.
    """
    label = label_clusters(points, laser)
    if discs:
        label = label * (len(discs) + 1) + _disc_of_points(points, discs)
    order = np.argsort(label, kind="stable")
    starts = np.flatnonzero(np.diff(label[order], prepend=-1))
    clusters = []
    for members in np.split(order, starts[1:]):
        count = int(moved[members].sum())
        span = np.ptp(points[members], axis=0).max()
        if span > 2.0 * _MOST_RADIUS_M:
            if count < _LEAST_MOVED:
                continue
            members = members[moved[members]]
            if np.ptp(points[members], axis=0).max() > 2.0 * _MOST_RADIUS_M:
                continue
        (x, y), radius = cv2.minEnclosingCircle(points[members].astype(np.float32)[:, None])
        clusters.append(Cluster(np.array([x, y]), float(radius), count))
    return clusters
