"""A made-up run for the tests of recordings and pictures: many kinds of message, no loop.

The robot slides along the shortest safe path of the experiment's room. Scans are rays cast in
it, the map is painted from their ends, and the estimate has a small constant error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import mujoco
import numpy as np

from simloop.evaluation.shortest_path import shortest_path
from simloop.geometry.se2 import compose, inverse
from simloop.messages import (
    EncoderReading,
    Estimate,
    Event,
    Frames,
    Health,
    ImuReading,
    LidarScan,
    MapUpdate,
    Message,
    Plan,
    PoseFix,
    SmoothPath,
    TrackCommand,
    WorldView,
)
from simloop.physics.vehicle_geoms import road_wheels
from simloop.recording.scene_shapes import scene_bodies, scene_shapes
from simloop.recording.shapes import Scene
from simloop.truth import Published, Truth
from simloop.worlds.arena import bounds_of
from simloop.worlds.cross_section import floor_plan

GOAL = np.array([3.6, 3.9])
TICK_NS = 10_000_000
PLAN_NS = 1_830_000_000
SPEED_MPS = 0.35
OFF = np.array([0.008, -0.005, 0.004])
_RAYS = 360
_CELL_M = 0.05


def scene_of_model(
    model: mujoco.MjModel, title: str = "", camera_m: np.ndarray | None = None
) -> Scene:
    """Describe the scene of the made-up run."""
    return Scene(
        scene_shapes(model),
        scene_bodies(model),
        bounds_of(model),
        start=np.zeros(3),
        goal_m=GOAL,
        laser_m=np.array([0.0, 0.0, 0.2]),
        road_wheels=len(road_wheels(model)) // 2,
        camera_m=camera_m,
        title=title,
    )


class SyntheticRun:
    """A run as a stream of messages.

    Attributes:
        counts: How many messages of each kind ``messages`` has given so far.
    """

    def __init__(self, model: mujoco.MjModel, duration_s: float = 16.0) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        mujoco.mj_forward(model, self.data)
        plan = floor_plan(model)
        route = shortest_path(plan, np.zeros(2), GOAL, 0.3)
        assert route is not None
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(route.xy_m, axis=0).T))])
        self._arc = np.arange(0.0, arc[-1], 0.02)
        self._path = np.stack([np.interp(self._arc, arc, route.xy_m[:, i]) for i in (0, 1)], 1)
        self._yaw = np.unwrap(np.arctan2(*np.gradient(self._path, axis=0).T[::-1]))
        self._log_odds = np.zeros((104, 104), np.float32)
        self._origin = np.array([-0.7, -0.6])
        self.ticks = round(duration_s * 100)
        self.counts: dict[str, int] = {}

    def messages(self) -> Iterator[Published]:
        """Give all messages of the run in order."""
        for tick in range(self.ticks + 1):
            for message in self._tick(tick):
                name = type(message).__name__
                self.counts[name] = self.counts.get(name, 0) + 1
                yield message

    def pose(self, t_ns: int) -> np.ndarray:
        """Return the true pose (3,) of base_link in map."""
        s = min(SPEED_MPS * t_ns * 1e-9, self._arc[-1])
        values = [self._path[:, 0], self._path[:, 1], self._yaw]
        return np.array([np.interp(s, self._arc, v) for v in values])

    def _tick(self, tick: int) -> Iterator[Published]:
        t_ns = tick * TICK_NS
        pose, turn = self.pose(t_ns), SPEED_MPS * t_ns * 1e-9 / 0.037
        quaternion = np.array([math.cos(0.5 * pose[2]), 0.0, 0.0, math.sin(0.5 * pose[2])])
        sprocket = np.array([turn, turn])
        yield Truth(
            t_ns, pose, np.array([*pose[:2], 0.0]), quaternion,
            np.array([SPEED_MPS, 0.0, 0.0, 0.0, 0.0, 0.1]), np.array([0.0, 0.0, 9.81]),
            sprocket, np.full(2, 9.4), np.array([0.7, 0.8]), np.array([14.0, 15.0]),
            0.3 * t_ns * 1e-9, 0, False,
        )  # fmt: skip
        counts = int(turn * 980 / (2.0 * math.pi))
        yield EncoderReading(t_ns, counts, counts)
        yield ImuReading(t_ns, np.array([0.0, 0.0, 0.1]), np.array([0.0, 0.0, 9.81]))
        if tick % 10 == 0:
            scan = self.scan(t_ns)
            self._paint(scan, pose)
            yield scan
        yield TrackCommand(t_ns, SPEED_MPS, 0.1, np.array([9.5, 9.5]), np.array([14.0, 15.0]),
                           "follow")  # fmt: skip
        if tick % 10 == 0:
            yield PoseFix(t_ns, pose, np.diag([1e-4, 1e-4, 1e-5]), 0.9, True)
        if t_ns % PLAN_NS == 0:
            yield from self._plan(t_ns, pose)
        state = np.array([*(pose + OFF), SPEED_MPS, 0.1, 0.001, 1.2, 0.002, 0.01])
        variances = [1e-4, 4e-4, 1e-5, 1e-3, 1e-3, 1e-6, 1e-3, 1e-4, 1e-4]
        yield Estimate(t_ns, state, np.diag(variances))
        ahead = np.array([SPEED_MPS * t_ns * 1e-9, 0.0, 0.0])
        odom_from_map = inverse(ahead)
        yield Frames(t_ns, ahead, compose(state[:3], odom_from_map), ahead.copy())
        if tick in (0, 100):
            yield Health(t_ns, "degraded" if tick else "ok", ("a reason",) if tick else (), False)

    def _plan(self, t_ns: int, pose: np.ndarray) -> Iterator[Message]:
        s = min(SPEED_MPS * t_ns * 1e-9, self._arc[-1])
        ahead = self._arc >= s
        xy = self._path[ahead]
        waypoints = np.concatenate([pose[None, :2], xy[::25], GOAL[None]])
        bent = np.sin(np.linspace(0.0, math.pi, len(waypoints)))[:, None] * [0.12, -0.12]
        discs = np.array([[0.95, 0.95, 0.21], [2.05, 0.55, 0.19], [1.75, 1.75, 0.22]])
        yield Plan(t_ns, waypoints, 4.2, 5.6, 1.3, True, 9000, 40, "tlbo", "frame",
                   (waypoints + bent, waypoints - bent), safe_distance_m=0.26)  # fmt: skip
        bounds = np.array([-0.65, -0.55, 4.35, 4.45])
        distance = np.zeros((104, 104), np.float32)
        yield WorldView(t_ns, self._origin, _CELL_M, distance, discs, bounds)
        yield MapUpdate(t_ns, self._origin, _CELL_M, self._log_odds.copy())
        yield Event(t_ns, "info", "replanned: frame")
        n = len(xy)
        yield SmoothPath(t_ns, xy.copy(), self._yaw[ahead], np.zeros(n), self._arc[ahead],
                         np.full(n, 0.31), True)  # fmt: skip

    def scan(self, t_ns: int) -> LidarScan:
        """Cast one scan, all beams from the true pose at ``t_ns``."""
        pose = self.pose(t_ns)
        angles = np.linspace(-math.pi, math.pi, _RAYS, endpoint=False)
        world = angles + pose[2]
        rays = np.stack([np.cos(world), np.sin(world), np.zeros(_RAYS)], axis=1)
        groups = np.array([1, 0, 0, 0, 0, 0], np.uint8)
        hit, geom = np.empty(_RAYS), np.empty(_RAYS, np.int32)
        origin = np.array([*pose[:2], 0.2])
        mujoco.mj_multiRay(
            self.model, self.data, origin, rays.ravel(), groups, 1, -1, geom, hit, None,
            _RAYS, 12.0,
        )  # fmt: skip
        ranges = np.where(hit < 0.0, np.inf, hit)
        return LidarScan(t_ns, angles, ranges, np.zeros(_RAYS, np.int64), 0.15, 12.0)

    def _paint(self, scan: LidarScan, pose: np.ndarray) -> None:
        angle = scan.angles_rad + pose[2]
        ends = pose[:2] + scan.ranges_m[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
        cells = np.floor((ends - self._origin) / _CELL_M).astype(np.int32)
        free = np.zeros(self._log_odds.shape, np.uint8)
        cv2.fillPoly(free, [cells], 1)
        self._log_odds[free == 1] -= 0.4
        self._log_odds[cells[:, 1], cells[:, 0]] += 1.3
        np.clip(self._log_odds, -5.0, 5.0, out=self._log_odds)
