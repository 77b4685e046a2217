"""Where the robot is: filter, map and dead reckoning together, and whether they are to be believed.

    encoders, imu -> Ekf -> odom;  scan, odom -> GridSlam -> fix -> Ekf (at the scan's own instant)

A fix that the filter's gate refuses is put to the vote (``increments``): what a jump of the gyro's
bias or a push explains is believed after all, and the belief widened in just what was wrong. What
nothing explains is counted, and ends in the search of the whole map by a robot that stands still.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from simloop.common.profiler import Profiler
from simloop.config import Config
from simloop.ekf import Ekf
from simloop.estimation.dead_reckoning import DeadReckoning
from simloop.estimation.ekf_model import BIAS, ICR_X, RATE, SPEED, STATES
from simloop.estimation.health import HealthMonitor
from simloop.estimation.motion_votes import Trail
from simloop.estimation.relocalise import SearchMap, relocalise
from simloop.geometry.se2 import between, compose
from simloop.messages import (
    GYRO,
    SHOVED,
    EncoderReading,
    Estimate,
    Event,
    FloatArray,
    ImuReading,
    LidarScan,
    Message,
    MoverTracks,
    PoseFix,
)
from simloop.perception.mover_tracks import MoverTracker
from simloop.slam_grid import GridSlam

_LEAST_POINTS = 30  # in a scan that can contradict: two thin posts that fit nowhere mean little
_POOR_SCORE = 0.6  # share of the points that meet the map: with fewer a fit is a matter of luck
_SURE_SCORE, _SLIGHT_M, _SLIGHT_RAD = 0.9, 0.03, 0.03
"""A match this good and this near is not the wrong place: belts that slip in a jerk are off by so
much, and neither they nor an accelerometer can tell."""
_SHOVE_MPS2 = 1.5  # sideways, more than tracks make of themselves, over _SHOVE_TICKS
_SHOVE_TICKS = 5
_SHOVE_NS = 300_000_000
_SHOVE_VAR = 0.1  # m^2/s: a decimetre in a scan's time
_JUMP_RADPS = 0.03  # least deviation of a gyro's bias that is doubted
_WIDE = np.diag([0.05**2, 0.05**2, 0.05**2])
_AGREE_M, _AGREE_RAD = 0.08, 0.05
_GIVE_UP_NS = 10_000_000_000
_REMEMBERED_NS = 800_000_000


class Localiser:
    """One control period at a time. start: (3,) in map; base_from_laser: (3,) x, y, yaw.

    ``slam`` is the map; ``said`` what there is to say of this period; ``jumped`` whether the robot
    has found itself somewhere else in it; ``seen_from`` (3,) where it was, in map, at the instant
    of a scan that was taken in, which may be a while ago.
    """

    def __init__(
        self, config: Config, start: FloatArray, base_from_laser: FloatArray, profiler: Profiler
    ) -> None:
        period_s, self._scan_s = config.rates.control_s, config.rates.lidar_s
        self.ekf = Ekf(config.ekf, config.encoder, config.imu, config.vehicle, start, period_s)
        self.slam = GridSlam(config.slam, config.vehicle, base_from_laser)
        self._watch, self._laser = MoverTracker(), np.array(base_from_laser, np.float64)
        self.health = HealthMonitor(round(self._scan_s * 1e9))
        self._reckoning = DeadReckoning(config.vehicle, config.encoder)
        self._sweep_ns = round((self._scan_s + period_s) * 1e9)
        self._trail = Trail(round((_REMEMBERED_NS + self._sweep_ns) * 1e-9 / period_s))
        self._aside: deque[float] = deque([0.0] * _SHOVE_TICKS, _SHOVE_TICKS)
        self._shoved_until_ns = self._encoders_ns = self._imu_ns = 0
        self._taken: PoseFix | None = None
        self._found: PoseFix | None = None
        self._bias = 0.0
        self.mapped, self.jumped = bool(config.slam.prior_map), False
        self.new_surfaces_m: FloatArray | None = None
        self.seen_from: FloatArray | None = None
        self.said: list[Message] = []
        self._time = {name: profiler.stage(name) for name in ("ekf", "slam")}

    @property
    def movers(self) -> MoverTracks | None:
        """What is known to move, as of the last scan that was entered."""
        return self._watch.tracks

    @property
    def gave_up(self) -> bool:
        """Whether it has been lost, or without scans, for too long."""
        return self._now_ns - self.health.sure_until_ns(self._now_ns) > _GIVE_UP_NS

    def step(
        self, encoders: EncoderReading, imu: ImuReading, scan: LidarScan | None, driven: bool
    ) -> Estimate:
        """Take one period's readings; the belief now. driven: whether the motors have a voltage."""
        self.said.clear()
        self.jumped, self.new_surfaces_m, self.seen_from = False, None, None
        with self._time["ekf"]:
            estimate = self._advance(encoders, imu, driven)
        if scan is not None:
            estimate = self._localise(scan, estimate)
        with self._time["ekf"]:
            self.said.append(self._reckoning.frames(estimate))
            changed = self.health.review(estimate.t_ns)
        if changed is not None:
            level = "info" if changed.state == "ok" else "warning"
            text = ", ".join((f"localisation {changed.state}", *changed.reasons))
            self.said += [changed, Event(estimate.t_ns, level, text)]
        return estimate

    def _advance(self, encoders: EncoderReading, imu: ImuReading, driven: bool) -> Estimate:
        ekf, health, reckoning = self.ekf, self.health, self._reckoning
        before_ns = self._trail.last_ns
        new_imu = imu.t_ns > self._imu_ns
        estimate = ekf.advance(encoders, imu, driven)
        self._now_ns, state = estimate.t_ns, estimate.state
        self._encoders_ns = max(self._encoders_ns, encoders.t_ns)
        self._imu_ns = max(self._imu_ns, imu.t_ns)
        health.readings(estimate.t_ns, self._encoders_ns, self._imu_ns)
        health.belts(estimate.t_ns, ekf.belts_refused)
        reckoning.advance(encoders, estimate)
        speed, rate = float(state[SPEED]), float(state[RATE])
        ahead = aside = 0.0
        if new_imu:
            ahead, aside, _ = imu.accel_mps2.tolist()
            self._feel(aside - speed * rate, estimate.t_ns)
        row = self._trail.push(estimate.t_ns)
        row[:3], row[3:6] = reckoning.odom_from_base, reckoning.by_wheels
        row[6:] = (
            ahead,
            aside,
            imu.gyro_radps[2],
            1e-9 * (estimate.t_ns - before_ns),
            speed,
            -state[ICR_X] * rate,
            not (ekf.belts_refused[0] or ekf.belts_refused[1]),
        )
        return estimate

    def _feel(self, aside: float, t_ns: int) -> None:
        """Notice a push by an acceleration sideways, m/s^2, that the robot's own motion has not."""
        self._aside.append(aside)
        if abs(sum(self._aside)) > _SHOVE_TICKS * _SHOVE_MPS2:
            self._shoved_until_ns = t_ns + _SHOVE_NS
            self.health.note(t_ns, SHOVED)
        self.ekf.shove_var = _SHOVE_VAR if t_ns < self._shoved_until_ns else 0.0

    def _localise(self, scan: LidarScan, estimate: Estimate) -> Estimate:
        """Match a scan, which may be of a while ago, and tell the filter; then enter it."""
        belief = self.ekf.belief_at(scan.t_ns)
        if belief is None or (self._taken and scan.t_ns <= self._taken.t_ns):
            return estimate
        with self._time["slam"]:
            fix = self._match(scan, *belief)
        self.seen_from = belief[0]
        seen = self.slam.matched >= _LEAST_POINTS
        self.said.append(fix)
        if self.health.lost:
            with self._time["slam"]:
                found = self._look_everywhere(scan)
            if found is None:
                self.health.scan(scan.t_ns, False, seen)
                return estimate
            fix = found
        with self._time["ekf"]:
            taken = self._believe(fix)
        self.health.scan(scan.t_ns, taken or not self.mapped, seen)
        with self._time["slam"]:
            # What tells too little to be placed by stands where the other senses have it.
            entered = (taken or not self.mapped or not seen) and not self.ekf.shove_var
            self._enter(scan, entered)
        with self._time["ekf"]:
            return self.ekf.estimate()

    def _match(self, scan: LidarScan, pose: FloatArray, covariance: FloatArray) -> PoseFix:
        times, poses = self._trail.odom(scan.t_ns - self._sweep_ns, scan.t_ns)
        moving = self._watch.discs_at(scan.t_ns)
        return self.slam.match(scan, times, poses, pose, covariance, moving)

    def _believe(self, fix: PoseFix) -> bool:
        """Give a fix to the filter; where it is refused, ask who is wrong, and mend that."""
        if not fix.ok or not (self.ekf.correct(fix) or self._mend(fix)):
            return False
        self._taken, self._bias = fix, float(self.ekf.estimate().state[BIAS])
        return True

    def _mend(self, fix: PoseFix) -> bool:
        """Whether the fix was taken once the belief had been widened by what explains it."""
        last = self._taken
        if last is None or fix.score < _POOR_SCORE:
            return False
        voices = self._trail.voices(last.t_ns, fix.t_ns, self._bias)
        belief = self.ekf.belief_at(fix.t_ns)
        if voices is None or belief is None:
            return False
        moved = between(last.pose, fix.pose)
        alone, off = voices.against(moved), between(belief[0], fix.pose)
        slight = math.hypot(off[0], off[1]) < _SLIGHT_M and abs(off[2]) < _SLIGHT_RAD
        if alone == "lidar" and not (slight and fix.score > _SURE_SCORE):
            return False
        doubts = np.zeros(STATES)
        doubts[:2] = max(0.01, math.hypot(off[0], off[1]))
        doubts[2] = max(0.002, abs(off[2]))
        if alone == "gyro":
            jump = abs(moved[2] - voices.imu[2]) / voices.duration
            doubts[BIAS] = max(_JUMP_RADPS, jump)
            self.health.note(fix.t_ns, GYRO)
        else:
            self.health.note(fix.t_ns, SHOVED)
        self.ekf.doubt(fix.t_ns, doubts)
        return self.ekf.correct(fix)

    def _enter(self, scan: LidarScan, mapped: bool) -> None:
        """Look what moves in a scan; enter the rest in the map, if it is to be ``mapped``."""
        belief = self.ekf.belief_at(scan.t_ns)
        self.seen_from = None if belief is None else belief[0]
        if belief is None:
            return
        moving = self._watch.update(self.slam.points_m, self._laser, belief[0], scan.t_ns)
        if self._watch.tracks is not None:
            self.said.append(self._watch.tracks)
        if not mapped:
            return
        self.slam.insert(scan, belief[0], moving)
        self.ekf.mapped(self.slam.new_share)
        self.mapped, self.new_surfaces_m = True, self.slam.new_surfaces_m

    def _look_everywhere(self, scan: LidarScan) -> PoseFix | None:
        """Find the scan in the whole map: twice in a row at the same place, to be believed."""
        slam = self.slam
        view = slam.view(scan.t_ns, slam.origin_m)
        where = SearchMap(slam.origin_m, slam.resolution_m, view.distance_m, slam.log_odds < 0.0)
        fix = relocalise(slam.points_m, where, lambda pose: self._match(scan, pose, _WIDE))
        before, self._found = self._found, fix
        if fix is None or before is None:
            return None
        expected = compose(before.pose, self._trail.odom_between(before.t_ns, fix.t_ns))
        off = between(expected, fix.pose)
        if math.hypot(off[0], off[1]) > _AGREE_M or abs(off[2]) > _AGREE_RAD:
            return None
        self.ekf.place(fix.t_ns, fix.pose, fix.covariance + _WIDE)
        doubts = np.zeros(STATES)
        doubts[BIAS] = _JUMP_RADPS
        self.ekf.doubt(fix.t_ns, doubts)
        self.health.found()
        self._found, self.jumped = None, True
        self._watch.reset()
        self.said.append(Event(scan.t_ns, "info", "found itself in its map again"))
        return fix
