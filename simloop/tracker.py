"""The tracker: the body velocity that follows a path.

It follows a ``SmoothPath`` with the path's curvature fed forward and the lateral and heading errors
fed back (Samson's form: w = v kappa - k1 v e sinc(a) - k2 v a), at the speed that curvature,
clearance, the motors and the braking distance allow. It turns on the spot where the path asks for
it, goes rear first where it is told to, and stands still within the goal's tolerance. What may be
driven of that velocity is for the arbiter to say (``simloop.control``).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from simloop.config import DriveConfig, TrackerConfig, VehicleConfig
from simloop.geometry.se2 import about_face, wrap_angle
from simloop.messages import Estimate, FloatArray, Mode, SmoothPath, Velocity

_SEARCH_M = 0.5  # how far along the path the nearest sample may lie from the last one
_LEAST_MPS = 0.05  # speed on a path, so that the robot never stops short of its end
YAW, CURVATURE, ARC, SPEED = range(2, 6)  # columns of a path in the kernels, after x and y


class TrackingLaw(NamedTuple):
    """Constants of the control law.

    Attributes:
        lateral_gain: k1, 1/m^2.
        heading_gain: k2, 1/m.
        turn_gain: Yaw rate per heading error on the spot, 1/s.
        turn_on_spot: Heading error at which a turn on the spot begins, rad.
        end_turn: Heading error at which it ends, rad.
    """

    lateral_gain: float
    heading_gain: float
    turn_gain: float
    turn_on_spot: float
    end_turn: float


@njit(cache=True)
def speed_profile(
    arc: FloatArray,
    curvature: FloatArray,
    clearance: FloatArray,
    safe: float,
    limits: FloatArray,
) -> FloatArray:
    """Compute the speed that is allowed at each sample of a path that ends at rest.

    Args:
        arc: (k,) distance along the path, m.
        curvature: (k,) curvature of the path, 1/m.
        clearance: (k,) distance to the nearest obstacle, m.
        safe: The safety distance, m.
        limits: (7,) speed, m/s, yaw rate, rad/s, lateral acceleration, m/s^2, creep speed, m/s,
            open clearance, m, braking deceleration, m/s^2, half of the effective gauge, m.

    Returns:
        (k,) allowed speeds, m/s.
    """
    top, rate, lateral, creep, opening, brake, half_gauge = limits
    n = arc.shape[0]
    speed = np.empty(n)
    for i in range(n):
        bend = abs(curvature[i])
        # The outer track is the faster one, and its speed is what is limited.
        allowed = top / (1.0 + half_gauge * bend)
        if bend > 1e-6:
            allowed = min(allowed, rate / bend, math.sqrt(lateral / bend))
        # From creep speed at the safety distance to full speed where there is room.
        room = min(1.0, max(0.0, (clearance[i] - safe) / opening))
        speed[i] = min(allowed, creep + room * max(0.0, top - creep))
    # Backwards from rest at the end: no faster than what can be braked to the next sample's speed.
    speed[n - 1] = 0.0
    for i in range(n - 2, -1, -1):
        reach = math.sqrt(speed[i + 1] ** 2 + 2.0 * brake * (arc[i + 1] - arc[i]))
        speed[i] = min(speed[i], reach)
    return speed


@njit(cache=True)
def nearest_sample(path: FloatArray, x: float, y: float, start: int) -> int:
    """Find the sample of a path nearest to a place, from a sample on.

    Args:
        path: (k, 6) x, y, yaw, curvature, arc, speed.
        x: Place in map, m.
        y: Place in map, m.
        start: First sample to look at; the search ends half a metre further on.

    Returns:
        The sample's index.
    """
    best, found = 1e18, start
    for i in range(start, path.shape[0]):
        if path[i, ARC] - path[start, ARC] > _SEARCH_M:
            break
        d = (path[i, 0] - x) ** 2 + (path[i, 1] - y) ** 2
        if d < best:
            best, found = d, i
    return found


@njit(cache=True)
def velocity_along(
    path: FloatArray, i: int, x: float, y: float, off_heading: float, law: TrackingLaw
) -> tuple[float, float]:
    """Compute the velocity that leads onto a path and along it.

    Args:
        path: (k, 6) x, y, yaw, curvature, arc, speed.
        i: The nearest sample.
        x: Place of the robot in map, m.
        y: Place of the robot in map, m.
        off_heading: The robot's heading less the path's, rad.
        law: Gains.

    Returns:
        Speed, m/s, and yaw rate, rad/s.
    """
    cos, sin = math.cos(path[i, YAW]), math.sin(path[i, YAW])
    aside = -sin * (x - path[i, 0]) + cos * (y - path[i, 1])
    past_end = cos * (x - path[i, 0]) + sin * (y - path[i, 1])
    if i + 1 < path.shape[0]:
        # The profile a control period ahead, and never so slow that the robot stops short.
        speed = max(min(path[i, SPEED], path[i + 1, SPEED]), _LEAST_MPS)
    elif past_end > 0.0:
        return 0.0, 0.0
    else:
        speed = _LEAST_MPS
    sinc = math.sin(off_heading) / off_heading if abs(off_heading) > 1e-6 else 1.0
    rate = speed * path[i, CURVATURE]
    rate -= speed * (law.lateral_gain * aside * sinc + law.heading_gain * off_heading)
    return speed * max(0.0, math.cos(off_heading)), rate


@njit(cache=True)
def track(
    pose: FloatArray, path: FloatArray, at: int, turning: bool, law: TrackingLaw
) -> tuple[float, float, int, bool]:
    """Follow a path for one period.

    Args:
        pose: (3+,) x, y, yaw first, in map, m, m, rad.
        path: (k, 6) x, y, yaw, curvature, arc, speed.
        at: The nearest sample of the last period.
        turning: Whether the robot was turning on the spot.
        law: Gains.

    Returns:
        Speed, m/s, and yaw rate, rad/s, to ask for, the nearest sample, and whether it turns.
    """
    x, y = pose[0], pose[1]
    at = nearest_sample(path, x, y, at)
    ahead = min(at + 1, path.shape[0] - 1)
    off_heading = wrap_angle(pose[2] - path[ahead, YAW])
    # Two thresholds, so that a turn that has begun is brought to its end.
    turning = abs(off_heading) > (law.end_turn if turning else law.turn_on_spot)
    if turning:
        return 0.0, -law.turn_gain * off_heading, at, turning
    speed, rate = velocity_along(path, at, x, y, off_heading, law)
    return speed, rate, at, turning


class Tracker:
    """Follows one path at a time.

    Attributes:
        arrived: Whether the robot believes that it is within the goal's tolerance.
        doubts_since_ns: When the robot came to believe that it is at the goal, ns, while its pose
            is too uncertain to say so; else None.
        turning: Whether it turns on the spot.
        reverses: Whether it goes rear first; may be changed on the way.
    """

    def __init__(
        self,
        config: TrackerConfig,
        drive: DriveConfig,
        vehicle: VehicleConfig,
        safe_distance_m: float,
        goal: FloatArray,
        goal_tolerance_m: float,
        has_camera: bool = False,
    ) -> None:
        """goal: (2,) in map, m."""
        self._config, self._drive, self._vehicle = config, drive, vehicle
        self._safe = safe_distance_m
        self._goal = (float(goal[0]), float(goal[1]))
        self._tolerance_m = goal_tolerance_m
        self._arrive_m = max(0.5 * goal_tolerance_m, goal_tolerance_m - config.goal_margin_m)
        turn_on_spot = config.turn_on_spot_rad
        if has_camera:
            turn_on_spot = min(turn_on_spot, config.turn_on_spot_with_camera_rad)
        self._law = TrackingLaw(
            lateral_gain=config.lateral_gain_1pm2,
            heading_gain=config.heading_gain_1pm,
            turn_gain=config.turn_gain_1ps,
            turn_on_spot=turn_on_spot,
            end_turn=config.end_turn_rad,
        )
        self._path: SmoothPath | None = None
        self._samples = np.empty((0, 6))
        self._at = 0
        self.arrived = False
        self.doubts_since_ns: int | None = None
        self.turning = self.reverses = False

    def aim_at(self, goal: FloatArray) -> None:
        """Take the place of a goal that moves: to be near it is not to stay near.

        Args:
            goal: (2,) in map, m.
        """
        self._arrive_m = 0.5 * self._tolerance_m
        self._goal = (float(goal[0]), float(goal[1]))

    @property
    def path(self) -> SmoothPath | None:
        """The path that is being followed."""
        return self._path

    @property
    def next_sample(self) -> int:
        """Index of the first sample of the path that is still to come."""
        return self._at

    @property
    def path_yaw(self) -> float:
        """Where the path leads from here, rad, in map. There must be a path."""
        return float(self._samples[min(self._at + 1, len(self._samples) - 1), YAW])

    def follow(self, path: SmoothPath, gauge_ratio: float, reverses: bool = False) -> None:
        """Follow a path from now on.

        Args:
            path: The path, in map.
            gauge_ratio: How much wider than its gauge the robot turns.
            reverses: Whether the rear goes first.
        """
        self.reverses = reverses
        config, drive = self._config, self._drive
        limits = np.array(
            [
                drive.max_speed_mps,
                drive.max_yaw_rate_radps,
                config.max_lateral_accel_mps2,
                config.creep_mps,
                config.open_clearance_m,
                drive.max_decel_mps2,
                0.5 * gauge_ratio * self._vehicle.gauge_m,
            ]
        )
        profile = speed_profile(
            path.arc_m, path.curvature_1pm, path.clearance_m, self._safe, limits
        )
        self._path, self._at = path, 0
        self._samples = np.column_stack(
            (path.xy_m, path.yaw_rad, path.curvature_1pm, path.arc_m, profile)
        )

    def hold(self) -> None:
        """Forget the path and ask for standing still."""
        self._path = None

    def velocity(self, estimate: Estimate, sure: bool = True) -> tuple[Velocity, Mode]:
        """Compute what to ask for now; the arbiter keeps the limits of acceleration.

        Args:
            estimate: The belief now.
            sure: Whether the pose is believed. Without that the robot waits at the goal.

        Returns:
            The velocity that follows the path, and what it does.
        """
        state = estimate.state
        near = math.dist((state[0], state[1]), self._goal) <= self._arrive_m
        self.arrived = self.arrived or (near and sure)
        doubts = near and not self.arrived
        if not doubts:
            self.doubts_since_ns = None
        elif self.doubts_since_ns is None:
            self.doubts_since_ns = estimate.t_ns
        if self.arrived or doubts or self._path is None:
            return Velocity(0.0, 0.0), Mode.ARRIVED if self.arrived else Mode.STOP
        ahead = about_face(state) if self.reverses else state
        speed, rate, self._at, self.turning = track(
            ahead, self._samples, self._at, self.turning, self._law
        )
        forward = -speed if self.reverses else speed
        return Velocity(forward, rate), Mode.TURN if self.turning else Mode.FOLLOW
