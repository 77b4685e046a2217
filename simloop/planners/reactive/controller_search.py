"""Compiled tuning of the fuzzy controller: WDO on the controllers of `fuzzy`.

The plain tuning is `simloop.planners.reactive.fuzzy.FuzzySteering`, the oracle of this one. A
controller is simulated over several places, with fifteen rays and the test of its heading at each.
Most sensed points cannot change anything at a place, for one of these reasons:

- They are so far away that a sector counts as far in any case (`far_membership` is 1).
- They are farther than the safe distance from every ray of a sector.
- They are too far away to block a step.

Such points are left out before the rays are cast, and a sector is done as soon as it counts as near
(`far_membership` is 0). Every membership, and so every heading and cost, is that of all points.
"""

from __future__ import annotations

import math
from dataclasses import astuple

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.metaheuristics.population import draw_uniform
from simloop.planners.metaheuristics.rule_wdo import WdoOptions, blow
from simloop.planners.reactive.fuzzy import (
    HALF_SECTOR_RAD,
    HIGH,
    LOW,
    SECTOR_RAYS,
    SECTORS_RAD,
    SIMULATED_STEPS,
    FuzzySteering,
    fuzzy_turn,
    sector_range,
    walk_cost,
)
from simloop.planners.reactive.sensing import (
    BEAMS,
    LocalView,
    collision_threat,
    distance_to_edge,
    nearest_mover_distance,
    within,
)
from simloop.planners.reactive.steering import AGENTS, ITERATIONS
from simloop.planners.reactive.stepper import BLOCKED_COST
from simloop.planners.splitmix import State, below

_EDGE_X, _EDGE_Y = math.cos(HALF_SECTOR_RAD), math.sin(HALF_SECTOR_RAD)
_ANGLE_SPARE = 1e-6
# The sectors' rays lead at most this share of their length behind the place.
_BEHIND = 1e-6 - min(math.cos(SECTORS_RAD[0] + HALF_SECTOR_RAD), 0.0)
_SPARE = 1.0 + 1e-9  # of every bound that leaves points out, for rounding errors


@njit(cache=True, forceinline=True)
def _collect(
    view: LocalView,
    x: float,
    y: float,
    heading: float,
    radius: float,
    scratch: FloatArray,
) -> tuple[int, int, float]:
    """Collect the points about a place that matter there, as dx, dy and the squared distance.

    scratch[0]: those within a radius and not behind all sectors; scratch[1]: those that can
    block a step.
    Returns their numbers, and the distance of the nearest of all (`nearest_point_distance`).
    """
    hx, hy = math.cos(heading), math.sin(heading)
    near, close = scratch[0], scratch[1]
    square, behind = radius * radius * _SPARE, -view.safe_m - _BEHIND * radius
    reach = ((view.step_m + view.safe_m) * _SPARE) ** 2
    count, tight, least = 0, 0, view.reach_m
    bound = least * least * _SPARE
    for k in range(view.points.shape[0]):
        dx, dy = view.points[k, 0] - x, view.points[k, 1] - y
        apart = dx * dx + dy * dy
        if apart > square and apart > bound and apart > reach:
            continue
        if apart <= bound:
            least = min(least, math.hypot(dx, dy))
            bound = least * least * _SPARE
        if apart <= reach:
            close[tight, 0], close[tight, 1], close[tight, 2] = dx, dy, apart
            tight += 1
        if apart <= square and dx * hx + dy * hy >= behind:
            near[count, 0], near[count, 1], near[count, 2] = dx, dy, apart
            count += 1
    return count, tight, least


@njit(cache=True, forceinline=True)
def _blocker(near: FloatArray, count: int, view: LocalView, ux: float, uy: float) -> int:
    """Return a collected point that blocks a step, -1 if none does."""
    square = view.safe_m * view.safe_m
    for k in range(count):
        along = near[k, 0] * ux + near[k, 1] * uy
        if along > 0.0:
            room = square - (near[k, 2] - along * along)
            if room > 0.0 and max(along - math.sqrt(room), 0.0) < view.step_m:
                return k
    return -1


