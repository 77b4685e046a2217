"""Speed and separation: the robot stands before anything that moves can be where it is.

After ISO/TS 15066 and the passive safety of Macek et al. (2009). From the velocity that is chosen
the robot can be stopped, and until it stands no mover comes within a margin of its outline, as it
is predicted and a little aside or faster. What then runs into the robot finds it standing.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.config import DriveConfig, MonitorConfig, SeparationConfig, VehicleConfig
from simloop.geometry.footprint import arc_end, rectangle_distance
from simloop.messages import FloatArray, MoverTracks

_STEP_S = 0.05  # of the prediction while the robot brakes
_LOOK_S = 0.1  # of the prediction of encounters
_PARTS = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1)
_SLOW_MPS = 0.25  # from this speed the robot stands within 0.4 s
_AWAY = -0.5  # cosine of a mover's course to where the robot is, below which it goes away
_STOOD_NS = 50_000_000  # a robot that was told to stand for so long does stand


@njit(cache=True)
def gap_after(
    pose: FloatArray, ahead: float, turned: float, t: float, mover: FloatArray, half: FloatArray
) -> float:
    """Distance between the footprint at the end of an arc and a mover some time on.

    Args:
        pose: (3,) of base_link in map, m, m, rad.
        ahead: Length of the arc, m.
        turned: Yaw gained along the arc, rad.
        t: Time at which the mover is looked at, s.
        mover: (8,) as in `mover_discs`.
        half: (2,) half the footprint's length and width, m.

    Returns:
        The gap, m; negative inside.
    """
    cx, cy = arc_end(ahead, turned)
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    dx = mover[0] + mover[2] * t - pose[0] - cos * cx + sin * cy
    dy = mover[1] + mover[3] * t - pose[1] - sin * cx - cos * cy
    cos, sin = math.cos(pose[2] + turned), math.sin(pose[2] + turned)
    apart = rectangle_distance(cos * dx + sin * dy, cos * dy - sin * dx, half[0], half[1])
    return apart - mover[4]


@njit(cache=True)
def _comes(mover: FloatArray, pose: FloatArray, stands_mps: float) -> bool:
    """Whether a mover next to ``pose`` (2+) is not clearly on its way from there."""
    dx, dy = pose[0] - mover[0], pose[1] - mover[1]
    towards = mover[2] * dx + mover[3] * dy
    return mover[6] > stands_mps and towards > _AWAY * mover[6] * math.hypot(dx, dy)


@njit(cache=True)
def _leaves(movers: FloatArray, pose: FloatArray, stands_mps: float) -> NDArray[np.bool_]:
    """(n,) whether each of movers (n, 8) is clearly on its way from ``pose`` (2+)."""
    out = np.empty(movers.shape[0], np.bool_)
    for i in range(movers.shape[0]):
        out[i] = movers[i, 6] > stands_mps and not _comes(movers[i], pose, stands_mps)
    return out


@njit(cache=True)
def stays_clear(
    pose: FloatArray, speed: float, rate: float, movers: FloatArray, limits: FloatArray
) -> bool:
    """Say whether no mover reaches the robot before it has stopped from a velocity.

    Args:
        pose: (3,) of base_link in map, m, m, rad.
        speed: Forward speed, m/s.
        rate: Yaw rate, rad/s.
        movers: (n, 8) as in `mover_discs`.
        limits: (7,) reaction time, s, decelerations, m/s^2 and rad/s^2, half the footprint's
            length and width, m, the margin, m, and the speed below which a mover stands, m/s.

    Returns:
        True if each mover keeps the margin until the robot stands. What is too near already must
        not come nearer; if it is coming, only standing is safe. Faster than 0.25 m/s, nothing may
        be so near that it could reach the robot by turning round.
    """
    reaction, brake, yaw_brake, margin = limits[0], limits[1], limits[2], limits[5]
    half = limits[3:5]
    braking = max(abs(speed) / brake, abs(rate) / yaw_brake)
    until = reaction + braking
    for k in range(movers.shape[0]):
        first = gap_after(pose, 0.0, 0.0, 0.0, movers[k], half) - margin
        if first < 0.0 and _comes(movers[k], pose, limits[6]):
            return False
        for step in range(1, math.ceil(until / _STEP_S) + 1):
            t = min(step * _STEP_S, until)
            slowed = max(0.0, t - reaction)
            gone = t - (0.5 * slowed * slowed / braking if braking > 0.0 else 0.0)
            ahead, turned = speed * gone, rate * gone
            # As it is predicted, in a disc that grows with what is not known of it. What has been
            # calm for a while may be left even if there is less room than that growth.
            gap = gap_after(pose, ahead, turned, t, movers[k], half) - margin
            calm = movers[k, 7] <= limits[6] or first < 0.0
            growth = movers[k, 5] * t
            if gap < (min(growth, first) - 1e-6 if calm else growth):
                return False
            # It may turn round at once: as far from where it is now as it can come by then, with
            # its pace of late, because a mover that turns round seems to stand for a moment. A slow
            # robot may pass nearer than that, if it comes no nearer than it is.
            gap = gap_after(pose, ahead, turned, 0.0, movers[k], half)
            reach = max(movers[k, 6], movers[k, 7]) * t
            if gap < (reach + margin if abs(speed) > _SLOW_MPS else min(reach, first)):
                return False
    return True


@njit(cache=True)
def safe_part(
    pose: FloatArray, speed: float, rate: float, movers: FloatArray, limits: FloatArray
) -> float:
    """Find the greatest of a few parts of a velocity that is safe among what moves.

    Args:
        pose: (3,) of base_link in map, m, m, rad.
        speed: Forward speed, m/s.
        rate: Yaw rate, rad/s.
        movers: (n, 8) as in `mover_discs`.
        limits: (7,) as in `stays_clear`.

    Returns:
        The part, 0 to 1.
    """
    for part in _PARTS:
        if stays_clear(pose, part * speed, part * rate, movers, limits):
            return part
    return 0.0


@njit(cache=True)
def least_gap(
    pose: FloatArray,
    last: FloatArray,
    target: FloatArray,
    window: FloatArray,
    movers: FloatArray,
    half: FloatArray,
    until: float,
) -> float:
    """Predict the least gap to any mover while the robot goes over to another velocity.

    Args:
        pose: (3,) of base_link in map, m, m, rad.
        last: (2,) velocity now, m/s and rad/s.
        target: (2,) velocity that the robot goes over to, m/s and rad/s.
        window: (2,) accelerations of that change, m/s^2 and rad/s^2.
        movers: (n, 8) as in `mover_discs`.
        half: (2,) half the footprint's length and width, m.
        until: How far ahead to predict, s.

    Returns:
        The least gap, m, to the movers' growing discs.
    """
    least = np.inf
    speed, rate = last[0], last[1]
    at = pose.copy()
    for step in range(math.ceil(until / _LOOK_S) + 1):
        t = step * _LOOK_S
        for k in range(movers.shape[0]):
            gap = gap_after(at, 0.0, 0.0, t, movers[k], half) - movers[k, 5] * t
            least = min(least, gap)
        # One step of the change of velocity, then of the motion at the mean of both.
        before_speed, before_rate = speed, rate
        most, most_rate = window[0] * _LOOK_S, window[1] * _LOOK_S
        speed += min(max(target[0] - speed, -most), most)
        rate += min(max(target[1] - rate, -most_rate), most_rate)
        turned = 0.5 * (before_rate + rate) * _LOOK_S
        ahead = 0.5 * (before_speed + speed) * _LOOK_S
        at[0] += ahead * math.cos(at[2] + 0.5 * turned)
        at[1] += ahead * math.sin(at[2] + 0.5 * turned)
        at[2] += turned
    return least


@njit(cache=True)
def _discs(
    position: FloatArray,
    velocity: FloatArray,
    radius: FloatArray,
    std: FloatArray,
    pace: FloatArray,
    later: float,
    growth: tuple[float, float],
) -> FloatArray:
    """(n, 8) as in `mover_discs`, of tracks that are ``later`` s old."""
    out = np.empty((position.shape[0], 8))
    for i in range(position.shape[0]):
        vx, vy = velocity[i, 0], velocity[i, 1]
        out[i, 0], out[i, 1] = position[i, 0] + later * vx, position[i, 1] + later * vy
        out[i, 2], out[i, 3] = vx, vy
        out[i, 4] = radius[i] + std[i]
        out[i, 6] = math.hypot(vx, vy)
        out[i, 5] = growth[0] + growth[1] * out[i, 6]
        out[i, 7] = pace[i]
    return out


def mover_discs(tracks: MoverTracks, t_ns: int, config: SeparationConfig) -> FloatArray:
    """Express tracks at an instant as the kernels take them.

    Args:
        tracks: What moves.
        t_ns: The instant, ns.
        config: Growth of the discs.

    Returns:
        (n, 8) x, y, m, vx, vy, m/s, in map; radius, m; growth of the radius, m/s; the pace, m/s,
        at which the thing may turn round at any time; and the fastest pace of late, m/s.
    """
    return _discs(
        tracks.position_m,
        tracks.velocity_mps,
        tracks.radius_m,
        tracks.std_m,
        tracks.pace_mps,
        1e-9 * (t_ns - tracks.t_ns),
        (config.grows_mps, config.grows_share),
    )


@njit(cache=True)
def gaps_now(pose: FloatArray, movers: FloatArray, half: FloatArray) -> FloatArray:
    """Measure the present distance from the footprint to each mover.

    Args:
        pose: (3,) of base_link in map, m, m, rad.
        movers: (n, 8) as in `mover_discs`.
        half: (2,) half the footprint's length and width, m.

    Returns:
        (n,) the gaps, m; negative inside.
    """
    gaps = np.empty(movers.shape[0])
    for i in range(movers.shape[0]):
        gaps[i] = gap_after(pose, 0.0, 0.0, 0.0, movers[i], half)
    return gaps


class Separation:
    """Says what part of a velocity is safe among what moves, and when to stand."""

    def __init__(
        self,
        config: SeparationConfig,
        monitor: MonitorConfig,
        drive: DriveConfig,
        vehicle: VehicleConfig,
    ) -> None:
        self.config = config
        self.limits = np.array(
            [
                monitor.reaction_s,
                config.decel_mps2,
                drive.max_yaw_accel_radps2,
                0.5 * vehicle.length_m,
                0.5 * vehicle.width_m,
                config.margin_m,
                config.stands_mps,
            ]
        )
        self._stale_ns = round(config.stale_s * 1e9)
        self._patience_ns = round(config.patience_s * 1e9)
        self._touch_patience_ns = round(config.touch_patience_s * 1e9)
        self._visit_memory_ns = round(config.visit_memory_s * 1e9)
        self._moved_ns = 0
        # What came within the margin: track number -> (2,) its velocity then, and until when.
        self._visits: dict[int, tuple[FloatArray, int]] = {}

    def note_motion(self, t_ns: int, moves: bool) -> None:
        """Remember when the robot was last told to move.

        Args:
            t_ns: The instant, ns.
            moves: Whether its velocity is not zero.
        """
        if moves:
            self._moved_ns = t_ns

    def note_visits(
        self, pose: FloatArray, tracks: MoverTracks, movers: FloatArray, gaps: FloatArray
    ) -> None:
        """Remember what comes within the margin, and how it came.

        Args:
            pose: (3,) of base_link in map, m, m, rad.
            tracks: What moves.
            movers: (n, 8) the same as in `mover_discs`.
            gaps: (n,) their distances from the footprint now, m.
        """
        config = self.config
        for i in np.flatnonzero(gaps < config.margin_m).tolist():
            mover = movers[i]
            if mover[6] > config.stands_mps:
                towards = mover[2] * (pose[0] - mover[0]) + mover[3] * (pose[1] - mover[1])
                velocity = mover[2:4] if towards > 0.0 else -mover[2:4]
                until_ns = tracks.t_ns + self._visit_memory_ns
                self._visits[int(tracks.number[i])] = (velocity.copy(), until_ns)

    def expected_returns(self, tracks: MoverTracks, movers: FloatArray) -> FloatArray:
        """Predict that what came within the margin lately comes again, as it came then.

        Args:
            tracks: What moves.
            movers: (n, 8) the same as in `mover_discs`.

        Returns:
            (k, 8) those of the movers that are remembered, with the velocities at which they came.
        """
        if not self._visits:
            return movers[:0]
        self._visits = {n: v for n, v in self._visits.items() if v[1] > tracks.t_ns}
        known = [i for i, n in enumerate(tracks.number.tolist()) if n in self._visits]
        returning = movers[known]
        for row, i in zip(returning, known, strict=True):
            row[2:4] = self._visits[int(tracks.number[i])][0]
        return returning

    def may_be_met(self, movers: FloatArray, gaps: FloatArray, top_mps: float) -> bool:
        """Say whether anything may come so near within the horizon that evading it is worth a look.

        Args:
            movers: (n, 8) as in `mover_discs`.
            gaps: (n,) their distances from the footprint now, m.
            top_mps: The robot's largest speed, m/s.

        Returns:
            False only if no motion of the robot can bring it near, or near a return of a visitor.
        """
        if self._visits:
            return True
        # However the footprint turns, it stays within half its diagonal of its centre.
        config, turning_m = self.config, math.hypot(self.limits[3], self.limits[4])
        nearing = top_mps + movers[:, 6] + movers[:, 5]
        reach = config.threat_m + turning_m + config.horizon_s * nearing
        return bool((gaps < reach).any())

    def must_stand(
        self,
        pose: FloatArray,
        tracks: MoverTracks,
        movers: FloatArray,
        gaps: FloatArray,
        t_ns: int,
    ) -> bool:
        """Say whether the robot must stand whatever it is asked for.

        That is so without recent news of the movers, and for a while where a standing robot has
        something beside it that moved lately: it may reach the robot before that has got away.
        What is on its way from the robot does not hold it: then is the time to leave.

        Args:
            pose: (3,) of base_link in map, m, m, rad.
            tracks: What moves.
            movers: (n, 8) the same as in `mover_discs`.
            gaps: (n,) their distances from the footprint now, m.
            t_ns: The instant, ns.

        Returns:
            True if it must stand.
        """
        if t_ns - tracks.t_ns > self._stale_ns:
            return True
        stood_ns = t_ns - self._moved_ns
        if not _STOOD_NS < stood_ns < self._touch_patience_ns:
            return False
        # What moved lately and can be at the robot's side before it has got away; or touches it.
        config, patient = self.config, stood_ns < self._patience_ns
        near = config.margin_m + config.restless_s * tracks.pace_mps if patient else 0.0
        holds = (gaps < near) & (tracks.pace_mps > config.stands_mps)
        return bool((holds & ~_leaves(movers, pose, config.stands_mps)).any())
