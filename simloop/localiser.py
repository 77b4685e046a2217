"""Localise the robot with filter, map and dead reckoning, and decide whether to trust the pose.

    encoders, imu -> Ekf -> odom;  scan, odom -> GridSlam -> fix -> Ekf (at the time of the scan)

One control period calls ``predict``, then ``match`` and ``enter`` if a scan came, then
``conclude``. Between ``match`` and ``enter`` the caller finds the points of the scan that belong to
moving obstacles; these points stay out of the map.

The filter's gate may refuse a fix. Then ``motion_votes`` compares the motion since the last fix as
LiDAR, wheels and IMU measured it. If a jump of the gyro's bias or a push explains the difference,
the uncertainty of the affected states is increased and the fix is accepted. Unexplained fixes are
counted (``health``). After several of them the robot is lost: it stands still and searches its
whole map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simloop.common.profiler import Profiler
from simloop.config import Config
from simloop.ekf import Ekf
from simloop.estimation.dead_reckoning import DeadReckoning
from simloop.estimation.ekf_model import BIAS, ICR_X, RATE, SPEED, STATES
from simloop.estimation.health import HealthMonitor
from simloop.estimation.imu_range import ImuRange
from simloop.estimation.map_drift import MapDrift
from simloop.estimation.motion_votes import OdometryHistory, Outlier
from simloop.estimation.relocalise import SearchMap, relocalise
from simloop.estimation.shove_detector import ShoveDetector, SlideDetector
from simloop.estimation.sight import SightMonitor
from simloop.geometry.se2 import between, compose
from simloop.messages import (
    Estimate,
    Event,
    FloatArray,
    Health,
    HealthReason,
    HealthState,
    LidarScan,
    Message,
    PoseFix,
    Readings,
)
from simloop.slam_grid import GridSlam

# With less than this share of its beams matched, a scan sees too little to overrule the other
# sensors by itself, or to tell one place of the map from all others.
_RICH_SHARE = 1.0 / 3.0
_INFORMATIVE_POINTS = 30  # a scan with fewer points, e.g. of two posts, contradicts no belief
_POOR_SCORE = 0.6  # a match with a smaller share of matched points may be chance
# A match with a higher score and a smaller offset from the belief is accepted even if no other
# sensor supports it: belts that slip in a jerk are off by as much, and the accelerometer cannot
# detect that.
_SURE_SCORE, _SLIGHT_M, _SLIGHT_RAD = 0.9, 0.03, 0.03
_LEAST_BIAS_JUMP_RADPS = 0.03  # least standard deviation that is added to the gyro's bias
_RELOCALISED_COVARIANCE = np.diag([0.05**2, 0.05**2, 0.05**2])  # of x, y, yaw after a search
_AGREE_M, _AGREE_RAD = 0.08, 0.05  # largest difference of two successive search results
_NEAR_M, _NEAR_RAD = 0.3, 0.3  # surroundings of a belief in which a poor view may correct it
_GIVE_UP_NS = 10_000_000_000  # the robot gives up after this time lost, halted or without scans
_WRONG_M, _WRONG_RAD = 0.1, 0.1  # a pose that is off by more is wrong
_MOST_DOUBT = 1.3  # up to here the robot may say that it has arrived: the bound is a cautious one
_TILT_NS = 500_000_000  # the tilt is the mean over this time
_IN_PLANE_M = 0.05  # beams that rise or fall by less than this still meet what they met before
_HELD_VAR = 0.02**2  # a position with less variance than this is held by fixes, m^2
_UNMEASURED = {HealthReason.NO_COUNTS, HealthReason.NO_IMU}  # then the speed is a guess
_NOISY_M = 0.05  # ranges with more noise than this cannot hold a pose to a tenth of a metre
_EXPECTED_NOISE_M = 0.04  # the matcher's covariance accounts for less noise than this
_NOWHERE = np.empty((0, 2))
_HISTORY_NS = 800_000_000  # span of the odometry history: a later scan cannot be compared


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """A scan and its pose, after the correction of the filter.

    Attributes:
        scan: The scan as received.
        pose: (3,) x, y, yaw of base_link in map at the scan's stamp, m and rad.
        points_m: (n, 2) the scan's hits in base_link at its stamp, without the motion during the
            turn.
        fix: The match that was given to the filter.
        taken: Whether the filter accepted the fix.
        informative: Whether the scan has enough points to contradict the belief.
        relocalised: Whether the pose comes from a search of the whole map. Then it has jumped.
        unanswered_m: (k, 2) in map, m: known surfaces that the scan should have measured and did
            not, while its silence does not count as free space.
    """

    scan: LidarScan
    pose: FloatArray
    points_m: FloatArray
    fix: PoseFix
    taken: bool
    informative: bool
    relocalised: bool
    unanswered_m: FloatArray


class Localiser:
    """Estimator of the robot's pose and its map, one control period at a time.

    Attributes:
        ekf: The filter.
        slam: The map and the scan matcher.
        health: The health monitor of the localisation.
        mapped: Whether the map has any content yet.
        messages: The messages of this period, for the listeners.
    """

    def __init__(
        self, config: Config, start: FloatArray, base_from_laser: FloatArray, profiler: Profiler
    ) -> None:
        """Start at rest.

        Args:
            config: All settings.
            start: (3,) x, y, yaw of base_link in map, m and rad.
            base_from_laser: (3,) x, y, yaw of the laser in base_link.
            profiler: Measures the stages "ekf" and "slam".
        """
        period_s, scan_s = config.rates.control_s, config.rates.lidar_s
        self.ekf = Ekf(config.ekf, config.encoder, config.imu, config.vehicle, start, period_s)
        self.slam = GridSlam(config.slam, base_from_laser)
        self.health = HealthMonitor(round(scan_s * 1e9))
        self.mapped = bool(config.slam.prior_map)
        self.messages: list[Message] = []
        self._reckoning = DeadReckoning(config.vehicle, config.encoder)
        self._sweep_ns = round((scan_s + period_s) * 1e9)
        rows = round((_HISTORY_NS + self._sweep_ns) * 1e-9 / period_s)
        self._odometry = OdometryHistory(rows)
        self._shoves, self._slides = ShoveDetector(), SlideDetector()
        self._imu_range = ImuRange()
        self._encoders_ns = self._imu_ns = 0
        self._estimate = self.ekf.estimate()
        self._last_fix: PoseFix | None = None
        self._bias_at_fix = 0.0
        self._candidate: PoseFix | None = None
        self._rich = False  # whether most of the last scan was compared with the map
        self._sight = SightMonitor(config.monitor.open_ground)
        self._drift = MapDrift()
        self._judged, self._doubts = self._estimate, 0.0
        self._time = {name: profiler.stage(name) for name in ("ekf", "slam")}

    @property
    def gave_up(self) -> bool:
        """Whether the robot has been lost, halted by misfits, or without scans for too long."""
        now_ns = self._estimate.t_ns
        return now_ns - self.health.sure_until_ns(now_ns) > _GIVE_UP_NS

    @property
    def is_sure(self) -> bool:
        """Whether the pose is believed: the robot may drive by it, and it is not uncertain."""
        return not self.health.current.halts and self._doubt() <= _MOST_DOUBT

    def predict(self, readings: Readings, driven: bool) -> Estimate:
        """Advance the belief to the time of the readings with encoders and IMU.

        Args:
            readings: The readings of this period. Its scan, if any, is for ``match``.
            driven: Whether the motors have a voltage. If not, constant counts mean rest.

        Returns:
            The present belief.
        """
        self.messages.clear()
        with self._time["ekf"]:
            encoders, imu = readings.encoders, self._imu_range.believed(readings.imu)
            ekf, health, reckoning = self.ekf, self.health, self._reckoning
            before_ns = self._odometry.last_ns
            new_imu = imu.t_ns > self._imu_ns
            self._estimate = estimate = ekf.advance(encoders, imu, driven)
            state, t_ns = estimate.state, estimate.t_ns
            self._encoders_ns = max(self._encoders_ns, encoders.t_ns)
            self._imu_ns = max(self._imu_ns, imu.t_ns)
            health.readings(t_ns, self._encoders_ns, self._imu_ns)
            health.belts(t_ns, ekf.belts_refused)
            reckoning.advance(encoders, estimate)
            speed, rate = float(state[SPEED]), float(state[RATE])
            forward = lateral = 0.0
            if new_imu:
                forward, lateral, _ = imu.accel_mps2.tolist()
                if self._shoves.update(t_ns, lateral - speed * rate):
                    health.note(t_ns, HealthReason.SHOVED)
                ekf.shove_var = self._shoves.position_noise(t_ns)
            row = self._odometry.push(t_ns)
            row[:3], row[3:6] = reckoning.odom_from_base, reckoning.by_wheels
            row[6:] = (
                forward,
                lateral,
                imu.gyro_radps[2],
                1e-9 * (t_ns - before_ns),
                speed,
                -state[ICR_X] * rate,
                not (ekf.belts_refused[0] or ekf.belts_refused[1]),
            )
        return estimate

    def match(self, scan: LidarScan, ignore: FloatArray | None) -> Located | None:
        """Match a scan to the map and correct the belief at the time of the scan.

        Args:
            scan: A full turn; it may have ended a while ago.
            ignore: (n, 3) discs x, y, radius in map, m, of moving obstacles; points on them are
                not matched. None if nothing moves.

        Returns:
            The scan with its pose. None if the scan has no pose: it is older than the last scan or
            than the filter's history, or the robot is lost and the search had no result.
        """
        belief = self.ekf.belief_at(scan.t_ns)
        if belief is None or (self._last_fix and scan.t_ns <= self._last_fix.t_ns):
            return None
        with self._time["slam"]:
            fix = self._match_from(scan, ignore, *belief)
            points = self.slam.points_m
        informative = self.slam.matched >= _INFORMATIVE_POINTS
        self._rich = self.slam.matched >= _RICH_SHARE * len(scan.ranges_m)
        self.messages.append(fix)
        relocalised = False
        if self.health.lost:
            with self._time["slam"]:
                found = self._search_whole_map(scan, ignore)
            if found is None:
                self.health.scan(scan.t_ns, False, informative)
                return None
            fix, relocalised = found, True
        with self._time["ekf"]:
            taken = self._offer(fix)
        self.health.scan(scan.t_ns, taken or not self.mapped, informative)
        corrected = self.ekf.belief_at(scan.t_ns) or belief
        unanswered = self._judge_sight(scan, corrected[0])
        return Located(scan, corrected[0], points, fix, taken, informative, relocalised, unanswered)

    def enter(self, located: Located, mask: NDArray[np.bool_] | None) -> FloatArray:
        """Enter the last matched scan in the map, if its pose can be trusted.

        Args:
            located: Result of ``match`` in this period.
            mask: (n,) which of its points belong to moving obstacles and are not entered; None if
                there are none.

        Returns:
            (k, 2) in map, m, hit means of the cells that became occupied.
        """
        # A scan with too few points for a match is entered at the pose of the other sensors.
        trusted = located.taken or not self.mapped or not located.informative
        surfaces = np.empty((0, 2))
        if trusted and not self.ekf.shove_var:
            with self._time["slam"]:
                surfaces, new_share = self.slam.insert(located.scan, located.pose, mask)
                self.ekf.add_map_error(new_share)
                noise = max(1.0, self._sight.noise_m / _EXPECTED_NOISE_M)
                self._drift.extend(located.pose, noise**2 * located.fix.covariance, new_share)
                self.mapped = True
        with self._time["ekf"]:
            self._estimate = self.ekf.estimate()
        return surfaces

    def conclude(self) -> Estimate:
        """End the period: publish the frames, and the health if it has changed.

        Returns:
            The present belief, corrected with this period's scan.
        """
        estimate = self._estimate
        with self._time["ekf"]:
            self._note_doubts(estimate)
            self.messages.append(self._reckoning.frames(estimate))
            changed = self.health.review(estimate.t_ns)
        if changed is not None:
            self.messages += [changed, _event_of(changed)]
        return estimate

    def _note_doubts(self, estimate: Estimate) -> None:
        """Note whether the robot slides, and whether its pose is uncertain."""
        health, t_ns = self.health, estimate.t_ns
        in_map, reasons = self.ekf.covariance_in_map, health.current.reasons
        held = bool(in_map[0, 0] + in_map[1, 1] < _HELD_VAR)
        self._slides.update(t_ns, estimate.state, held and _UNMEASURED.isdisjoint(reasons))
        if self._slides.slippery(t_ns):
            health.note(t_ns, HealthReason.SLIDES)
        if self._doubt() > 1.0:
            health.note(t_ns, HealthReason.UNSURE)

    def _judge_sight(self, scan: LidarScan, pose: FloatArray) -> FloatArray:
        """Judge whether the LiDAR sees; (k, 2) in map, m, what stands though it is not seen."""
        # A tilted robot's beams pass over what they met before, or meet the ground.
        tilt = self._odometry.tilt(scan.t_ns - _TILT_NS, scan.t_ns)
        reach_m = _IN_PLANE_M / max(tilt, 1e-6)
        unanswered, recent = self.slam.unanswered(scan, pose, reach_m)
        sight = self._sight.judge(scan.ranges_m, recent, len(unanswered))
        self.health.sees(sight)
        self._sight.measure_noise(scan.ranges_m)
        if self._sight.noise_m > _NOISY_M:
            self.health.note(scan.t_ns, HealthReason.NOISY)
        return _NOWHERE if self._sight.silence_is_free else unanswered

    def _doubt(self) -> float:
        """Twice the deviation of the pose, as a share of what a right pose may be off."""
        if self._judged is not self._estimate:
            self._judged = self._estimate
            off_m, off_rad = self._drift.deviations(self._estimate.covariance[:3, :3])
            self._doubts = 2.0 * max(off_m / _WRONG_M, off_rad / _WRONG_RAD)
        return self._doubts

    def _match_from(
        self,
        scan: LidarScan,
        ignore: FloatArray | None,
        pose: FloatArray,
        covariance: FloatArray,
    ) -> PoseFix:
        times, poses = self._odometry.odom_poses(scan.t_ns - self._sweep_ns, scan.t_ns)
        return self.slam.match(scan, times, poses, pose, covariance, ignore)

    def _offer(self, fix: PoseFix) -> bool:
        """Give a fix to the filter. If it is refused, try to explain it and correct again."""
        if not fix.ok or not (self.ekf.correct(fix) or self._explain_and_correct(fix)):
            return False
        self._last_fix, self._bias_at_fix = fix, float(self.ekf.estimate().state[BIAS])
        return True

    def _explain_and_correct(self, fix: PoseFix) -> bool:
        """Explain the fix, widen the belief accordingly, and return whether the fix is accepted."""
        last = self._last_fix
        if last is None or fix.score < _POOR_SCORE:
            return False
        votes = self._odometry.votes(last.t_ns, fix.t_ns, self._bias_at_fix)
        belief = self.ekf.belief_at(fix.t_ns)
        if votes is None or belief is None:
            return False
        moved = between(last.pose, fix.pose)
        outlier, off = votes.outlier(moved), between(belief[0], fix.pose)
        off_m, off_rad = math.hypot(off[0], off[1]), abs(off[2])
        slight = off_m < _SLIGHT_M and off_rad < _SLIGHT_RAD
        if outlier is Outlier.LIDAR and not (slight and fix.score > _SURE_SCORE and self._rich):
            return False
        deviations = np.zeros(STATES)
        deviations[:2], deviations[2] = max(0.01, off_m), max(0.002, off_rad)
        if outlier is Outlier.GYRO:
            jump = abs(moved[2] - votes.imu[2]) / votes.duration
            deviations[BIAS] = max(_LEAST_BIAS_JUMP_RADPS, jump)
            self.health.note(fix.t_ns, HealthReason.GYRO)
        else:
            self.health.note(fix.t_ns, HealthReason.SHOVED)
        self.ekf.widen(fix.t_ns, deviations)
        return self.ekf.correct(fix)

    def _tells_places_apart(self, fix: PoseFix) -> bool:
        """Whether a place found in the whole map can be told from one that is not in the map yet.

        A view of little may be seen anywhere. It must hold the pose in all directions, and it
        moves the robot only within the surroundings of the last belief.
        """
        deviations = np.sqrt(np.diag(fix.covariance))
        if max(deviations[:2]) > _AGREE_M or deviations[2] > _AGREE_RAD:
            return False
        belief = self.ekf.belief_at(fix.t_ns)
        if self._rich or belief is None:
            return self._rich
        off = between(belief[0], fix.pose)
        return math.hypot(off[0], off[1]) < _NEAR_M and abs(off[2]) < _NEAR_RAD

    def _search_whole_map(self, scan: LidarScan, ignore: FloatArray | None) -> PoseFix | None:
        """Search the whole map for the scan. Two searches in a row must give the same place."""
        slam = self.slam
        where = SearchMap(
            slam.origin_m, slam.resolution_m, slam.grid.distances(), slam.log_odds < 0.0
        )
        fix = relocalise(
            slam.points_m,
            where,
            lambda pose: self._match_from(scan, ignore, pose, _RELOCALISED_COVARIANCE),
        )
        before, self._candidate = self._candidate, fix
        if fix is None or before is None or not self._tells_places_apart(fix):
            return None
        expected = compose(before.pose, self._odometry.odom_motion(before.t_ns, fix.t_ns))
        off = between(expected, fix.pose)
        if math.hypot(off[0], off[1]) > _AGREE_M or abs(off[2]) > _AGREE_RAD:
            return None
        # Only the pose is replaced. The gyro's bias is widened: it may be the cause of the loss.
        self.ekf.reset_pose(fix.t_ns, fix.pose, fix.covariance + _RELOCALISED_COVARIANCE)
        deviations = np.zeros(STATES)
        deviations[BIAS] = _LEAST_BIAS_JUMP_RADPS
        self.ekf.widen(fix.t_ns, deviations)
        self.health.found()
        self._candidate = None
        self.messages.append(Event(scan.t_ns, "info", "found its pose in the map again"))
        return fix


def _event_of(health: Health) -> Event:
    level = "info" if health.state is HealthState.OK else "warning"
    return Event(health.t_ns, level, ", ".join((f"localisation {health.state}", *health.reasons)))
