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
from numpy.typing import NDArray

from simloop.config import DriveConfig, RecoveryConfig
from simloop.control.collision_monitor import stoppable_part
from simloop.control.fan import (
    END_X,
    END_Y,
    EVADE,
    FREE,
    GAP,
    GET_FREE,
    ROOM,
    Weights,
    examine_fan,
    predict_gaps,
)
from simloop.control.separation import (
    Separation,
    gaps_now,
    least_gap,
    mover_discs,
    safe_part,
    stays_clear,
)
from simloop.control.trail import is_on_trail
from simloop.control.window import brake_along, is_reachable, step_straight, step_towards
from simloop.geometry.se2 import transform_points
from simloop.messages import FloatArray, Mode, MoverTracks, Velocity

STILL = Velocity(0.0, 0.0)
# Speeds and yaw rates of the fan, as shares of the largest ones. The speed of a recovery and
# turning on the spot come besides.
_SPEED_SHARES = (0.425, -0.425, 0.85, -0.85)
_RATE_SHARES = (0.0, 0.19, -0.19, 0.44, -0.44, 0.75, -0.75)
_RECOVERY_RATE_SHARE = 0.44  # largest yaw rate of a robot that frees itself
_ARC_S = 1.5  # duration of the fan's arcs
_CLEAR_S = 1.0  # duration for which an evasive arc must be free of what stands
_WAY_OUT_KEPT_NS = 400_000_000
_NO_BETTER_NS = 500_000_000  # an evasion goes on so long where nothing else is better
_RATE_COUNTS_M = 0.25  # a yaw rate off by 1 rad/s counts like a speed off by so many m/s
_ROOM_M = 0.08  # more room than this around the robot is worth no more


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
        trail_m: (k, 2) in base_link, m: where base_link has been. The robot may go backwards only
            there. None for a robot that sees all round.
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
    trail_m: FloatArray | None = None
    may_evade: bool = True
    stuck: bool = False
    towards: FloatArray | None = None


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
        self._recovery_mps = recovery.back_off_mps
        self._recovery_radps = _RECOVERY_RATE_SHARE * drive.max_yaw_rate_radps + 1e-9
        shares = (share * drive.max_speed_mps for share in _SPEED_SHARES)
        speeds = (-recovery.back_off_mps, recovery.back_off_mps, 0.0, *shares)
        rates = [share * drive.max_yaw_rate_radps for share in _RATE_SHARES]
        self._fan = np.array([(v, w) for v in speeds for w in rates if v or w])
        self._top_mps = drive.max_speed_mps
        self._way_out, self._way_out_until_ns = STILL, 0
        self._evasion, self._evasion_until_ns = STILL, -_NO_BETTER_NS  # none so far
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
            chosen, part = self._go_over(before, wanted, now, None, now.stuck)
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
        gaps = gaps_now(now.pose, discs, separation.limits[3:5])
        separation.note_visits(now.pose, tracks, discs, gaps)
        if separation.must_stand(now.pose, tracks, discs, gaps, now.t_ns):
            chosen, _ = self._go_over(before, STILL, now, discs)
            return chosen, Mode.YIELD
        evasion: Velocity | None = None
        if separation.may_be_met(discs, gaps, self._top_mps):
            evasion = self._evasion_from(before, wanted, discs, now)
        if evasion is not None:
            chosen, _ = self._go_over(before, self._permitted(evasion, now), now, discs)
            return chosen, Mode.DODGE
        chosen, part = self._go_over(before, wanted, now, discs, now.stuck)
        if part >= 1.0:
            return chosen, mode
        return chosen, Mode.YIELD if self._movers_hinder else Mode.HELD

    def _permitted(self, wanted: Velocity, now: Situation) -> Velocity:
        """The part of a velocity that cap and reversing permit, on the same arc."""
        most = float(self._window[3])
        speed, rate = wanted.speed_mps, min(max(wanted.yaw_rate_radps, -most), most)
        if speed < 0.0 and not (now.may_reverse and is_on_trail(now.trail_m, speed, rate)):
            return STILL
        cap = now.speed_cap_mps
        if cap >= self._top_mps:
            return Velocity(min(max(speed, -self._top_mps), self._top_mps), rate)
        part = 1.0
        if abs(speed) > cap:
            part = cap / abs(speed)
        if abs(rate) * part > cap * self._rate_per_speed:
            part = cap * self._rate_per_speed / abs(rate)
        return Velocity(part * speed, part * rate)

    def _go_over(
        self,
        before: FloatArray,
        wanted: Velocity,
        now: Situation,
        discs: FloatArray | None,
        on_arc: bool = False,
    ) -> tuple[Velocity, float]:
        """Go from the last velocity towards another one; the safe velocity, and its share.

        on_arc: whether to keep to the arc of the wanted velocity, as it was examined.
        """
        step = step_straight if on_arc else step_towards
        speed, rate = step(before, wanted.speed_mps, wanted.yaw_rate_radps, self._window)
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
        """A velocity out of the way of what is coming; None if none is needed or none is better."""
        config, limits = self._separation.config, self._separation.limits
        if not now.may_evade or now.speed_cap_mps <= 0.0:
            return None
        half, threats = limits[3:5], discs[discs[:, 6] > config.stands_mps]
        if now.movers is not None:
            returning = self._separation.expected_returns(now.movers, discs)
            threats = np.concatenate((threats, returning))

        def predict(target: FloatArray) -> float:
            return least_gap(
                now.pose, before, target, self._accelerations, threats, half, config.horizon_s
            )

        # No evasion is needed if nothing reaches the robot when it stands, or when it drives on.
        stood = predict(np.zeros(2))
        if stood > config.threat_m or predict(np.array(wanted)) > config.threat_m:
            return None
        if now.t_ns < self._evasion_until_ns and stays_clear(
            now.pose, *self._evasion, discs, limits
        ):
            return self._evasion
        found = examine_fan(self._fan, now.near_points_m, self._limits, _ARC_S)
        found[:, GAP] = predict_gaps(
            now.pose,
            before,
            self._fan,
            discs,
            threats,
            limits,
            self._accelerations,
            config.horizon_s,
        )
        clear = (found[:, FREE] * _ARC_S >= _CLEAR_S) & (found[:, GAP] > stood + config.worth_m)
        found[:, GAP] = np.minimum(found[:, GAP], config.comfort_m)
        best = self._best_of(found, EVADE, now, clear, wanted)
        if best is None and now.t_ns < self._evasion_until_ns + _NO_BETTER_NS:
            # What is asked for would lead back into its way: the last evasion goes on, as far as
            # that is safe.
            return self._evasion
        if best is not None:
            self._evasion = best
            self._evasion_until_ns = now.t_ns + round(config.keep_s * 1e9)
        return best

    def _way_out_of(self, now: Situation) -> Velocity:
        """The arc that is worth most to a robot that is stuck; kept for a while."""
        if now.t_ns >= self._way_out_until_ns:
            slow = np.abs(self._fan[:, 0]) <= self._recovery_mps
            gentle = np.abs(self._fan[:, 1]) <= self._recovery_radps
            found = examine_fan(self._fan, now.near_points_m, self._limits, _ARC_S)
            self._way_out = self._best_of(found, GET_FREE, now, slow & gentle, STILL) or STILL
            self._way_out_until_ns = now.t_ns + _WAY_OUT_KEPT_NS
        return self._way_out

    def _best_of(
        self,
        found: FloatArray,
        weights: Weights,
        now: Situation,
        eligible: NDArray[np.bool_],
        asked: Velocity,
    ) -> Velocity | None:
        """The velocity of the fan that is worth most; None if none is eligible."""
        forward = self._fan[:, 0] >= 0.0
        if not now.may_reverse:
            eligible = eligible & forward
        elif now.trail_m is not None:
            known = [is_on_trail(now.trail_m, v, w) for v, w in self._fan.tolist()]
            eligible = eligible & (forward | np.array(known))
        if not eligible.any():
            return None
        off = np.abs(self._fan - np.array(asked))
        worth = -weights.asked * (off[:, 0] + _RATE_COUNTS_M * off[:, 1])
        worth += weights.room * np.minimum(found[:, ROOM], _ROOM_M)
        worth += weights.way * found[:, FREE] * np.abs(self._fan[:, 0]) * _ARC_S
        if weights.gap:
            worth += weights.gap * found[:, GAP]
        if weights.nearer and now.towards is not None:
            there = transform_points(now.pose, found[:, END_X : END_Y + 1])
            away = np.hypot(*(there - now.towards).T)
            worth += weights.nearer * (math.dist(now.pose[:2], now.towards) - away)
        best = int(np.argmax(np.where(eligible, worth, -np.inf)))
        return Velocity(*self._fan[best].tolist())
