"""Teaching-learning-based optimisation of a class of polylines, compiled.

Source: Sabiha 2022 (online TLBO), Eqs. 19-26; Rao 2011. Where this departs from print:
- Positions are measured from the teacher, so that Eq. 21 no longer depends on where the map's
  origin happens to be (with T_f = 2 it does as printed).
- One random factor a learner, not a coordinate: a step then keeps a path's shape.
- A coordinate that leaves the box goes half-way to its edge (Eq. 26 puts it on the edge, where
  clipped waypoints pile up).
- A learner that has become the teacher's twin is sent off to look elsewhere.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.objective import Problem, evaluate
from simloop.planners.splitmix import State, below, normal, uniform


@njit(cache=True, forceinline=True)
def _into_box(new: float, old: float, low: float, high: float) -> float:
    """Eq. 26, but half-way from where the coordinate was to the edge that it crossed."""
    if new < low:
        return 0.5 * (old + low) if old > low else low
    if new > high:
        return 0.5 * (old + high) if old < high else high
    return new


@njit(cache=True, forceinline=True)
def _offer(
    p: Problem,
    path: FloatArray,
    cost: FloatArray,
    k: int,
    m: int,
    candidate: FloatArray,
    stack: FloatArray,
) -> None:
    """Greedy acceptance, Eq. 24: the candidate replaces learner k where it is better."""
    for i in range(1, m - 1):
        candidate[i, 0] = _into_box(candidate[i, 0], path[k, i, 0], p.low_x, p.high_x)
        candidate[i, 1] = _into_box(candidate[i, 1], path[k, i, 1], p.low_y, p.high_y)
    offered = evaluate(p, candidate, m, cost[k], stack)
    if offered < cost[k]:
        cost[k] = offered
        for i in range(1, m - 1):
            path[k, i, 0] = candidate[i, 0]
            path[k, i, 1] = candidate[i, 1]


@njit(cache=True)
def class_mean(path: FloatArray, learners: int, m: int, mean: FloatArray) -> None:
    """Eq. 20: the mean of each subject, that is of each waypoint's coordinates."""
    for i in range(1, m - 1):
        x = 0.0
        y = 0.0
        for k in range(learners):
            x += path[k, i, 0]
            y += path[k, i, 1]
        mean[i, 0] = x / learners
        mean[i, 1] = y / learners


@njit(cache=True)
def teacher_phase(
    p: Problem,
    path: FloatArray,
    cost: FloatArray,
    learners: int,
    m: int,
    state: State,
    mean: FloatArray,
    candidate: FloatArray,
    stack: FloatArray,
) -> None:
    """Eqs. 20-24: all learners move by r (X_teacher - T_f mean), measured from the teacher."""
    teacher = path[np.argmin(cost[:learners])].copy()
    class_mean(path, learners, m, mean)
    for k in range(learners):
        factor = 1.0 + below(state, 2)  # T_f, Eq. 22
        step = uniform(state) * factor
        for i in range(1, m - 1):
            candidate[i, 0] = path[k, i, 0] + step * (teacher[i, 0] - mean[i, 0])
            candidate[i, 1] = path[k, i, 1] + step * (teacher[i, 1] - mean[i, 1])
        _offer(p, path, cost, k, m, candidate, stack)


@njit(cache=True)
def learner_phase(
    p: Problem,
    path: FloatArray,
    cost: FloatArray,
    learners: int,
    m: int,
    state: State,
    candidate: FloatArray,
    stack: FloatArray,
) -> None:
    """Eqs. 25, 24: each learner moves towards a better fellow, or away from a worse one."""
    for k in range(learners):
        q = (k + 1 + below(state, learners - 1)) % learners
        if cost[k] == cost[q]:
            continue
        step = uniform(state) if cost[k] < cost[q] else -uniform(state)
        for i in range(1, m - 1):
            candidate[i, 0] = path[k, i, 0] + step * (path[k, i, 0] - path[q, i, 0])
            candidate[i, 1] = path[k, i, 1] + step * (path[k, i, 1] - path[q, i, 1])
        _offer(p, path, cost, k, m, candidate, stack)


