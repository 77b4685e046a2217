"""Codings: convert between vectors and paths, and evaluate the objective over such vectors.

- box: x, y of each inner waypoint within the bounds (Sabiha 2022).
- crosslines: equidistant lines across the start-goal line, one coordinate per line, positive to the
  right (Wu 2016, Eq. 8).
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.problem.clearance import Problem
from simloop.planners.problem.examined import examined_cost, steepest
from simloop.planners.problem.objective import (
    evaluate,
    intrusion,
    length_of,
    make_stack,
    plain_cost,
    surely_above,
)
from simloop.planners.problem.windows import Windows, window_minima
from simloop.planners.problem.worst_path import cost_bound, cost_if_worse

CODINGS = ("box", "crosslines")
_MOST_ACROSS = 1.0


class Coding(NamedTuple):
    """A coding of paths between the start and the goal of a problem.

    Attributes:
        kind: Index in `CODINGS`.
        points: Number of inner waypoints of a path.
        low: (d,) least value of each coordinate.
        high: (d,) greatest value of each coordinate.
        along_x: x of the unit vector from start to goal.
        along_y: y of that vector.
        reach: Distance from start to goal, m.
    """

    kind: int
    points: int
    low: FloatArray
    high: FloatArray
    along_x: float
    along_y: float
    reach: float


def make_coding(p: Problem, name: str, points: int) -> Coding:
    """Make the coding of a problem's paths.

    Args:
        p: The problem.
        name: One of `CODINGS`.
        points: Number of inner waypoints of a path.

    Returns:
        The coding.
    """
    dx, dy = p.goal_x - p.start_x, p.goal_y - p.start_y
    reach = math.hypot(dx, dy)
    ux, uy = (dx / reach, dy / reach) if reach > 0.0 else (1.0, 0.0)
    kind = CODINGS.index(name)
    if kind == 0:
        low, high = np.tile([p.low_x, p.low_y], points), np.tile([p.high_x, p.high_y], points)
    else:
        low, high = np.empty(points), np.empty(points)
        for i in range(points):
            t = reach * (i + 1) / (points + 1)
            low[i], high[i] = _across(p, p.start_x + t * ux, p.start_y + t * uy, uy, -ux, reach)
    return Coding(kind, points, low, high, ux, uy, reach)


def _across(
    p: Problem, x: float, y: float, nx: float, ny: float, reach: float
) -> tuple[float, float]:
    """Compute the range of s in which the line (x, y) + s n stays within the bounds.

    The range is limited by the distance of start and goal, because the bounds may be far away.
    """
    low, high = -_MOST_ACROSS * reach, _MOST_ACROSS * reach
    for at, n, first, last in ((x, nx, p.low_x, p.high_x), (y, ny, p.low_y, p.high_y)):
        if abs(n) > 1e-12:
            a, b = sorted(((first - at) / n, (last - at) / n))
            low, high = max(low, a), min(high, b)
    return (low, high) if low <= high else (0.0, 0.0)


@njit(cache=True)
def decode(p: Problem, coding: Coding, x: FloatArray, path: FloatArray) -> int:
    """Write the waypoints of a vector.

    Args:
        p: The problem.
        coding: The coding.
        x: (d,) the vector.
        path: (points + 2, 2) receives the waypoints, m.

    Returns:
        Number of waypoints, both ends included.
    """
    m = coding.points + 2
    path[0, 0], path[0, 1] = p.start_x, p.start_y
    path[m - 1, 0], path[m - 1, 1] = p.goal_x, p.goal_y
    for i in range(coding.points):
        if coding.kind == 0:
            path[i + 1, 0], path[i + 1, 1] = x[2 * i], x[2 * i + 1]
        else:
            t = coding.reach * (i + 1) / (coding.points + 1)
            path[i + 1, 0] = p.start_x + t * coding.along_x + x[i] * coding.along_y
            path[i + 1, 1] = p.start_y + t * coding.along_y - x[i] * coding.along_x
    return m


def encode(p: Problem, coding: Coding, path: FloatArray) -> FloatArray:
    """Convert a path into a vector.

    Args:
        p: The problem.
        coding: The coding.
        path: (m, 2) waypoints, any number of them, m.

    Returns:
        (d,) the vector, within the box. With cross lines it holds the first crossing of the path
        with each line.
    """
    if coding.kind == 0:
        return np.clip(_with_points(path, coding.points).ravel(), coding.low, coding.high)
    along = (path[:, 0] - p.start_x) * coding.along_x + (path[:, 1] - p.start_y) * coding.along_y
    right = (path[:, 0] - p.start_x) * coding.along_y - (path[:, 1] - p.start_y) * coding.along_x
    x = np.zeros(coding.points)
    for i in range(coding.points):
        t = coding.reach * (i + 1) / (coding.points + 1)
        k = max(1, int(np.argmax(along >= t)))
        step = along[k] - along[k - 1]
        share = (t - along[k - 1]) / step if step > 0.0 else 0.0
        x[i] = right[k - 1] + share * (right[k] - right[k - 1])
    return np.clip(x, coding.low, coding.high)


def _with_points(path: FloatArray, count: int) -> FloatArray:
    """Return ``count`` inner waypoints (count, 2) of a path, with points added or dropped.

    The longest legs are halved, or the points of least detour are dropped.
    """
    points = [np.asarray(point, dtype=np.float64) for point in path]
    while len(points) - 2 < count:
        legs = [math.dist(a, b) for a, b in itertools.pairwise(points)]
        k = int(np.argmax(legs))
        points.insert(k + 1, 0.5 * (points[k] + points[k + 1]))
    while len(points) - 2 > count:
        detours = [
            math.dist(points[i - 1], points[i])
            + math.dist(points[i], points[i + 1])
            - math.dist(points[i - 1], points[i + 1])
            for i in range(1, len(points) - 1)
        ]
        points.pop(1 + int(np.argmin(detours)))
    return np.array(points[1:-1]).reshape(-1, 2)


@njit(cache=True)
def _whole_curve_costs(
    p: Problem,
    coding: Coding,
    x: FloatArray,
    out: FloatArray,
    bounds: FloatArray,
    path: FloatArray,
    stack: FloatArray,
) -> None:
    """Compute J of each row of x, with the clearance of the whole path."""
    for k in range(x.shape[0]):
        m = decode(p, coding, x[k], path)
        # In a box the length alone often decides; on cross lines it seldom does.
        if coding.kind == 0 and p.length_weight * length_of(path, m) > bounds[k]:
            p.trials[0] += 1
            out[k] = np.inf
            continue
        # The rounding of a sum that was broken off must not bring it below the bound.
        out[k] = evaluate(p, path, m, bounds[k] + 1e-9 + 1e-12 * bounds[k], stack)


@njit(cache=True)
def _examined_costs(
    p: Problem,
    coding: Coding,
    x: FloatArray,
    out: FloatArray,
    bounds: FloatArray,
    examined: int,
    slope: tuple[float, float],
    path: FloatArray,
) -> None:
    """Compute J of each row of x as in the papers: clearance at some points, no start turn."""
    for k in range(x.shape[0]):
        m = decode(p, coding, x[k], path)
        out[k] = examined_cost(p, path, m, bounds[k], examined, slope)


@njit(cache=True)
def _insert(least: FloatArray, value: float) -> None:
    """Insert a value into ascending values and drop the last."""
    k = least.size - 1
    while k > 0 and least[k - 1] > value:
        least[k] = least[k - 1]
        k -= 1
    least[k] = value


@njit(cache=True)
def _best_costs(
    p: Problem,
    coding: Coding,
    x: FloatArray,
    out: FloatArray,
    bounds: FloatArray,
    keep: int,
    path: FloatArray,
    stack: FloatArray,
) -> None:
    """Compute J of each row of x, exact if it is one of the ``keep`` least or within its bound.

    Rows are taken in the order of their cost without obstacles. What the ``keep`` best so far cost
    is a bound for the rest: the final ``keep`` best cost no more.
    """
    n = x.shape[0]
    for k in range(n):
        m = decode(p, coding, x[k], path)
        out[k] = plain_cost(p, path, m)
    least = np.full(max(1, min(keep, n)), np.inf)
    for k in np.argsort(out[:n]):
        p.trials[0] += 1
        bound = max(bounds[k], least[-1])
        if out[k] > bound:
            out[k] = np.inf
            continue
        m = decode(p, coding, x[k], path)
        enough = surely_above(bound - out[k], p.penalty)
        out[k] += p.penalty * intrusion(p, path, m, enough, stack)
        if out[k] < least[-1]:
            _insert(least, out[k])


@njit(cache=True)
def _worst(
    p: Problem, coding: Coding, x: FloatArray, lows: Windows, path: FloatArray, stack: FloatArray
) -> int:
    """Find the first row of x with the greatest J, in a field without negative values.

    A row is left out if its upper bound is less than the cost of another one. The longest
    row comes first, because it is often among the worst.
    """
    n = x.shape[0]
    most = np.empty(n)
    for k in range(n):
        most[k] = length_of(path, decode(p, coding, x[k], path))
    first = worst = int(np.argmax(most))
    cost = evaluate(p, path, decode(p, coding, x[worst], path), np.inf, stack)
    for k in range(n):
        most[k] = -cost_bound(p, lows, path, decode(p, coding, x[k], path), cost)
    for k in np.argsort(most):
        if -most[k] < cost:
            break
        if k == first:
            continue
        m = decode(p, coding, x[k], path)
        found = cost_if_worse(p, lows, path, m, -most[k], cost, stack)
        if found > cost or (found == cost and k < worst):
            worst, cost = k, found
    return worst


class PathObjective:
    """A `SelectiveObjective` over coded paths.

    Attributes:
        problem: The problem.
        coding: The coding of the paths.
        low: (d,) least value of each coordinate.
        high: (d,) greatest value of each coordinate.
    """

    def __init__(self, problem: Problem, coding: Coding, examined: int | None = None) -> None:
        self.problem, self.coding = problem, coding
        self.low, self.high = coding.low, coding.high
        self._windows: Windows | None = None
        self._examined, self._slope = examined, steepest(problem)
        self._path, self._stack = np.zeros((coding.points + 2, 2)), make_stack()

    def costs(self, x: FloatArray, out: FloatArray, bounds: FloatArray) -> None:
        """Compute J of each vector; see `Objective.costs`.

        Args:
            x: (n, d) vectors.
            out: (n,) receives J.
            bounds: (n,) values of J above which the exact value does not matter.
        """
        p, coding, path = self.problem, self.coding, self._path
        if self._examined is None:
            _whole_curve_costs(p, coding, x, out, bounds, path, self._stack)
        else:
            _examined_costs(p, coding, x, out, bounds, self._examined, self._slope, path)

    def best_costs(self, x: FloatArray, out: FloatArray, bounds: FloatArray, keep: int) -> None:
        """Compute J of each vector; see `SelectiveObjective.best_costs`.

        Args:
            x: (n, d) vectors.
            out: (n,) receives J.
            bounds: (n,) values of J up to which it must be exact.
            keep: Number of least values that must be exact.
        """
        if self._examined is not None:
            self.costs(x, out, np.full(len(x), np.inf))
        else:
            _best_costs(self.problem, self.coding, x, out, bounds, keep, self._path, self._stack)

    def worst(self, x: FloatArray) -> int:
        """Find the vector with the greatest J; see `SelectiveObjective.worst`.

        Args:
            x: (n, d) vectors.

        Returns:
            Index of the vector.
        """
        field = self.problem.field
        if self._windows is None and field.size and field.min() >= 0.0:
            self._windows = window_minima(field)
        if self._examined is not None or self._windows is None:
            costs = np.empty(len(x))
            self.costs(x, costs, np.full(len(x), np.inf))
            return int(np.argmax(costs))
        return int(_worst(self.problem, self.coding, x, self._windows, self._path, self._stack))

    def path(self, x: FloatArray) -> FloatArray:
        """Decode a vector into waypoints.

        Args:
            x: (d,) the vector.

        Returns:
            (points + 2, 2) waypoints, m.
        """
        out = np.zeros((self.coding.points + 2, 2))
        decode(self.problem, self.coding, x, out)
        return out
