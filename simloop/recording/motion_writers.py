"""Write the robot's motion: true and believed poses, trails, track speeds and errors."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from simloop.geometry.se2 import compose_all, wrap_angles
from simloop.messages import Estimate, FloatArray, Frames, TrackCommand
from simloop.recording.columns import ellipses, lifted, nees
from simloop.recording.scene_log import BASE, MAP, ODOM
from simloop.recording.stream import RecordingFile
from simloop.truth import LooseTruth, Truth

_POSE_PERIODS = 4  # control periods per written pose: 25 Hz of 100 Hz
_TRAIL_POSES = 2  # written poses per point of a trail
_ELLIPSE_SCALE = 10.0
_ELLIPSE_HEIGHT_M, _TRAIL_HEIGHT_M = 0.26, 0.012


class PoseWriter:
    """Writes poses at 25 Hz, and the trails, which grow with each write."""

    def __init__(self, file: RecordingFile, start: FloatArray) -> None:
        """Start all trails.

        Args:
            file: The recording.
            start: (3,) x, y, yaw of base_link in map where odometry starts.
        """
        self._file, self._start = file, start
        self._trails: dict[str, list[FloatArray]] = defaultdict(list)

    def write_truths(self, truths: Sequence[Truth]) -> None:
        """Write the true pose, the true trail and the angles of the sprockets.

        Args:
            truths: One ground truth for each control period.
        """
        few = truths[::_POSE_PERIODS]
        if not few:
            return
        times = [t.t_ns for t in few]
        half_angles = 0.5 * np.array([t.sprocket_rad for t in few])
        zero = np.zeros(len(few))
        for half, side in zip(half_angles.T, ("left", "right"), strict=True):
            # A rotation about +y, as x, y, z, w.
            xyzw = np.stack([zero, np.sin(half), zero, np.cos(half)], axis=1)
            turned = self._file.rr.Transform3D.columns(quaternion=xyzw)
            self._file.send(f"{BASE}/sprocket_{side}/turned", times, turned)
        places = np.array([t.position_m for t in few])
        attitudes = np.array([t.quaternion_wxyz for t in few])
        self._file.send_transforms(f"{MAP}/truth", times, places, attitudes)
        self._write_trail("truth", np.array([t.pose_xyyaw for t in few]), times[-1])

    def write_frames(self, frames: Sequence[Frames]) -> None:
        """Write the frames of REP-105 and the trails of dead reckoning.

        Args:
            frames: One message for each control period.
        """
        few = frames[::_POSE_PERIODS]
        if not few:
            return
        times = [f.t_ns for f in few]
        odometry = np.array([f.odom_from_base for f in few])
        self._write_poses(ODOM, times, np.array([f.map_from_odom for f in few]))
        self._write_poses(BASE, times, odometry)
        wheels = np.array([f.odom_from_base_by_wheels for f in few])
        for name, poses in (("odometry", odometry), ("wheels", wheels)):
            self._write_trail(name, compose_all(self._start, poses), times[-1])

    def write_estimates(self, estimates: Sequence[Estimate]) -> None:
        """Write the believed trail and the 95 % ellipse of the position, enlarged ten times.

        Args:
            estimates: One message for each control period.
        """
        few = estimates[::_POSE_PERIODS]
        if not few:
            return
        times = [e.t_ns for e in few]
        poses = np.array([e.pose for e in few])
        self._write_trail("belief", poses, times[-1])
        covariance = np.array([e.covariance[:2, :2] for e in few])
        outlines = ellipses(poses[:, :2], covariance, _ELLIPSE_SCALE)
        rows = [[outline] for outline in outlines]
        self._file.send_strips(f"{MAP}/ellipse_95_x10", times, rows, _ELLIPSE_HEIGHT_M)

    def _write_poses(self, entity: str, t_ns: Sequence[int], poses: FloatArray) -> None:
        """Write planar poses (N, 3), given in the parent's frame."""
        half, zero = 0.5 * poses[:, 2], np.zeros(len(poses))
        wxyz = np.stack([np.cos(half), zero, zero, np.sin(half)], axis=1)
        self._file.send_transforms(entity, t_ns, lifted(poses[:, :2], 0.0), wxyz)

    def _write_trail(self, name: str, poses: FloatArray, t_ns: int) -> None:
        """Add poses (N, 3) to a trail, and write the whole trail for the time ``t_ns``."""
        self._trails[name].append(poses[::_TRAIL_POSES, :2])
        strip = np.concatenate(self._trails[name])
        self._file.send_strips(f"{MAP}/trails/{name}", [t_ns], [[strip]], _TRAIL_HEIGHT_M)


def write_loose_bodies(file: RecordingFile, truths: Sequence[LooseTruth]) -> None:
    """Write the true poses of all bodies that can move.

    Args:
        file: The recording.
        truths: Their ground truth.
    """
    for number, name in enumerate(truths[0].bodies if truths else ()):
        places = np.array([t.position_m[number] for t in truths])
        attitudes = np.array([t.quaternion_wxyz[number] for t in truths])
        times = [t.t_ns for t in truths]
        file.send_transforms(f"{MAP}/arena/{name}/turned", times, places, attitudes)


def write_track_speeds(
    file: RecordingFile,
    truths: Sequence[Truth],
    commands: Sequence[TrackCommand],
    sprocket_radius_m: float,
) -> None:
    """Plot the tracks' true and commanded speeds.

    Args:
        file: The recording.
        truths: One ground truth for each control period.
        commands: One command for each control period.
        sprocket_radius_m: Radius at which a sprocket drives its belt.
    """
    sources: tuple[tuple[str, Sequence[Truth | TrackCommand]], ...]
    sources = (("track/true", truths), ("track/asked", commands))
    for entity, messages in sources:
        if messages:
            speeds = sprocket_radius_m * np.array([m.sprocket_radps for m in messages])
            file.send_scalars(entity, [m.t_ns for m in messages], speeds)


def write_errors(
    file: RecordingFile, truths: Sequence[Truth], estimates: Sequence[Estimate]
) -> None:
    """Plot the estimates' errors in map, and their NEES over x, y and yaw.

    Args:
        file: The recording.
        truths: One ground truth for each control period.
        estimates: Those without a truth at the same instant are left out.
    """
    at = {t.t_ns: t for t in truths}
    pairs = [(at[e.t_ns], e) for e in estimates if e.t_ns in at]
    if not pairs:
        return
    times = [e.t_ns for _, e in pairs]
    error = np.array([e.pose - t.pose_xyyaw for t, e in pairs])
    error[:, 2] = wrap_angles(error[:, 2])
    covariance = np.array([e.covariance[:3, :3] for _, e in pairs])
    file.send_scalars("error_position", times, np.hypot(error[:, 0], error[:, 1]))
    file.send_scalars("error_yaw", times, error[:, 2])
    file.send_scalars("nees", times, nees(error, covariance))
