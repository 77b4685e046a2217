"""Smooth a polyline: replace its corners by pairs of cubic Bezier spirals.

Two cubics cut each corner over a distance d along both its sides (Yang & Sukkarieh 2010,
IEEE T-RO 26(3), Eqs. 6-9). The cubics meet with equal tangent and curvature. They join the straight
parts with zero curvature, so the curvature of the path is continuous. The curve stays inside the
corner's triangle. Its maximum curvature is c4 sin(b) / (d cos(b)^2), where b is half the turn: a
larger d gives a gentler curve. d starts as large as the sides allow. It shrinks until the discs of
the footprint keep their clearance along the whole curve. Clearance has priority over smoothness.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.config import SmootherConfig, VehicleConfig
from simloop.geometry.distance_field import Field, distance_at, field_of, footprint_clearance
from simloop.geometry.se2 import wrap_angle
from simloop.messages import FloatArray, Plan, SmoothPath, WorldView
from simloop.navigation.elastic_band import make_room
from simloop.planners.problem.clearance import SAFE_WITHIN_M, START_GROWTH

_C2 = 0.4 * (math.sqrt(6.0) - 1.0)
_C3 = (_C2 + 4.0) / (7.2364 + 6.0)
C4 = (_C2 + 4.0) ** 2 / (54.0 * _C3)
_STRAIGHT_RAD = 1e-3  # a corner that turns less than this is not cut
_SHRINK = 0.75
_GENTLE_M = 0.25  # a cut longer than this must keep the preferred clearance, not only the safe one
_LEAD_FRACTIONS = (1.0, 0.6, 0.3)


@njit(cache=True)
def corner_controls(a: FloatArray, corner: FloatArray, b: FloatArray, d: float) -> FloatArray:
    """Return the control points of the two cubics that cut a corner.

    Args:
        a: (2,) a point on the side that leads to the corner, m.
        corner: (2,) the corner, m.
        b: (2,) a point on the side that leads away from it, m.
        d: Length that is cut off each side, m.

    Returns:
        (8, 2) control points in the direction of travel, m: rows 0-3 for the first cubic, rows 4-7
        for the second.
    """
    back, ahead = a - corner, b - corner
    back /= math.hypot(back[0], back[1])
    ahead /= math.hypot(ahead[0], ahead[1])
    h = _C3 * d
    g = _C2 * h
    out = np.empty((8, 2))
    for i in range(2):
        out[0, i] = corner[i] + d * back[i]
        out[1, i] = out[0, i] - g * back[i]
        out[2, i] = out[1, i] - h * back[i]
        out[7, i] = corner[i] + d * ahead[i]
        out[6, i] = out[7, i] - g * ahead[i]
        out[5, i] = out[6, i] - h * ahead[i]
    for i in range(2):  # by symmetry the cubics meet half way
        out[3, i] = out[4, i] = 0.5 * (out[2, i] + out[5, i])
    return out


@njit(cache=True)
def cubic_sample(p: FloatArray, t: float, out: FloatArray) -> None:
    """Sample a cubic Bezier curve: position, heading and curvature.

    Args:
        p: (4, 2) control points, m.
        t: Parameter, 0 to 1.
        out: (4,) or longer; receives x, y, yaw, curvature, m, m, rad, 1/m.
    """
    s = 1.0 - t
    first, second = np.empty(2), np.empty(2)
    for i in range(2):
        out[i] = (
            s * s * s * p[0, i]
            + 3.0 * s * s * t * p[1, i]
            + 3.0 * s * t * t * p[2, i]
            + t * t * t * p[3, i]
        )
        e0, e1, e2 = p[1, i] - p[0, i], p[2, i] - p[1, i], p[3, i] - p[2, i]
        first[i] = 3.0 * (s * s * e0 + 2.0 * s * t * e1 + t * t * e2)
        second[i] = 6.0 * (s * (e1 - e0) + t * (e2 - e1))
    speed = math.hypot(first[0], first[1])
    out[2] = math.atan2(first[1], first[0])
    out[3] = (first[0] * second[1] - first[1] * second[0]) / max(1e-12, speed**3)


@njit(cache=True)
def _corner_clearance(controls: FloatArray, field: Field, offsets: FloatArray) -> float:
    """Compute the least footprint clearance along both cubics of a corner, m."""
    least, sample, n = 1e3, np.empty(4), 16
    for half in range(2):
        for step in range(n + 1):
            cubic_sample(controls[4 * half : 4 * half + 4], step / n, sample)
            here = footprint_clearance(field, sample[0], sample[1], sample[2], offsets)
            least = min(least, here)
    return least


@njit(cache=True)
def fit_corners(
    points: FloatArray,
    field: Field,
    offsets: FloatArray,
    safe: float,
    preferred: float,
    most: float,
    least: float,
) -> FloatArray:
    """Choose the length that is cut off the sides at each corner of a polyline.

    If even the tightest cut keeps too little clearance, the tightest cut is used. The robot then
    nearly turns on the spot, along the polyline that the planner has checked.

    Args:
        points: (n, 2) the polyline, in map, m.
        field: The distance field.
        offsets: (k,) positions of the footprint's discs along the heading, m.
        safe: Clearance that every cut keeps, m.
        preferred: Clearance that a gentle cut keeps, m.
        most: Deepest cut, m.
        least: Tightest cut, m.

    Returns:
        (n,) the cuts, m; 0 where the polyline is almost straight.
    """
    n = points.shape[0]
    cuts = np.zeros(n)
    for i in range(1, n - 1):
        before = math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
        after = math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
        # Room on the two sides: the next corner needs its half of the side between them.
        room = before - cuts[i - 1]
        room = min(room, after if i == n - 2 else 0.5 * after)
        turn = math.atan2(points[i + 1, 1] - points[i, 1], points[i + 1, 0] - points[i, 0])
        turn -= math.atan2(points[i, 1] - points[i - 1, 1], points[i, 0] - points[i - 1, 0])
        if abs(wrap_angle(turn)) < _STRAIGHT_RAD:
            continue
        # Shrink the deepest cut until the footprint keeps its clearance along the curve.
        cut = min(most, room)
        while cut > least:
            controls = corner_controls(points[i - 1], points[i], points[i + 1], cut)
            enough = preferred if cut > _GENTLE_M else safe
            if _corner_clearance(controls, field, offsets) >= enough:
                break
            cut *= _SHRINK
        cuts[i] = min(room, max(cut, least))
    return cuts


@njit(cache=True)
def sample_path(points: FloatArray, cuts: FloatArray, spacing: float) -> FloatArray:
    """Sample a polyline whose corners are cut.

    Args:
        points: (n, 2) the polyline, in map, m.
        cuts: (n,) length cut off at each corner, m; 0 leaves the corner as it is.
        spacing: Largest distance between two samples, m.

    Returns:
        (k, 4) x, y, yaw, curvature along the path, m, m, rad, 1/m.
    """
    rows = [np.empty(4) for _ in range(0)]
    at = points[0].copy()
    n = points.shape[0]
    for i in range(1, n):
        step = points[i] - points[i - 1]
        size = math.hypot(step[0], step[1])
        if size < 1e-9:
            continue
        heading = math.atan2(step[1], step[0])
        # The straight part up to the start of the cut.
        end = points[i] - step * (cuts[i] / size)
        run = math.hypot(end[0] - at[0], end[1] - at[1])
        count = math.ceil(run / spacing) if run > 1e-9 else 0  # no straight part if two cuts meet
        for s in range(count):
            f = s / count
            here = at + f * (end - at)
            rows.append(np.array([here[0], here[1], heading, 0.0]))
        at = end
        if cuts[i] > 0.0:
            # The two cubics of the corner.
            controls = corner_controls(points[i - 1], points[i], points[i + 1], cuts[i])
            count = max(4, math.ceil(cuts[i] / spacing))
            for half in range(2):
                for s in range(count):
                    sample = np.empty(4)
                    cubic_sample(controls[4 * half : 4 * half + 4], s / count, sample)
                    rows.append(sample)
            at = controls[7].copy()
        if i == n - 1:
            rows.append(np.array([at[0], at[1], heading, 0.0]))
    out = np.empty((len(rows), 4))
    for r in range(len(rows)):
        out[r] = rows[r]
    return out


@njit(cache=True)
def path_clearance(samples: FloatArray, field: Field, offsets: FloatArray) -> FloatArray:
    """Return the footprint's clearance at each sample of a path.

    Args:
        samples: (k, 3 or more) x, y, yaw, in map, m, m, rad.
        field: The distance field.
        offsets: (n,) positions of the footprint's discs along the heading, m.

    Returns:
        (k,) least distance from the centre of any disc to an obstacle, m.
    """
    out = np.empty(samples.shape[0])
    for i in range(samples.shape[0]):
        out[i] = footprint_clearance(field, samples[i, 0], samples[i, 1], samples[i, 2], offsets)
    return out


@njit(cache=True)
def keeps_distance(
    samples: FloatArray,
    arc: FloatArray,
    field: Field,
    offsets: FloatArray,
    enough: float,
    start_lack: float,
) -> bool:
    """Tell whether a path keeps a distance from obstacles, by the planner's own rule.

    Near a start that is too close to an obstacle, a smaller distance is enough: see
    `make_problem`. Discs that lie behind the start are not checked, because the robot already
    stands there.

    Args:
        samples: (k, 3 or more) x, y, yaw along the path, in map, m, m, rad.
        arc: (k,) length of the path up to each sample, m.
        field: The distance field.
        offsets: (n,) positions of the footprint's discs along the heading, m.
        enough: Required distance from the discs' centres to obstacles, m.
        start_lack: How much the clearance at the start falls short of ``enough``, m.

    Returns:
        Whether every disc keeps the distance at every sample.
    """
    overhang = offsets.max()
    for i in range(samples.shape[0]):
        cos, sin = math.cos(samples[i, 2]), math.sin(samples[i, 2])
        for k in range(offsets.shape[0]):
            if arc[i] + offsets[k] < 0.0:
                continue
            x, y = samples[i, 0] + offsets[k] * cos, samples[i, 1] + offsets[k] * sin
            away = math.hypot(x - samples[0, 0], y - samples[0, 1]) - overhang
            allowed = max(0.0, start_lack - START_GROWTH * max(0.0, away))
            if distance_at(field, x, y) + allowed < enough:
                return False
    return True


class Smoother:
    """Turns plans into paths that the tracker can follow, each at its plan's safe distance."""

    def __init__(self, config: SmootherConfig, vehicle: VehicleConfig) -> None:
        self._config = config
        self._offsets = np.array(vehicle.footprint_offsets_m)

    def smooth(self, plan: Plan, view: WorldView, pose: FloatArray) -> SmoothPath:
        """Smooth a plan from where the robot stands.

        The path starts along the robot's heading if the turn to the plan is small and the
        clearance allows it. Otherwise it starts along the plan, and the robot first turns on the
        spot.

        Args:
            plan: The polyline to follow, with the safe distance that it keeps.
            view: The view that the plan was made in.
            pose: (3,) x, y, yaw of base_link in map, m, m, rad.

        Returns:
            The sampled path with the clearance at each sample.
        """
        field, safe = field_of(view, outside="edge"), plan.safe_distance_m
        points, straight = self._with_room(plan.waypoints_m, field, safe)
        turn = wrap_angle(straight[0, 2] - pose[2])
        if abs(turn) < _STRAIGHT_RAD or abs(turn) > self._config.lead_in_max_turn_rad:
            return self._message(plan, straight, field, pose)
        enough = min(safe, float(path_clearance(straight, field, self._offsets).min()))
        for fraction in _LEAD_FRACTIONS:
            led = self._path(self._with_lead_in(points, pose, fraction), field, safe)
            if path_clearance(led, field, self._offsets).min() >= enough:
                return self._message(plan, led, field, pose)
        return self._message(plan, straight, field, pose)

    def _with_room(
        self, waypoints: FloatArray, field: Field, safe: float
    ) -> tuple[FloatArray, FloatArray]:
        """Move the plan's points to where there is room; return them and the path along them.

        The points keep their places if the moved path falls below the safe distance and has less
        clearance than the path along the original points.
        """
        points = np.ascontiguousarray(waypoints)
        if self._config.extra_room_m > 0.0:
            preferred = safe + self._config.extra_room_m
            moved = make_room(points, field, self._offsets, safe, preferred)
            path = self._path(moved, field, safe)
            least = path_clearance(path, field, self._offsets).min()
            if least >= safe:
                return moved, path
            plain = self._path(points, field, safe)
            if least >= path_clearance(plain, field, self._offsets).min():
                return moved, path
            return points, plain
        return points, self._path(points, field, safe)

    def _with_lead_in(self, points: FloatArray, pose: FloatArray, fraction: float) -> FloatArray:
        """Return the polyline with a first leg along the robot's heading."""
        first = math.dist(points[0], points[1])
        lead = fraction * min(self._config.lead_in_m, 0.5 * first)
        ahead = points[0] + lead * np.array([math.cos(pose[2]), math.sin(pose[2])])
        return np.vstack((points[:1], ahead, points[1:]))

    def _path(self, points: FloatArray, field: Field, safe: float) -> FloatArray:
        """Cut the corners of the polyline and sample it: (k, 4) x, y, yaw, curvature."""
        config = self._config
        points = np.ascontiguousarray(points)
        cuts = fit_corners(
            points,
            field,
            self._offsets,
            safe,
            safe + config.extra_room_m,
            config.max_cut_m,
            config.min_cut_m,
        )
        return sample_path(points, cuts, config.spacing_m)

    def _message(
        self, plan: Plan, samples: FloatArray, field: Field, pose: FloatArray
    ) -> SmoothPath:
        """Make the message about a sampled path (k, 4) of a robot at a pose (3,)."""
        steps = np.hypot(np.diff(samples[:, 0]), np.diff(samples[:, 1]))
        arc = np.concatenate(([0.0], np.cumsum(steps)))
        # The planner judges a start by the robot's middle and front at its present heading.
        not_behind = self._offsets[self._offsets >= 0.0]
        here = footprint_clearance(field, samples[0, 0], samples[0, 1], pose[2], not_behind)
        lack = max(0.0, plan.safe_distance_m - here)
        enough = plan.safe_distance_m - SAFE_WITHIN_M
        return SmoothPath(
            t_ns=plan.t_ns,
            xy_m=samples[:, :2].copy(),
            yaw_rad=np.unwrap(samples[:, 2]),
            curvature_1pm=samples[:, 3].copy(),
            arc_m=arc,
            clearance_m=path_clearance(samples, field, self._offsets),
            safe=keeps_distance(samples, arc, field, self._offsets, enough, lack),
        )
