"""Write what the robot senses, knows and plans, with one function for each kind of message.

Different heights separate things that are in the same plane in the 3D view.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from simloop.messages import (
    DepthImage,
    Event,
    GoalReading,
    LidarScan,
    LowObstacles,
    MapUpdate,
    MoverTracks,
    Plan,
    SmoothPath,
    TrackCommand,
    WorldView,
)
from simloop.recording.columns import circles, mover_strips
from simloop.recording.images import depth_columns, occupancy, pinhole
from simloop.recording.scene_log import BASE, CAMERA, MAP
from simloop.recording.stream import RecordingFile

_MAP_M = 0.004
_CANDIDATE_M = 0.006
_GOAL_M = 0.01
_PLAN_M = 0.02
_PATH_M = 0.03
_MOVER_M = 0.04
_OBSTACLE_M = 0.05
_GOAL_RADIUS_M = 0.1
_LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}


class EventWriter:
    """Writes the event log. A change of the driving mode is also an event."""

    def __init__(self, file: RecordingFile) -> None:
        self._file, self._mode = file, ""

    def write(
        self, events: Sequence[Event], plans: Sequence[Plan], commands: Sequence[TrackCommand]
    ) -> None:
        """Write one line for each event, plan and change of mode, in order of time.

        Args:
            events: The robot's events.
            plans: The robot's plans.
            commands: One command for each control period.
        """
        lines = [(e.t_ns, e.level, e.text) for e in events]
        for plan in plans:
            text = f"plan ({plan.reason}): {plan.planner}, cost {plan.cost:.3f}, "
            text += f"{plan.length_m:.2f} m, {plan.evaluations} evaluations"
            lines.append((plan.t_ns, "info" if plan.safe else "warning", text))
        for command in commands:
            if command.mode != self._mode:
                self._mode = command.mode
                lines.append((command.t_ns, "info", f"mode: {command.mode}"))
        if lines:
            lines.sort(key=lambda line: line[0])
            levels = [_LEVELS.get(level, level.upper()) for _, level, _ in lines]
            texts = [text for _, _, text in lines]
            columns = self._file.rr.TextLog.columns(text=texts, level=levels)
            self._file.send("events", [t_ns for t_ns, _, _ in lines], columns)


def write_scans(file: RecordingFile, scans: Sequence[LidarScan]) -> None:
    """Write the echoes of scans as points in the laser's frame.

    Args:
        file: The recording.
        scans: The LiDAR's scans.
    """
    if not scans:
        return
    rows = []
    for scan in scans:
        returned = np.isfinite(scan.ranges_m)
        angle, range_m = scan.angles_rad[returned], scan.ranges_m[returned]
        rows.append(range_m[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    file.send_points(f"{BASE}/laser/scan", [s.t_ns for s in scans], rows, 0.0)


def write_images(file: RecordingFile, images: Sequence[DepthImage]) -> None:
    """Write depth images.

    Args:
        file: The recording.
        images: The depth camera's images, all of the same size.
    """
    if images:
        file.log_static(CAMERA, pinhole(images[0]))
        file.send(f"{CAMERA}/depth", [i.t_ns for i in images], depth_columns(images))


def write_low_obstacles(file: RecordingFile, seen: Sequence[LowObstacles]) -> None:
    """Write the low obstacles that the robot remembers, as points.

    Args:
        file: The recording.
        seen: The robot's messages about them.
    """
    if seen:
        rows = [s.surfaces_m for s in seen]
        file.send_points(f"{MAP}/low_obstacles", [s.t_ns for s in seen], rows, _OBSTACLE_M)


def write_movers(file: RecordingFile, tracks: Sequence[MoverTracks]) -> None:
    """Write tracked moving obstacles as discs with a line to their place in one second.

    Args:
        file: The recording.
        tracks: The robot's messages about them.
    """
    if tracks:
        rows = [mover_strips(t.position_m, t.velocity_mps, t.radius_m) for t in tracks]
        file.send_strips(f"{MAP}/movers", [t.t_ns for t in tracks], rows, _MOVER_M)


def write_goals(file: RecordingFile, readings: Sequence[GoalReading]) -> None:
    """Write the goal's place in the readings that the robot gets.

    Args:
        file: The recording.
        readings: The readings of a moving goal.
    """
    if readings:
        rows = [circles(np.array([[*r.position_m, _GOAL_RADIUS_M]])) for r in readings]
        file.send_strips(f"{MAP}/goal_told", [r.t_ns for r in readings], rows, _GOAL_M)


def write_plan(file: RecordingFile, plan: Plan) -> None:
    """Write a plan: some candidates, the selected path and its waypoints.

    Args:
        file: The recording.
        plan: The plan.
    """
    times, waypoints = [plan.t_ns], plan.waypoints_m
    file.send_strips(f"{MAP}/plan/candidates", times, [plan.candidates_m], _CANDIDATE_M)
    file.send_strips(f"{MAP}/plan/chosen", times, [[waypoints]], _PLAN_M)
    file.send_points(f"{MAP}/plan/waypoints", times, [waypoints], _PLAN_M)


def write_discs(file: RecordingFile, view: WorldView) -> None:
    """Write the obstacle discs of the planner's world.

    Args:
        file: The recording.
        view: The planner's world.
    """
    outlines = circles(view.discs_xyr_m)
    file.send_strips(f"{MAP}/obstacle_discs", [view.t_ns], [outlines], _OBSTACLE_M)


def write_map(file: RecordingFile, grid: MapUpdate) -> None:
    """Write the robot's map.

    Args:
        file: The recording.
        grid: The map.
    """
    file.log_at(f"{MAP}/occupancy", grid.t_ns, occupancy(grid, _MAP_M))


def write_paths(file: RecordingFile, paths: Sequence[SmoothPath]) -> None:
    """Write the smooth paths that the tracker follows.

    Args:
        file: The recording.
        paths: The smoother's paths.
    """
    if paths:
        file.send_strips(f"{MAP}/path", [p.t_ns for p in paths], [[p.xy_m] for p in paths], _PATH_M)
