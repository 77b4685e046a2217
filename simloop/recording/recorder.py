"""Records a run for rerun's viewer. It reads messages, and nothing can be felt by the run.

Messages are kept as they come and written about once a simulated second, in columns: a call of
the recording library costs the same for one row as for a hundred.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from simloop.config import VehicleConfig
from simloop.evaluation.plan_gap import PlanRecord
from simloop.geometry.se2 import compose_all, wrap_angles
from simloop.messages import (
    DepthImage,
    Estimate,
    Event,
    FloatArray,
    Frames,
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
from simloop.recording.blueprint import make_blueprint
from simloop.recording.columns import (
    DERIVED,
    SERIES,
    circles,
    ellipses,
    lifted,
    mover_strips,
    nees,
)
from simloop.recording.images import depth_columns, occupancy, pinhole
from simloop.recording.scene_log import BASE, CAMERA, MAP, ODOM, log_scene
from simloop.recording.shapes import Body, Shape
from simloop.truth import LooseTruth, Published, Truth

TIMELINE = "sim_time"
_FLUSH_NS = 1_000_000_000
_FLUSH_TIMEOUT_S = 10.0
_PARTING_S = 2.0
_POSE_TICKS = 4  # poses at 25 Hz, of the control loop's 100
_ELLIPSE_SCALE = 10.0
_MAP_M = 0.004  # just above the floor

_LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}

_log = logging.getLogger(__name__)


class Recorder(Protocol):
    """Whoever wants to hear every message of a run."""

    def offer(self, message: Published) -> None:
        """Take one message; it is read-only."""
        ...

    def close(self) -> None:
        """Write what is left. May be called twice."""
        ...


class NullRecorder:
    """Hears and keeps nothing."""

    def offer(self, message: Published) -> None:
        """Pass over a message."""

    def close(self) -> None:
        """Nothing to write."""


class RerunRecorder:
    """Streams a run into an ``.rrd`` file, readable up to its last second whatever happens.

    shapes, bodies: what is to be seen (see ``scene_shapes``). bounds_m: (4,) of the arena. goal:
    (2,) in map. start: (3,) x, y, yaw, where odometry begins. laser_m: (3,) the laser in base_link;
    camera_m: (3,) the camera, if there is one. Raises OSError if the file cannot be opened. A later
    failure to write is reported once, and the run goes on unrecorded.
    """

    def __init__(
        self,
        path: str | Path,
        shapes: Sequence[Shape],
        bodies: Sequence[Body],
        bounds_m: FloatArray,
        goal: Sequence[float] | FloatArray,
        start: Sequence[float] | FloatArray = (0.0, 0.0, 0.0),
        laser_m: Sequence[float] | FloatArray = (0.0, 0.0, 0.2),
        vehicle: VehicleConfig | None = None,
        title: str = "",
        camera_m: FloatArray | None = None,
    ) -> None:
        self._path = Path(path)
        with open(self._path, "ab"):  # before the library is asked, whose refusal is no OSError
            pass
        # The library's own log would tell of a full disk in three lines; one is told below.
        os.environ.setdefault("RUST_LOG", "off")
        import rerun as rr

        self._rr = rr
        self._vehicle = vehicle if vehicle is not None else VehicleConfig()
        self._start = np.array(start, float)
        self._kept: defaultdict[type, list[Any]] = defaultdict(list)
        self._due_ns = _FLUSH_NS
        self._trails: dict[str, list[FloatArray]] = defaultdict(list)
        self._mode = ""
        self._open = True
        self._sound_bytes = 0
        self._stream = rr.RecordingStream("simloop")
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        sight = None if camera_m is None else CAMERA
        try:
            self._stream.save(self._path, make_blueprint(bounds_m, TIMELINE, sight))
        except RuntimeError as error:
            self._stream.disconnect()
            raise OSError(f"cannot record to {self._path}: {error}") from None
        if title:
            self._stream.send_recording_name(title)
        mounts = (laser_m, camera_m)
        log_scene(self._stream, shapes, bodies, np.array(goal[:2], float), mounts, self._vehicle)
        self._name_series()

    def offer(self, message: Published) -> None:
        """Take one message; about once a simulated second, write all of those that were taken."""
        if self._open:
            # The truth opens a tick, so all that was kept belongs to whole ticks.
            if type(message) is Truth and message.t_ns >= self._due_ns:
                self._flush()
                self._due_ns = message.t_ns + _FLUSH_NS
            self._kept[type(message)].append(message)

    def add_plan_records(self, records: Sequence[PlanRecord]) -> None:
        """Plot what each replan came to beside the exact optimum; once, when the run is over."""
        known = [r for r in records if r.exact_cost is not None]
        if self._open and known:
            times = [round(r.t_s * 1e9) for r in known]
            self._send_scalars("plan_cost_exact", times, [r.exact_cost for r in known])
            gaps = [np.nan if r.gap_percent is None else r.gap_percent for r in known]
            self._send_scalars("plan_gap_percent", times, gaps)

    def close(self) -> None:
        """Write what is left and the file's footer."""
        if self._open:
            self._flush()
            self._open = False
            self._stream.disconnect()

    def _flush(self) -> None:
        kept, self._kept = self._kept, defaultdict(list)
        self._write_series(kept)
        self._write_derived(kept[Truth], kept[Estimate], kept[TrackCommand])
        self._write_poses(kept[Truth], kept[Estimate], kept[Frames])
        self._write_scans(kept[LidarScan])
        self._write_images(kept[DepthImage])
        self._write_low(kept[LowObstacles])
        self._write_loose(kept[LooseTruth])
        self._write_movers(kept[MoverTracks])
        self._write_goals(kept[GoalReading])
        for plan in kept[Plan]:
            self._write_plan(plan)
        for view in kept[WorldView]:
            self._write_discs(view)
        for grid in kept[MapUpdate]:
            self._write_map(grid)
        self._write_paths(kept[SmoothPath])
        self._write_events(kept[Event], kept[Plan], kept[TrackCommand])
        try:
            self._stream.flush(timeout_sec=_FLUSH_TIMEOUT_S)
            self._sound_bytes = self._path.stat().st_size
        except (RuntimeError, TimeoutError, ValueError, OSError) as error:
            self._give_up(error)

    def _give_up(self, error: Exception) -> None:
        """Cut off what was half written, which a strict reader would stumble over, and say so."""
        self._open = False
        _log.error("recording stopped, %s keeps what fitted: %s", self._path, error)
        # The library may wait for its dead writer for ever, here and again when Python ends.
        parting = threading.Thread(target=self._stream.disconnect, daemon=True)
        parting.start()
        parting.join(_PARTING_S)
        if parting.is_alive():
            self._rr.unregister_shutdown()
        with contextlib.suppress(OSError):
            os.truncate(self._path, self._sound_bytes)

    def _send(self, entity: str, t_ns: Sequence[int] | FloatArray, columns: Any) -> None:
        times = np.asarray(t_ns, dtype=np.int64).astype("timedelta64[ns]")
        column = self._rr.TimeColumn(TIMELINE, duration=times)
        self._rr.send_columns(entity, [column], columns, recording=self._stream)

    def _send_scalars(self, entity: str, t_ns: Sequence[int] | FloatArray, values: Any) -> None:
        self._send(f"plots/{entity}", t_ns, self._rr.Scalars.columns(scalars=values))

    def _send_strips(
        self, entity: str, t_ns: Sequence[int], rows: Sequence[Sequence[FloatArray]], height: float
    ) -> None:
        """One row of line strips (N, 2) an instant, laid at a height."""
        flat = [lifted(strip, height) for row in rows for strip in row]
        columns = self._rr.LineStrips3D.columns(strips=flat)
        self._send(entity, t_ns, columns.partition([len(row) for row in rows]))

    def _name_series(self) -> None:
        names = {entity: lines for entity, (_, lines, _) in SERIES.items()} | DERIVED
        for entity, lines in names.items():
            self._stream.log(f"plots/{entity}", self._rr.SeriesLines(names=lines), static=True)

    def _write_series(self, kept: dict[type, list[Any]]) -> None:
        for entity, (kind, _, column) in SERIES.items():
            messages = kept[kind]
            if messages:
                self._send_scalars(entity, [m.t_ns for m in messages], column(messages))

    def _write_derived(
        self, truths: list[Truth], estimates: list[Estimate], commands: list[TrackCommand]
    ) -> None:
        radius = self._vehicle.sprocket_radius_m
        if truths:
            speed = radius * np.array([t.sprocket_radps for t in truths])
            self._send_scalars("track/true", [t.t_ns for t in truths], speed)
        if commands:
            speed = radius * np.array([c.sprocket_radps for c in commands])
            self._send_scalars("track/asked", [c.t_ns for c in commands], speed)
        at = {t.t_ns: t for t in truths}
        pairs = [(at[e.t_ns], e) for e in estimates if e.t_ns in at]
        if not pairs:
            return
        times = [e.t_ns for _, e in pairs]
        error = np.array([e.pose - t.pose_xyyaw for t, e in pairs])
        error[:, 2] = wrap_angles(error[:, 2])
        covariance = np.array([e.covariance[:3, :3] for _, e in pairs])
        self._send_scalars("error_position", times, np.hypot(error[:, 0], error[:, 1]))
        self._send_scalars("error_yaw", times, error[:, 2])
        self._send_scalars("nees", times, nees(error, covariance))

    def _write_poses(
        self, truths: list[Truth], estimates: list[Estimate], frames: list[Frames]
    ) -> None:
        self._write_truth(truths)
        self._write_frames(frames[::_POSE_TICKS])
        estimates = estimates[::_POSE_TICKS]
        if not estimates:
            return
        times = [e.t_ns for e in estimates]
        map_from_base = np.array([e.pose for e in estimates])
        self._trail("belief", map_from_base[::2], times[-1])
        covariance = np.array([e.covariance[:2, :2] for e in estimates])
        outlines = ellipses(map_from_base[:, :2], covariance, _ELLIPSE_SCALE)
        self._send_strips(f"{MAP}/ellipse_95_x10", times, [[o] for o in outlines], 0.26)

    def _write_frames(self, frames: list[Frames]) -> None:
        if not frames:
            return
        times = [f.t_ns for f in frames]
        self._send_poses(ODOM, times, np.array([f.map_from_odom for f in frames]))
        self._send_poses(BASE, times, np.array([f.odom_from_base for f in frames]))
        for name, poses in (
            ("odometry", [f.odom_from_base for f in frames[::2]]),
            ("wheels", [f.odom_from_base_by_wheels for f in frames[::2]]),
        ):
            self._trail(name, compose_all(self._start, np.array(poses)), times[-1])

    def _write_truth(self, truths: list[Truth]) -> None:
        few = truths[::_POSE_TICKS]
        if not few:
            return
        times = [t.t_ns for t in few]
        turns = np.array([t.sprocket_rad for t in few])
        half = 0.5 * turns
        for column, side in enumerate(("left", "right")):
            # About +y: x, y, z, w.
            zero, angle = np.zeros(len(few)), half[:, column]
            quaternions = np.stack([zero, np.sin(angle), zero, np.cos(angle)], axis=1)
            turned = self._rr.Transform3D.columns(quaternion=quaternions)
            self._send(f"{BASE}/sprocket_{side}/turned", times, turned)
        quaternions = np.array([t.quaternion_wxyz for t in few])[:, [1, 2, 3, 0]]
        where = np.array([t.position_m for t in few])
        columns = self._rr.Transform3D.columns(translation=where, quaternion=quaternions)
        self._send(f"{MAP}/truth", times, columns)
        self._trail("truth", np.array([t.pose_xyyaw for t in few[::2]]), times[-1])

    def _send_poses(self, entity: str, t_ns: Sequence[int], poses: FloatArray) -> None:
        """Planar poses (N, 3) as transforms to the parent."""
        half, zero = 0.5 * poses[:, 2], np.zeros(len(poses))
        quaternions = np.stack([zero, zero, np.sin(half), np.cos(half)], axis=1)
        where = lifted(poses[:, :2], 0.0)
        columns = self._rr.Transform3D.columns(translation=where, quaternion=quaternions)
        self._send(entity, t_ns, columns)

    def _trail(self, name: str, poses: FloatArray, t_ns: int) -> None:
        """The whole way so far: it grows by a piece each second, and is shown as it was then."""
        self._trails[name].append(poses[:, :2])
        strip = np.concatenate(self._trails[name])
        self._send_strips(f"{MAP}/trails/{name}", [t_ns], [[strip]], 0.012)

    def _write_scans(self, scans: list[LidarScan]) -> None:
        if not scans:
            return
        rows = []
        for scan in scans:
            heard = np.isfinite(scan.ranges_m)
            angle, far = scan.angles_rad[heard], scan.ranges_m[heard]
            rows.append(far[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
        columns = self._rr.Points3D.columns(positions=lifted(np.concatenate(rows), 0.0))
        times = [s.t_ns for s in scans]
        self._send(f"{BASE}/laser/scan", times, columns.partition([len(r) for r in rows]))

    def _write_loose(self, truths: list[LooseTruth]) -> None:
        for number, name in enumerate(truths[0].bodies if truths else ()):
            where = np.array([t.position_m[number] for t in truths])
            turns = np.array([t.quaternion_wxyz[number] for t in truths])[:, [1, 2, 3, 0]]
            columns = self._rr.Transform3D.columns(translation=where, quaternion=turns)
            self._send(f"{MAP}/arena/{name}/turned", [t.t_ns for t in truths], columns)

    def _write_movers(self, tracks: list[MoverTracks]) -> None:
        """Each as a disc and where it will be in a second."""
        if tracks:
            rows = [mover_strips(t.position_m, t.velocity_mps, t.radius_m) for t in tracks]
            self._send_strips(f"{MAP}/movers", [t.t_ns for t in tracks], rows, 0.04)

    def _write_goals(self, readings: list[GoalReading]) -> None:
        if readings:
            rows = [circles(np.array([[*r.position_m, 0.1]])) for r in readings]
            self._send_strips(f"{MAP}/goal_told", [r.t_ns for r in readings], rows, 0.01)

    def _write_plan(self, plan: Plan) -> None:
        self._send_strips(f"{MAP}/plan/candidates", [plan.t_ns], [plan.candidates_m], 0.006)
        self._send_strips(f"{MAP}/plan/chosen", [plan.t_ns], [[plan.waypoints_m]], 0.02)
        points = self._rr.Points3D.columns(positions=lifted(plan.waypoints_m, 0.02))
        lengths = [len(plan.waypoints_m)]
        self._send(f"{MAP}/plan/waypoints", [plan.t_ns], points.partition(lengths))

    def _write_discs(self, view: WorldView) -> None:
        outlines = circles(view.discs_xyr_m)
        self._send_strips(f"{MAP}/obstacle_discs", [view.t_ns], [outlines], 0.05)

    def _write_paths(self, paths: list[SmoothPath]) -> None:
        if paths:
            rows = [[p.xy_m] for p in paths]
            self._send_strips(f"{MAP}/path", [p.t_ns for p in paths], rows, 0.03)

    def _write_map(self, grid: MapUpdate) -> None:
        self._stream.set_time(TIMELINE, duration=np.timedelta64(grid.t_ns, "ns"))
        self._stream.log(f"{MAP}/occupancy", occupancy(grid, _MAP_M))

    def _write_images(self, images: list[DepthImage]) -> None:
        if images:
            self._stream.log(CAMERA, pinhole(images[0]), static=True)
            self._send(f"{CAMERA}/depth", [i.t_ns for i in images], depth_columns(images))

    def _write_low(self, seen: list[LowObstacles]) -> None:
        if seen:
            points = lifted(np.concatenate([s.surfaces_m for s in seen]), 0.05)
            columns = self._rr.Points3D.columns(positions=points)
            lengths = [len(s.surfaces_m) for s in seen]
            self._send(f"{MAP}/low_obstacles", [s.t_ns for s in seen], columns.partition(lengths))

    def _write_events(
        self, events: list[Event], plans: list[Plan], commands: list[TrackCommand]
    ) -> None:
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
            columns = self._rr.TextLog.columns(text=[line[2] for line in lines], level=levels)
            self._send("events", [line[0] for line in lines], columns)