@njit(cache=True)
def move_twins(
    p: Problem,
    path: FloatArray,
    cost: FloatArray,
    learners: int,
    m: int,
    alike: float,
    reach: float,
    state: State,
    stack: FloatArray,
) -> int:
    """A learner whose cost is the teacher's to ``alike`` gets one waypoint moved by ``reach``."""
    teacher = np.argmin(cost[:learners])
    moved = 0
    for k in range(learners):
        if k == teacher or cost[k] - cost[teacher] > alike * cost[teacher]:
            continue
        i = 1 + below(state, m - 2)
        x = path[k, i, 0] + reach * normal(state)
        y = path[k, i, 1] + reach * normal(state)
        path[k, i, 0] = _into_box(x, path[k, i, 0], p.low_x, p.high_x)
        path[k, i, 1] = _into_box(y, path[k, i, 1], p.low_y, p.high_y)
        cost[k] = evaluate(p, path[k], m, np.inf, stack)
        moved += 1
    return moved


@njit(cache=True)
def tlbo(
    p: Problem,
    path: FloatArray,
    cost: FloatArray,
    learners: int,
    m: int,
    idle_limit: int,
    tolerance: float,
    reach: float,
    budget: int,
    state: State,
    mean: FloatArray,
    candidate: FloatArray,
    stack: FloatArray,
) -> tuple[int, int, int]:
    """Teach the class path (learners, >= m, 2) until ``idle_limit`` generations bring no more.

    A generation is idle if the best cost falls by less than ``tolerance`` of itself; the budget
    counts evaluations. cost (learners,) is filled here. Returns best learner, generations and
    evaluations.
    """
    for k in range(learners):
        cost[k] = evaluate(p, path[k], m, np.inf, stack)
    for i in (0, m - 1):
        candidate[i, 0] = path[0, i, 0]
        candidate[i, 1] = path[0, i, 1]
    evaluations = learners
    generations = 0
    idle = 0
    best = cost[:learners].min()
    while m > 2 and idle < idle_limit and evaluations + 2 * learners <= budget:
        teacher_phase(p, path, cost, learners, m, state, mean, candidate, stack)
        learner_phase(p, path, cost, learners, m, state, candidate, stack)
        evaluations += 2 * learners
        evaluations += move_twins(p, path, cost, learners, m, 0.01 * tolerance, reach, state, stack)
        generations += 1
        now = cost[:learners].min()
        if now < best * (1.0 - tolerance):
            best = now
            idle = 0
        else:
            idle += 1
    return int(np.argmin(cost[:learners])), generations, evaluations


@njit(cache=True)
def draw_class(
    p: Problem,
    base: FloatArray,
    first: int,
    last: int,
    m: int,
    spread: float,
    state: State,
    path: FloatArray,
) -> None:
    """Fill path[first:last]: base (>= m, 2) itself, then base with smooth sideways bends (Eq. 19
    redrawn: a uniform draw of single waypoints zigzags). spread: size of a bend, m."""
    chord_x = base[m - 1, 0] - base[0, 0]
    chord_y = base[m - 1, 1] - base[0, 1]
    chord = max(math.hypot(chord_x, chord_y), 1e-9)
    for k in range(first, last):
        one = 0.0 if k == first else spread * normal(state)
        two = 0.0 if k == first else spread * normal(state) * 0.7
        three = 0.0 if k == first else spread * normal(state) * 0.5
        for i in range(m):
            s = math.pi * i / (m - 1)
            bend = one * math.sin(s) + two * math.sin(2.0 * s) + three * math.sin(3.0 * s)
            x = base[i, 0] - bend * chord_y / chord
            y = base[i, 1] + bend * chord_x / chord
            inside = 0 < i < m - 1
            path[k, i, 0] = min(max(x, p.low_x), p.high_x) if inside else base[i, 0]
            path[k, i, 1] = min(max(y, p.low_y), p.high_y) if inside else base[i, 1]


@njit(cache=True)
def draw_near(
    base: FloatArray, m: int, learners: int, reach: float, state: State, path: FloatArray
) -> None:
    """Fill path[:learners]: base itself, then base with each waypoint moved a little.

    A waypoint moves outwards from its bend, where there is room, and along its neighbours' chord.
    """
    for k in range(learners):
        size = 0.0 if k == 0 else reach * uniform(state)
        for i in range(m):
            path[k, i, 0] = base[i, 0]
            path[k, i, 1] = base[i, 1]
            if i == 0 or i == m - 1:
                continue
            cx = base[i + 1, 0] - base[i - 1, 0]
            cy = base[i + 1, 1] - base[i - 1, 1]
            length = max(math.hypot(cx, cy), 1e-9)
            side = cx * (base[i, 1] - base[i - 1, 1]) - cy * (base[i, 0] - base[i - 1, 0])
            out = size * (abs(normal(state)) if side >= 0.0 else -abs(normal(state))) / length
            along = size * normal(state) / length
            path[k, i, 0] += along * cx - out * cy
            path[k, i, 1] += along * cy + out * cx
