"""Fault injection: apply a scenario's ``[[faults]]`` to the plant and to the sensors.

Faults act between the plant and the sensors, and between the sensors and the robot. The robot is
never told about them. docs/scenarios.md lists the kinds. docs/estimation.md explains how the robot
detects them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Annotated, Literal, Protocol

import numpy as np
from pydantic import Field, model_validator
from pydantic.dataclasses import dataclass

from simloop.common.quantities import STRICT, Coordinate, Point, has_area
from simloop.messages import DepthImage, EncoderReading, FloatArray, ImuReading, LidarScan
from simloop.physics.glass import Glass
from simloop.truth import RayCaster, Truth

Seconds = Annotated[float, Field(ge=0.0, le=1e6)]
Kind = Literal[
    "encoder_stuck",
    "encoders_silent",
    "gyro_jump",
    "imu_silent",
    "beams_dropped",
    "glass",
    "lidar_noise",
    "lidar_short",
    "lidar_silent",
    "lidar_late",
    "camera_silent",
    "ice",
    "pushed",
    "kidnapped",
]

# The keys that each kind needs besides its times.
_KEYS: dict[str, tuple[str, ...]] = {
    "encoder_stuck": ("side",),
    "encoders_silent": (),
    "gyro_jump": ("bias_radps",),
    "imu_silent": (),
    "beams_dropped": ("share",),
    "glass": ("min_m", "max_m"),
    "lidar_noise": ("noise_m",),
    "lidar_short": ("range_m",),
    "lidar_silent": (),
    "lidar_late": ("delay_s",),
    "camera_silent": (),
    "ice": ("side", "friction"),
    "pushed": ("shift_m",),
    "kidnapped": ("to",),
}
_TIMES = ("kind", "at_s", "for_s")
# A push is a spring and a damper with a limit on the force.
_PUSH_N, _PUSH_N_PER_M, _PUSH_NS_PER_M = 250.0, 4000.0, 300.0


def keys_of(kind: str) -> tuple[str, ...]:
    """List the keys that a kind of fault needs besides its times.

    Args:
        kind: The kind.

    Returns:
        Names of fields of `Fault`.
    """
    return _KEYS[kind]


@dataclass(frozen=True, slots=True, config=STRICT)
class Fault:
    """One fault. Each kind has its own keys; the others are None.

    Attributes:
        kind: what fails.
        at_s: when the fault begins, s.
        for_s: how long it lasts, s; 0: until the end of the run.
        side: encoder_stuck, ice: left or right. A stuck encoder loses its pulses. After the fault
            it counts on from the held count, as a quadrature counter does.
        bias_radps: gyro_jump: bias that is added to the rate about z, rad/s.
        share: beams_dropped: share of the beams that do not come back, 0 to 1.
        min_m: glass: (2,) lower corner, in map, of the box that beams pass through, m.
        max_m: glass: (2,) its upper corner, m.
        noise_m: lidar_noise: standard deviation that is added to the ranges, m.
        range_m: lidar_short: what is farther away sends no beam back, m. The scans do not say so.
        delay_s: lidar_late: delay of the scans, s.
        friction: ice: coefficient of friction of the ground under the track.
        shift_m: pushed: distance to the left, covered in ``for_s``, m.
        to: kidnapped: (3,) pose in map where the robot is put down, m, m, rad.
    """

    kind: Kind
    at_s: Seconds
    for_s: Seconds = 0.0
    side: Literal["left", "right"] | None = None
    bias_radps: Annotated[float, Field(ge=-10.0, le=10.0)] | None = None
    share: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    min_m: Point | None = None
    max_m: Point | None = None
    noise_m: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    range_m: Annotated[float, Field(gt=0.0, le=1000.0)] | None = None
    delay_s: Annotated[float, Field(gt=0.0, le=10.0)] | None = None
    friction: Annotated[float, Field(gt=0.0, le=2.0)] | None = None
    shift_m: Annotated[float, Field(ge=-2.0, le=2.0)] | None = None
    to: tuple[Coordinate, Coordinate, float] | None = None

    @model_validator(mode="after")
    def _has_its_own_keys(self) -> Fault:
        wanted = _KEYS[self.kind]
        given = {f.name for f in fields(self) if getattr(self, f.name) is not None} - {*_TIMES}
        listed = ", ".join(wanted) or "(none but at_s and for_s)"
        if given != set(wanted):
            raise ValueError(f"the keys of a fault '{self.kind}' are {listed}")
        if self.kind == "pushed" and self.for_s == 0.0:
            raise ValueError("a fault 'pushed' needs for_s above 0, the time of the push in s")
        if self.min_m and self.max_m and not has_area(self.min_m, self.max_m):
            raise ValueError("a fault 'glass' needs min_m below max_m in x and in y")
        return self

    def on(self, t_ns: int) -> bool:
        """Tell whether the fault is active at an instant.

        Args:
            t_ns: the instant, ns.

        Returns:
            True from ``at_s`` until ``for_s`` later.
        """
        since_s = t_ns * 1e-9 - self.at_s
        return since_s >= 0.0 and (self.for_s == 0.0 or since_s < self.for_s)


class Body(Protocol):
    """The interface through which faults act on a plant."""

    def ice(self, frictions: tuple[float | None, float | None]) -> None:
        """Change the ground's friction under the tracks.

        Args:
            frictions: coefficients under the left and the right track; None: the ground's own.
        """
        ...

    def push(self, force_n: FloatArray) -> None:
        """Push the chassis from now on.

        Args:
            force_n: (2,) in the world, N.
        """
        ...

    def put_down(self, pose: FloatArray) -> None:
        """Put the vehicle down somewhere else, at rest.

        Args:
            pose: (3,) x, y, m, and yaw, rad, in the world.
        """
        ...


class Faults:
    """All faults of one run, with their state."""

    def __init__(self, faults: Sequence[Fault], rng: np.random.Generator) -> None:
        """Take the faults of a scenario.

        Args:
            faults: the scenario's faults.
            rng: random stream that selects the beams that do not come back.
        """
        self._faults, self._rng = tuple(faults), rng
        self._held: list[int | None] = [None, None]  # held counts, left and right, while stuck
        self._lost = [0, 0]  # pulses lost so far, left and right
        self._encoders: EncoderReading | None = None
        self._imu: ImuReading | None = None
        self._late: list[tuple[int, LidarScan]] = []
        self._pushes: dict[Fault, FloatArray] = {}
        self._moved: set[Fault] = set()
        self._glass: Glass | None = None

    def act(self, body: Body, truth: Truth) -> None:
        """Apply the faults that act on the plant, before its next step.

        Args:
            body: the plant.
            truth: its state now.
        """
        if not self._faults:
            return
        frictions: list[float | None] = [None, None]
        force = np.zeros(2)
        for fault in self._faults:
            there = fault.on(truth.t_ns)
            if fault.kind == "ice" and there:
                frictions[fault.side == "right"] = fault.friction
            elif fault.kind == "pushed" and there:
                force += self._push(fault, truth)
            elif fault.kind == "kidnapped" and there and fault not in self._moved:
                self._moved.add(fault)
                body.put_down(np.array(fault.to))
        body.ice((frictions[0], frictions[1]))
        body.push(force)

    def encoders(self, reading: EncoderReading) -> EncoderReading:
        """Apply the encoder faults to a reading.

        Args:
            reading: what the encoders measure.

        Returns:
            The reading that the robot gets. While the encoders are silent: the last one again.
        """
        reading = self._stick(reading)
        silent = any(fault.on(reading.t_ns) for fault in self._of("encoders_silent"))
        if self._encoders is None or not silent:
            self._encoders = reading
        return self._encoders

    def imu(self, reading: ImuReading) -> ImuReading:
        """Apply the IMU faults to a reading.

        Args:
            reading: what the IMU measures.

        Returns:
            The reading that the robot gets. While the IMU is silent: the last one again.
        """
        for fault in self._of("gyro_jump"):
            if fault.on(reading.t_ns):
                gyro = reading.gyro_radps + np.array([0.0, 0.0, fault.bias_radps])
                reading = ImuReading(reading.t_ns, gyro, reading.accel_mps2)
        silent = any(fault.on(reading.t_ns) for fault in self._of("imu_silent"))
        if self._imu is None or not silent:
            self._imu = reading
        return self._imu

    def _stick(self, reading: EncoderReading) -> EncoderReading:
        """Hold the counts of stuck encoders.

        A quadrature counter only adds pulses. The pulses that come while it is stuck are lost, so
        it counts on from the held count afterwards.
        """
        faults = self._of("encoder_stuck")
        if not faults:
            return reading
        stuck = {fault.side for fault in faults if fault.on(reading.t_ns)}
        counts = [reading.left_counts, reading.right_counts]
        for i, side in enumerate(("left", "right")):
            if side not in stuck:
                self._held[i] = None
            elif (held := self._held[i]) is None:
                self._held[i] = counts[i] - self._lost[i]
            else:
                self._lost[i] = counts[i] - held
            counts[i] -= self._lost[i]
        return EncoderReading(reading.t_ns, *counts)

    def scan(self, scan: LidarScan | None, t_ns: int) -> LidarScan | None:
        """Apply the LiDAR faults to a scan: drop it, delay it, or worsen its beams.

        Args:
            scan: the scan of this control period, or None.
            t_ns: the instant, ns.

        Returns:
            The scan that the robot gets now, or None.
        """
        if not self._faults:
            return scan
        late = [fault for fault in self._of("lidar_late") if fault.on(t_ns)]
        if scan is not None and any(f.on(t_ns) for f in self._of("lidar_silent")):
            scan = None
        if scan is not None:
            for fault in self._of("beams_dropped", "lidar_noise", "lidar_short"):
                if fault.on(t_ns):
                    scan = replace(scan, ranges_m=self._worsened(fault, scan))
            if late:
                due = t_ns + round(1e9 * max(fault.delay_s or 0.0 for fault in late))
                self._late.append((due, scan))
                scan = None
        # A delayed scan is delivered in a period without a newer one.
        if scan is None and self._late and self._late[0][0] <= t_ns:
            scan = self._late.pop(0)[1]
        return scan

    def image(self, image: DepthImage | None, t_ns: int) -> DepthImage | None:
        """Apply the camera faults to an image.

        Args:
            image: the image of this control period, or None.
            t_ns: the instant, ns.

        Returns:
            The image that the robot gets now, or None.
        """
        return None if any(f.on(t_ns) for f in self._of("camera_silent")) else image

    def rays(self, world: RayCaster) -> RayCaster:
        """Add the panes of glass to a world.

        Args:
            world: the true world.

        Returns:
            The world as the LiDAR's beams see it.
        """
        panes = self._of("glass")
        self._glass = Glass(world, panes) if panes else None
        return self._glass or world

    def at(self, t_ns: int) -> None:
        """Set the instant at which `rays` checks which panes are active.

        Args:
            t_ns: the instant, ns.
        """
        if self._glass is not None:
            self._glass.t_ns = t_ns

    def _of(self, *kinds: str) -> list[Fault]:
        return [fault for fault in self._faults if fault.kind in kinds]

    def _worsened(self, fault: Fault, scan: LidarScan) -> FloatArray:
        """Compute the ranges (n,), m, that a fault of the beams leaves of a scan."""
        ranges = scan.ranges_m
        if fault.kind == "lidar_noise":
            ranges = ranges + (fault.noise_m or 0.0) * self._rng.standard_normal(len(ranges))
            gone = (ranges < scan.range_min_m) | (ranges > scan.range_max_m)
        elif fault.kind == "lidar_short":
            gone = ranges > (fault.range_m or 0.0)
        else:
            gone = self._rng.random(len(ranges)) < (fault.share or 0.0)
        return np.where(gone, np.inf, ranges)

    def _push(self, fault: Fault, truth: Truth) -> FloatArray:
        """Compute the force (2,), N, that pushes the robot sideways against its tracks' grip."""
        start = self._pushes.setdefault(fault, truth.pose_xyyaw.copy())
        f = min(1.0, (truth.t_ns * 1e-9 - fault.at_s) / fault.for_s)
        left = np.array([-math.sin(start[2]), math.cos(start[2])])
        # The push follows the smooth step f^2 (3 - 2 f) of the shift: at rest at both ends.
        aim = (fault.shift_m or 0.0) * f * f * (3.0 - 2.0 * f)
        pace = (fault.shift_m or 0.0) * 6.0 * f * (1.0 - f) / fault.for_s
        cos, sin = math.cos(truth.pose_xyyaw[2]), math.sin(truth.pose_xyyaw[2])
        vx, vy = truth.velocity_body[:2]
        velocity = left @ np.array([cos * vx - sin * vy, sin * vx + cos * vy])
        come = left @ (truth.pose_xyyaw[:2] - start[:2])
        force = _PUSH_N_PER_M * (aim - come) + _PUSH_NS_PER_M * (pace - velocity)
        return left * min(max(force, -_PUSH_N), _PUSH_N)
