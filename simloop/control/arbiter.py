"""The velocity arbiter: the last choice before the motors.

    asked, last velocity, situation -> candidates -> hard limits -> the velocity of the next period

It follows what is asked as long as that is safe, takes a part of it where it is not, and compares a
fan of arcs where the robot is stuck or something is about to run into it. Whatever was chosen, four
limits hold for the velocity that leaves: the speed cap, the acceleration window, no reversing where
the robot may not, and stopping before anything that was seen or that moves.

Recursive feasibility: a velocity is let through only if braking along its arc is free. So braking
along the arc of the last velocity is always safe, and it is what remains when nothing else is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from simloop.config import DriveConfig, RecoveryConfig
from simloop.control.collision_monitor import CollisionMonitor, examine_arc, stoppable_part
from simloop.control.separation import (
    Separation,
    least_gap,
    mover_discs,
    safe_part,
    stays_clear,
)
from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray, Mode, MoverTracks, Velocity

STILL = Velocity(0.0, 0.0)
_BEHIND_RAD = 0.5 * math.pi
_STILL_BEHIND_RAD = 1.2  # for a robot that already goes backwards: no changing to and fro
_TURN_ROOM_M = 0.02  # beyond the monitor's margin, before a turn is begun on the way
_SPEEDS_MPS = (-0.4, -0.2, 0.2, 0.4)
_RATES_RADPS = (0.0, 0.6, -0.6, 1.2, -1.2)
_WAY_OUT_RATES_RADPS = (0.0, 0.3, -0.3, 0.7, -0.7)
_WAY_OUT_TURN_RADPS = 0.7
_WAY_OUT_S = 1.5  # duration of the arcs that are compared when the robot is stuck
_WAY_OUT_KEPT_NS = 400_000_000
_CLEAR_S = 1.0  # duration for which an evasive arc must be free of what stands
_LITTLE_MPS, _LITTLE_RADPS = 0.1, 0.3  # with no more left, getting out of the way comes first
_ROOM_M = 0.08  # more room than this around the robot is worth no more
_WAY_WORTH = 0.1  # m of room that a metre of way is worth, wherever it leads
_NEARER_WORTH = 0.3  # m of room that a metre nearer to the path's next part is worth
_SLACK = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Situation:
    """What the arbiter must know of one period.

    Attributes:
        t_ns: The instant, ns.
        pose: (3,) of base_link in map, m, m, rad.
        near_points_m: (n, 2) in base_link, m: what stands near the robot.
        movers: What moves; None if nothing is known to.
        doing: What the velocity that is asked for is meant to do.
        speed_cap_mps: Largest speed, m/s; 0 while the robot must not drive.
        may_reverse: Whether it may go backwards.
        may_evade: Whether it may leave its place to get out of something's way.
        stuck: Whether it is freeing itself.
        towards: (2,) in map, m: where the path leads next, for a robot that is stuck.
    """

    t_ns: int
    pose: FloatArray
    near_points_m: FloatArray
    movers: MoverTracks | None
    doing: Mode
    speed_cap_mps: float = math.inf
    may_reverse: bool = True
    may_evade: bool = True
    stuck: bool = False
    towards: FloatArray | None = None


@njit(cache=True)
def step_towards(
    last: FloatArray, speed: float, rate: float, window: FloatArray
) -> tuple[float, float]:
    """Go from the last velocity towards another one as far as one period allows.

    Args:
        last: (2,) velocity of the last period, m/s and rad/s.
        speed: Wanted speed, m/s.
        rate: Wanted yaw rate, rad/s.
        window: (4,) largest change of speed in a period when speeding up and when slowing down,
            m/s, largest change of the yaw rate and largest yaw rate, rad/s.

    Returns:
        Speed, m/s, and yaw rate, rad/s.
    """
    rate = min(max(rate, -window[3]), window[3])
    most = window[0] if abs(speed) > abs(last[0]) else window[1]
    # Through zero only by way of zero: the two halves have different limits.
    if speed * last[0] < 0.0:
        speed, most = 0.0, window[1]
    forward = last[0] + min(max(speed - last[0], -most), most)
    turning = last[1] + min(max(rate - last[1], -window[2]), window[2])
    return forward, turning


@njit(cache=True)
def brake_along(last: FloatArray, window: FloatArray) -> tuple[float, float]:
    """Brake along the arc of the last velocity as hard as one period allows.

    Args:
        last: (2,) velocity of the last period, m/s and rad/s.
        window: (4,) as in `step_towards`.

    Returns:
        Speed, m/s, and yaw rate, rad/s: a part of the last ones.
    """
    part = 1.0
    if last[0] != 0.0:
        part = min(part, window[1] / abs(last[0]))
    if last[1] != 0.0:
        part = min(part, window[2] / abs(last[1]))
    return last[0] * (1.0 - part), last[1] * (1.0 - part)


@njit(cache=True)
def is_reachable(last: FloatArray, speed: float, rate: float, window: FloatArray) -> bool:
    """Say whether one period can bring the robot from the last velocity to another one.

    Args:
        last: (2,) velocity of the last period, m/s and rad/s.
        speed: Speed, m/s.
        rate: Yaw rate, rad/s.
        window: (4,) as in `step_towards`.

    Returns:
        True if both changes are within the window.
    """
    if speed * last[0] < 0.0:
        return False
    most = window[0] if abs(speed) > abs(last[0]) else window[1]
    return abs(speed - last[0]) <= most + _SLACK and abs(rate - last[1]) <= window[2] + _SLACK


@njit(cache=True)
def evade(
    pose: FloatArray,
    last: FloatArray,
    fan: FloatArray,
    points: FloatArray,
    movers: FloatArray,
    limits: FloatArray,
    mover_limits: FloatArray,
    window: FloatArray,
    horizon: float,
    least_worth: float,
) -> int:
    """Choose the velocity of a fan that keeps farthest from what is coming.

    Args:
        pose: (3,) of base_link in map, m, m, rad.
        last: (2,) velocity of the last period, m/s and rad/s.
        fan: (m, 2) candidates, m/s and rad/s.
        points: (n, 2) what stands, m, in base_link.
        movers: (k, 7) as in `separation.mover_discs`.
        limits: (6,) as in `collision_monitor.stoppable_part`.
        mover_limits: (7,) as in `separation.stays_clear`.
        window: (2,) accelerations, m/s^2 and rad/s^2.
        horizon: How far ahead encounters are predicted, s.
        least_worth: The predicted gap that a candidate must exceed, m.

    Returns:
        The candidate's index, -1 if none is good enough.
    """
    best, chosen = least_worth, -1
    half = mover_limits[3:5]
    for i in range(fan.shape[0]):
        gap = least_gap(pose, last, fan[i], window, movers, half, horizon)
        if gap <= best or not stays_clear(pose, fan[i, 0], fan[i, 1], movers, mover_limits):
            continue
        # The whole arc of the next second must be free of what stands.
        free, _ = examine_arc(points, fan[i, 0] * _CLEAR_S, fan[i, 1] * _CLEAR_S, limits)
        if free >= 1.0:
            best, chosen = gap, i
    return chosen


def rear_first(
    monitor: CollisionMonitor, pose: FloatArray, path_yaw: float, reverses: bool
) -> bool:
    """Decide which end of the robot goes first along a path.

    A path that leads behind is mostly taken after a turn on the spot. Where the corners would meet
    something in that turn, the robot follows the same path backwards, until there is room to turn.

    Args:
        monitor: What has been seen near the robot.
        pose: (3,) of base_link in map, m, m, rad.
        path_yaw: Heading of the path here, rad, in map.
        reverses: Whether the robot already goes backwards.

    Returns:
        True if the rear goes first.
    """
    turn = wrap_angle(path_yaw - float(pose[2]))
    if abs(turn) <= (_STILL_BEHIND_RAD if reverses else _BEHIND_RAD):
        return False
    return not monitor.can_turn(turn, pose, _TURN_ROOM_M if reverses else 0.0)


class VelocityArbiter:
    """Chooses the velocity of each control period."""

    def __init__(
        self,
        drive: DriveConfig,
        recovery: RecoveryConfig,
        separation: Separation,
        stopping_limits: FloatArray,
        period_s: float,
    ) -> None:
        """stopping_limits: (6,) as in `collision_monitor.stoppable_part`."""
        self._separation, self._limits = separation, stopping_limits
        self._window = np.array(
            [
                drive.max_accel_mps2 * period_s,
                drive.max_brake_mps2 * period_s,
                drive.max_yaw_accel_radps2 * period_s,
                drive.max_yaw_rate_radps,
            ]
        )
        self._accelerations = np.array([drive.max_accel_mps2, drive.max_yaw_accel_radps2])
        self._rate_per_speed = drive.max_yaw_rate_radps / drive.max_speed_mps
        self._fan = np.array([(v, w) for v in _SPEEDS_MPS for w in _RATES_RADPS])
        speed = recovery.back_off_mps
        ways_out = [(s * speed, rate) for s in (-1.0, 1.0) for rate in _WAY_OUT_RATES_RADPS]
        ways_out += [(0.0, _WAY_OUT_TURN_RADPS), (0.0, -_WAY_OUT_TURN_RADPS)]
        self._ways_out = np.array(ways_out)
        self._way_out, self._way_out_until_ns = STILL, 0
        self._evasion, self._evasion_until_ns = STILL, 0
        self._movers_hinder = False

    def choose(self, asked: Velocity, last: Velocity, now: Situation) -> tuple[Velocity, Mode]:
        """Choose the velocity of the next period.

        Args:
            asked: What path tracking asks for.
            last: What was chosen in the last period.
            now: The situation.

        Returns:
            The velocity, and what the robot does with it: ``now.doing`` where what is asked is
            followed, else what replaced it.
        """
        wanted, mode = (self._way_out_of(now), Mode.BACK_OFF) if now.stuck else (asked, now.doing)
        before, wanted = np.array(last), self._permitted(wanted, now)
        if now.movers is None:
            chosen, part = self._go_over(before, wanted, now, None)
            mode = mode if part >= 1.0 else Mode.HELD
        else:
            chosen, mode = self._among_movers(before, wanted, mode, now)
        self._separation.note_motion(now.t_ns, chosen != STILL)
        return chosen, mode

    def _among_movers(
        self, before: FloatArray, wanted: Velocity, mode: Mode, now: Situation
    ) -> tuple[Velocity, Mode]:
        """As ``choose``, where things move."""
        separation, tracks = self._separation, now.movers
        assert tracks is not None
        discs = mover_discs(tracks, now.t_ns, separation.config)
        if separation.must_stand(now.pose, tracks, now.t_ns):
            chosen, _ = self._go_over(before, STILL, now, discs)
            return chosen, Mode.YIELD
        evasion = self._evasion_from(before, wanted, discs, now)
        if evasion is not None:
            chosen, _ = self._go_over(before, self._permitted(evasion, now), now, discs)
            return chosen, Mode.DODGE
        chosen, part = self._go_over(before, wanted, now, discs)
        if part >= 1.0:
            return chosen, mode
        return chosen, Mode.YIELD if self._movers_hinder else Mode.HELD

    def _permitted(self, wanted: Velocity, now: Situation) -> Velocity:
        """The part of a velocity that cap and reversing permit, on the same arc."""
        speed, rate = wanted
        if speed < 0.0 and not now.may_reverse:
            speed = 0.0
        cap = now.speed_cap_mps
        part = 1.0
        if abs(speed) > cap:
            part = cap / abs(speed)
        if abs(rate) * part > cap * self._rate_per_speed:
            part = cap * self._rate_per_speed / abs(rate)
        return Velocity(part * speed, part * rate)

    def _go_over(
        self, before: FloatArray, wanted: Velocity, now: Situation, discs: FloatArray | None
    ) -> tuple[Velocity, float]:
        """Go from the last velocity towards another one; what is safe of that, and which part."""
        speed, rate = step_towards(before, wanted.speed_mps, wanted.yaw_rate_radps, self._window)
        part = self._safe_part(speed, rate, now, discs)
        if part >= 1.0:
            return Velocity(speed, rate), part
        speed, rate = part * speed, part * rate
        if not is_reachable(before, speed, rate, self._window):
            speed, rate = brake_along(before, self._window)
        return Velocity(speed, rate), part

    def _safe_part(
        self, speed: float, rate: float, now: Situation, discs: FloatArray | None
    ) -> float:
        """The part of a velocity from which the robot can stop before all that stands or moves."""
        self._movers_hinder = False
        if speed == 0.0 and rate == 0.0:
            return 1.0
        part = 1.0
        if len(now.near_points_m):
            part = stoppable_part(now.near_points_m, speed, rate, self._limits)
        if discs is not None and part > 0.0:
            limits = self._separation.limits
            among = safe_part(now.pose, part * speed, part * rate, discs, limits)
            self._movers_hinder = among < 1.0
            part *= among
        return part

    def _evasion_from(
        self, before: FloatArray, wanted: Velocity, discs: FloatArray, now: Situation
    ) -> Velocity | None:
        """A velocity out of the way of what is coming; None where there is no need or no better."""
        config, limits = self._separation.config, self._separation.limits
        if not now.may_evade or now.speed_cap_mps <= 0.0:
            return None
        half, lively = limits[3:5], discs[discs[:, 6] > config.stands_mps]

        def predict(target: FloatArray) -> float:
            return least_gap(
                now.pose, before, target, self._accelerations, lively, half, config.horizon_s
            )

        # Who is not reached standing may wait, and who is not reached driving on may do that.
        stood = predict(np.zeros(2))
        if stood > config.threat_m or predict(np.array(wanted)) > config.threat_m:
            return None
        if now.t_ns < self._evasion_until_ns and stays_clear(
            now.pose, *self._evasion, discs, limits
        ):
            return self._evasion
        fan = self._fan if now.may_reverse else self._fan[self._fan[:, 0] >= 0.0]
        best = evade(
            now.pose,
            before,
            fan,
            now.near_points_m,
            discs,
            self._limits,
            limits,
            self._accelerations,
            config.horizon_s,
            stood + config.worth_m,
        )
        if best < 0:
            return None
        self._evasion = Velocity(*fan[best].tolist())
        self._evasion_until_ns = now.t_ns + round(config.keep_s * 1e9)
        return self._evasion

    def _way_out_of(self, now: Situation) -> Velocity:
        """The arc that is worth most to a robot that is stuck; kept for a while."""
        if now.t_ns >= self._way_out_until_ns:
            worth = [self._worth(v, w, now) for v, w in self._ways_out.tolist()]
            best = self._ways_out[int(np.argmax(worth))]
            self._way_out = Velocity(*best.tolist())
            self._way_out_until_ns = now.t_ns + _WAY_OUT_KEPT_NS
        return self._way_out

    def _worth(self, speed: float, rate: float, now: Situation) -> float:
        """m: the most room on an arc, what its way is worth, and what leads on along the path."""
        if speed < 0.0 and not now.may_reverse:
            return -math.inf
        ahead, turned = speed * _WAY_OUT_S, rate * _WAY_OUT_S
        free, room = examine_arc(now.near_points_m, ahead, turned, self._limits)
        worth = min(room, _ROOM_M) + _WAY_WORTH * free * abs(ahead)
        if now.towards is not None:
            heading = now.pose[2] + 0.5 * free * turned  # of the arc's chord
            chord = np.array([math.cos(heading), math.sin(heading)])
            there = now.pose[:2] + free * ahead * chord
            nearer = math.dist(now.pose[:2], now.towards) - math.dist(there, now.towards)
            worth += _NEARER_WORTH * nearer
        return worth