@njit(cache=True, forceinline=True)
def _blocked_headings(point: FloatArray, view: LocalView, angle: float, side: float) -> int:
    """Return how many headings from a blocked one on a point blocks for certain, at least 1."""
    safe, step, apart = view.safe_m, view.step_m, math.sqrt(point[2])
    if apart <= safe:
        half = 0.5 * math.pi
    elif point[2] - safe * safe <= step * step:
        half = math.asin(safe / apart)
    else:
        half = math.acos(min((step * step + point[2] - safe * safe) / (2.0 * step * apart), 1.0))
    off = math.atan2(point[1], point[0]) - angle
    off = (off + math.pi) % (2.0 * math.pi) - math.pi
    return max(1, math.ceil((side * off + half - _ANGLE_SPARE) * BEAMS / (2.0 * math.pi)))


@njit(cache=True, forceinline=True)
def _sector(
    view: LocalView,
    x: float,
    y: float,
    middle: float,
    low: float,
    high: float,
    scratch: FloatArray,
    count: int,
) -> float:
    """Compute `fuzzy.sector_range`, in steps; any value below low or above high is as good."""
    cx, cy = math.cos(middle), math.sin(middle)
    near, chosen, rays = scratch[0], scratch[2], scratch[3]
    safe, far = view.safe_m, high * view.step_m * _SPARE
    least, enough = min(view.reach_m, far), low * view.step_m / _SPARE
    square, found, nearest = (far + safe) ** 2, 0, 0
    for k in range(count):
        if near[k, 2] > square:
            continue
        # The distance from the lines along the sector's edges is at most that from its rays.
        ahead = near[k, 0] * cx + near[k, 1] * cy
        aside = abs(near[k, 1] * cx - near[k, 0] * cy)
        if aside * _EDGE_X - ahead * _EDGE_Y <= safe * _SPARE:
            chosen[found, 0], chosen[found, 1] = near[k, 0], near[k, 1]
            chosen[found, 2] = near[k, 2]
            if near[k, 2] < chosen[nearest, 2]:
                nearest = found
            found += 1
    box = view.box
    inside = min(x - box[0], y - box[1], box[2] - x, box[3] - y) >= far
    if found == 0 and inside:
        return least / view.step_m
    for j in range(SECTOR_RAYS):
        angle = middle + HALF_SECTOR_RAD * (2.0 * j / (SECTOR_RAYS - 1) - 1.0)
        rays[j, 0], rays[j, 1] = math.cos(angle), math.sin(angle)
        if not inside:
            least = min(least, distance_to_edge(box, x, y, rays[j, 0], rays[j, 1]))
    # The nearest point comes first: a point farther away than the least range can tell no more.
    safe_square = safe * safe
    for i in range(-1, found):
        k = nearest if i < 0 and found > 0 else i
        if k < 0 or chosen[k, 2] > (least + safe) ** 2 * _SPARE:
            continue
        for j in range(SECTOR_RAYS):
            along = chosen[k, 0] * rays[j, 0] + chosen[k, 1] * rays[j, 1]
            if along > 0.0:
                room = safe_square - (chosen[k, 2] - along * along)
                if room > 0.0:
                    least = min(least, max(along - math.sqrt(room), 0.0))
        if least < enough:
            break
    return least / view.step_m


@njit(cache=True, forceinline=True)
def _ranges(
    view: LocalView,
    x: FloatArray,
    at_x: float,
    at_y: float,
    heading: float,
    scratch: FloatArray,
    count: int,
) -> tuple[float, float, float]:
    """Compute the ranges of the left, front and right sector that a controller needs, in steps."""
    side_far, front_far = max(x[3], x[2] + 0.1), max(x[1], x[0] + 0.1)
    middles = heading + SECTORS_RAD[0], heading + SECTORS_RAD[1], heading + SECTORS_RAD[2]
    left = _sector(view, at_x, at_y, middles[0], x[2], side_far, scratch, count)
    front = _sector(view, at_x, at_y, middles[1], x[0], front_far, scratch, count)
    right = _sector(view, at_x, at_y, middles[2], x[2], side_far, scratch, count)
    return left, front, right


