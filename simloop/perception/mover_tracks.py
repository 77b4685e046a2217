"""Track moving obstacles in the LiDAR's scans: clusters of points, each with a Kalman filter.

    scan -> points that moved -> clusters -> tracks -> points that must stay out of the map

A cluster starts a track if part of it lies where an earlier scan saw free space (see ``changes``).
The track is then updated in every scan, even if the obstacle pauses. When the obstacle has stood
still for long, the track is dropped, and its points are entered in the map again.
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

# Neighbouring points are two objects if their gap is larger than this plus this share of the range.
_GAP_M, _GAP_SHARE = 0.12, 0.03
_MOST_RADIUS_M = 0.75  # a larger cluster is a wall, or several objects
_LEAST_MOVED = 2  # a cluster with at least this many moved points can start a track
_LEAST_SIGHTINGS, _LEAST_WAY_M = 3, 0.12  # a confirmed track has moved this often and this far
_LOST_NS = 800_000_000  # a confirmed track is dropped after this time without a cluster
_STANDING_MPS, _STANDING_NS = 0.06, 2_500_000_000  # slower than this for this long: dropped
_PLACE_STD_M, _SPEED_STD_MPS = 0.04, 0.5  # std of an observed position, and of the first velocity
_ACCELERATION_MPS2 = 1.0  # standard deviation of the acceleration
_PACE_DECAY_MPS2 = 0.25  # rate at which the remembered highest speed falls
_GATE_M, _GATE_SIGMAS = 0.25, 3.0  # assignment gate: constant part, and part per std of the track
_LEAST_RADIUS_M, _SHRINK, _GROW_M = 0.08, 0.98, 0.03  # bound and change per scan of a track's size
_PADDING_M = 0.12  # points this near to a track's disc belong to the track


@njit(cache=True)
def label_clusters(points: FloatArray, laser: FloatArray) -> NDArray[np.int64]:
    """Split a full turn of the laser into clusters at large gaps between neighbouring points.

    Args:
        points: (n, 2) hits, m, in the order of their beams.
        laser: (2,) the laser's position, m, in the same frame.

    Returns:
        (n,) number of each point's cluster, from 0 in the order of the beams.
    """
    n = points.shape[0]
    label = np.zeros(n, np.int64)
    count = 0
    for i in range(1, n):
        count += _is_gap(points, i - 1, i, laser)
        label[i] = count
    # An object at the start of the sweep was cut in two: join its last part to the first.
    if n > 1 and count > 0 and not _is_gap(points, n - 1, 0, laser):
        for i in range(n - 1, -1, -1):
            if label[i] != count:
                break
            label[i] = 0
    return label


@njit(cache=True)
def _is_gap(points: FloatArray, i: int, k: int, laser: FloatArray) -> bool:
    """Return whether points i and k are of two objects. The limit grows with the range."""
    far = math.hypot(points[i, 0] - laser[0], points[i, 1] - laser[1])
    gap = math.hypot(points[i, 0] - points[k, 0], points[i, 1] - points[k, 1])
    return gap > _GAP_M + _GAP_SHARE * far


def _disc_of_points(
    points: FloatArray, discs: Sequence[tuple[FloatArray, float]]
) -> NDArray[np.int64]:
    """Return (n,) the number, from 1, of the disc of each of points (n, 2); 0 if none."""
    gaps = np.array([np.hypot(*(points - place).T) - radius for place, radius in discs])
    return np.where(gaps.min(axis=0) < _PADDING_M, 1 + gaps.argmin(axis=0), 0)


@dataclass(slots=True)
class Cluster:
    """Disc around neighbouring points of a scan.

    Attributes:
        centre: (2,) in map, m.
        radius: m.
        moved: number of its points that lie where an earlier scan saw free space.
    """

    centre: FloatArray
    radius: float
    moved: int


class _Track(ConstantVelocity):
    """Filter of one obstacle.

    ``confirmed``: it was seen to move often enough and far enough. ``pace``: its highest recent
    speed, m/s.
    """

    def __init__(self, number: int, cluster: Cluster, t_ns: int) -> None:
        super().__init__(cluster.centre, t_ns, _PLACE_STD_M, _SPEED_STD_MPS, _ACCELERATION_MPS2)
        self.number, self.radius = number, max(cluster.radius, _LEAST_RADIUS_M)
        self.seen_ns = self.moved_ns = t_ns
        self.confirmed, self.pace = False, 0.0
        self._sightings, self._first_place = 1, cluster.centre

    def observe(self, cluster: Cluster, t_ns: int) -> None:
        """Update the track with its assigned cluster."""
        self.update(cluster.centre)
        # A wall seen from a new angle seems to move but stays in its place. So a track is confirmed
        # only when it has left the place where it was first seen.
        self._sightings += cluster.moved >= _LEAST_MOVED
        self.confirmed |= (
            self._sightings >= _LEAST_SIGHTINGS
            and math.dist(self.place, self._first_place) > _LEAST_WAY_M
        )
        speed = math.hypot(*self.velocity)
        self.pace = max(speed, self.pace - 1e-9 * (t_ns - self.seen_ns) * _PACE_DECAY_MPS2)
        self.seen_ns = t_ns
        # An obstacle looks smaller if partly hidden, and larger next to another one. So its size
        # follows slowly.
        seen = min(cluster.radius, self.radius + _GROW_M)
        self.radius = max(_SHRINK * self.radius, seen, _LEAST_RADIUS_M)
        if speed > _STANDING_MPS:
            self.moved_ns = t_ns

    def is_alive(self, t_ns: int) -> bool:
        """Return whether to keep the track: it was seen and has moved recently."""
        patience = _LOST_NS if self.confirmed else _LOST_NS // 4
        return t_ns - self.seen_ns <= patience and t_ns - self.moved_ns <= _STANDING_NS


class MoverTracker:
    """Tracker of moving obstacles from scan to scan.

    Attributes:
        tracks: the confirmed tracks after the last scan; None if there are none.
    """

    def __init__(self) -> None:
        self._changes = ChangeDetector()
        self._tracks: list[_Track] = []
        self._started = 0
        self.tracks: MoverTracks | None = None

    def reset(self) -> None:
        """Forget all tracks and scans. Call this when the robot's pose in map has jumped."""
        self._changes.reset()
        self._tracks.clear()
        self.tracks = None

    def discs_at(self, t_ns: int) -> FloatArray | None:
        """Predict the positions of the moving obstacles at another time.

        Args:
            t_ns: the time, ns.

        Returns:
            (n, 3) x, y, padded radius in map, m; None if nothing moves.
        """
        return None if self.tracks is None else self.tracks.discs_at(t_ns, _PADDING_M)

    def update(
        self, points_m: FloatArray, laser_m: FloatArray, pose: FloatArray, t_ns: int
    ) -> NDArray[np.bool_] | None:
        """Update the tracks with a scan.

        Args:
            points_m: (n, 2) hits in base_link, in the order of their beams.
            laser_m: (2,) or longer, the laser's x, y in base_link.
            pose: (3,) base_link in map at the scan's end.
            t_ns: the scan's end, ns.

        Returns:
            (n,) whether each point belongs to a moving obstacle; None if none does.
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
        # For an unconfirmed track, only the points that moved are marked: it may be a wall.
        theirs = np.zeros_like(moved)
        for track in self._tracks:
            near = np.hypot(*(points - track.place).T) < track.radius + _PADDING_M
            theirs |= near if track.confirmed else near & moved
        return theirs if theirs.any() else None

    def _assign(self, clusters: list[Cluster], t_ns: int) -> None:
        """Assign clusters to tracks, nearest pairs first; start and drop tracks.

        Confirmed tracks choose first. Otherwise a fragment that starts a track of its own takes the
        obstacle away from the track that knows its pace.
        """
        pairs = sorted(
            (not track.confirmed, math.dist(track.place, cluster.centre), i, k)
            for i, track in enumerate(self._tracks)
            for k, cluster in enumerate(clusters)
            if math.dist(track.place, cluster.centre) < _GATE_M + _GATE_SIGMAS * track.std_m
        )
        used_tracks: set[int] = set()
        used: set[int] = set()
        for *_, i, k in pairs:
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
        """Return the message with the confirmed tracks, or None."""
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
        discs: position (2,) in map and radius of obstacles already tracked, m. A cluster that
            touches several of them is divided among them.

    Returns:
        One disc for each cluster. If a cluster is too large, such as a wall with a person in front
        of it, its disc covers only the points that moved.
    """
    if len(points) == 0:
        return []  # the scan saw nothing: all that is followed is out of sight
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