@njit(cache=True, forceinline=True)
def _heading(
    view: LocalView,
    x: FloatArray,
    at_x: float,
    at_y: float,
    heading: float,
    ranges: tuple[float, float, float],
    close: FloatArray,
    found: int,
) -> float:
    """Compute `fuzzy.controller_heading` from the sectors' ranges and the close points."""
    bearing = math.atan2(view.target_y - at_y, view.target_x - at_x) - heading
    bearing = (bearing + math.pi) % (2.0 * math.pi) - math.pi
    asked = heading + fuzzy_turn(x, ranges[0], ranges[1], ranges[2], bearing)
    left_from, right_from = 0, 1  # the first heading to the right is the asked one again
    for k in range(BEAMS // 2):
        for side in (1.0, -1.0):
            if k < (left_from if side > 0.0 else right_from):
                continue
            angle = asked + side * 2.0 * math.pi * k / BEAMS
            ux, uy = math.cos(angle), math.sin(angle)
            if min(view.reach_m, distance_to_edge(view.box, at_x, at_y, ux, uy)) < view.step_m:
                continue
            blocker = _blocker(close, found, view, ux, uy)
            if blocker < 0:
                return angle
            # The same point blocks the next headings to this side, too.
            until = k + _blocked_headings(close[blocker], view, angle, side)
            if k == 0:
                right_from = _blocked_headings(close[blocker], view, angle, -1.0)
            if side > 0.0:
                left_from = until
            else:
                right_from = until
    return np.nan


@njit(cache=True)
def cost_of(
    view: LocalView,
    x: FloatArray,
    heading: float,
    here: tuple[float, float, float],
    scratch: FloatArray,
) -> float:
    """Compute the cost of a controller; the compiled `fuzzy.controller_cost`.

    Args:
        view: What the robot knows.
        x: (7,) parameters of the controller.
        heading: Present heading, rad, map frame.
        here: Ranges of the left, front and right sector at the robot's place, in steps, which are
            the same for all controllers.
        scratch: (4, n, 3) scratch for as many points as the view has, or more.

    Returns:
        Cost, without unit.
    """
    at_x, at_y, turned, nearest = view.x, view.y, 0.0, view.reach_m
    danger, ranges = 0.0, here
    radius = max(x[1], x[3], x[0] + 0.1, x[2] + 0.1, 1.0) * view.step_m + view.safe_m
    count, tight, _ = _collect(view, at_x, at_y, heading, 0.0, scratch)
    for n in range(SIMULATED_STEPS):
        if n > 0:
            ranges = _ranges(view, x, at_x, at_y, heading, scratch, count)
        angle = _heading(view, x, at_x, at_y, heading, ranges, scratch[1], tight)
        if not math.isfinite(angle):
            return 2.0 * BLOCKED_COST
        # Predictions of movers start now, so only the first step can be checked against them.
        if n == 0:
            vx, vy = view.step_m * math.cos(angle), view.step_m * math.sin(angle)
            danger = collision_threat(view, vx, vy)
        turned += abs((angle - heading + math.pi) % (2.0 * math.pi) - math.pi)
        heading = angle
        at_x += view.step_m * math.cos(angle)
        at_y += view.step_m * math.sin(angle)
        count, tight, apart = _collect(view, at_x, at_y, heading, radius, scratch)
        nearest = min(nearest, apart, nearest_mover_distance(view, at_x, at_y))
        if math.hypot(view.target_x - at_x, view.target_y - at_y) < view.step_m:
            break
    return walk_cost(view, at_x, at_y, nearest, turned, danger)


@njit(cache=True)
def relevant(view: LocalView) -> LocalView:
    """Leave out the points that no controller's cost depends on.

    A simulated place is at most `SIMULATED_STEPS` steps away. From there, a sector counts as far
    beyond the largest far range; and the nearest point is at most as far as the robot's own nearest
    point is from there.

    Args:
        view: What the robot knows.

    Returns:
        The view with fewer points, in which every controller costs the same.
    """
    least = np.inf
    for k in range(view.points.shape[0]):
        dx, dy = view.points[k, 0] - view.x, view.points[k, 1] - view.y
        least = min(least, dx * dx + dy * dy)
    simulated = SIMULATED_STEPS * view.step_m
    far = simulated + max(HIGH[1], HIGH[3]) * view.step_m + view.safe_m
    return within(view, max(far, math.sqrt(least) + 2.0 * simulated))


@njit(cache=True)
def _evaluate(
    view: LocalView,
    x: FloatArray,
    out: FloatArray,
    best: FloatArray,
    least: float,
    heading: float,
    here: tuple[float, float, float],
    scratch: FloatArray,
) -> float:
    """Evaluate controllers, kept inside their box; best: the best so far. Return its cost."""
    for k in range(x.shape[0]):
        for j in range(x.shape[1]):
            value = x[k, j] if np.isfinite(x[k, j]) else 0.5 * (LOW[j] + HIGH[j])
            x[k, j] = min(max(value, LOW[j]), HIGH[j])
    for k in range(x.shape[0]):
        out[k] = cost_of(view, x[k], heading, here, scratch)
    k = int(np.argmin(out))
    if out[k] < least:
        best[:] = x[k]
        return out[k]
    return least


@njit(cache=True)
def tune(
    view: LocalView,
    tuned: FloatArray,
    heading: float,
    figures: tuple[float, float, float, float, float],
    state: State,
) -> int:
    """Tune a controller by wind driven optimisation (`rule_wdo.WindDriven`).

    Args:
        view: What the robot knows.
        tuned: (7,) present parameters, which take part; receives the best ones.
        heading: Present heading, rad, map frame.
        figures: The fields of `WdoOptions`.
        state: (1,) random state, advanced.

    Returns:
        Number of controllers evaluated.
    """
    view = relevant(view)
    scratch = np.empty((4, max(view.points.shape[0], SECTOR_RAYS), 3))
    here = (
        sector_range(view, view.x, view.y, heading + SECTORS_RAD[0]),
        sector_range(view, view.x, view.y, heading + SECTORS_RAD[1]),
        sector_range(view, view.x, view.y, heading + SECTORS_RAD[2]),
    )
    x, cost, limit = np.empty((AGENTS, tuned.size)), np.empty(AGENTS), figures[4]
    candidate, speed, best = np.empty_like(x), np.empty_like(x), np.empty(tuned.size)
    draw_uniform(x, LOW, HIGH, state)
    x[0] = tuned
    least = _evaluate(view, x, cost, best, np.inf, heading, here, scratch)
    for k in range(AGENTS):
        for j in range(tuned.size):
            speed[k, j] = limit * (2.0 * below(state, 1 << 30) / (1 << 30) - 1.0)
    for _ in range(ITERATIONS):
        blow(x, cost, speed, best, candidate, LOW, HIGH, figures, state)
        least = _evaluate(view, candidate, cost, best, least, heading, here, scratch)
        x[:] = candidate
    tuned[:] = best
    return AGENTS * (1 + ITERATIONS)


class CompiledFuzzySteering(FuzzySteering):
    """A `Steering` that chooses the same headings as `fuzzy.FuzzySteering`, sooner."""

    def _tune(self, view: LocalView, heading: float, state: State) -> int:
        return tune(view, self._tuned, heading, astuple(WdoOptions()), state)
