"""Teaching-learning-based optimisation of a class of polylines, compiled.

Source: Sabiha 2022 (online TLBO), Eqs. 19-26; Rao 2011. It departs from print in four places:
- The subjects are the lines of a path's segments, not its waypoints: see `lines`.
- Positions are measured from the path that was coded, so that Eq. 21 does not depend on where the
  map's origin is (with T_f = 2 it does as printed).
- There is one random factor a learner, not one a subject: a step then keeps the shape of a path.
- A learner that has become the teacher's twin is moved elsewhere.

In this module ``m`` is how many waypoints the coded path has, and ``free`` how many of its lines
may move.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.problem.bends import MAX_POINTS
from simloop.planners.problem.clearance import Problem
from simloop.planners.problem.objective import intrusion, start_turn
from simloop.planners.splitmix import State, below, normal, uniform
from simloop.planners.tlbo.lines import Lines, decode


class Class(NamedTuple):
    """The learners, and scratch.

    Attributes:
        subject: (learners, MAX_POINTS, 2) heading, rad, and offset, m, of each free line: see
            `lines`.
        cost: (learners,) J of each learner.
        mean: (MAX_POINTS, 2) mean of the class.
        candidate: (MAX_POINTS, 2) the subject that is offered.
        path: (MAX_POINTS, 2) the waypoints of the learner that is evaluated, m.
        stack: Scratch for the clearance of segments.
    """

    subject: FloatArray
    cost: FloatArray
    mean: FloatArray
    candidate: FloatArray
    path: FloatArray
    stack: FloatArray


def make_class(learners: int, stack: FloatArray) -> Class:
    """Make room for a class.

    Args:
        learners: How many learners.
        stack: Scratch from `objective.make_stack`.

    Returns:
        The class, all zero.
    """
    shape = (MAX_POINTS, 2)
    return Class(
        subject=np.zeros((learners, *shape)),
        cost=np.zeros(learners),
        mean=np.zeros(shape),
        candidate=np.zeros(shape),
        path=np.zeros(shape),
        stack=stack,
    )


@njit(cache=True)
def _cost(
    p: Problem, lines: Lines, subject: FloatArray, free: int, m: int, bound: float, c: Class
) -> float:
    """J of a learner, or some value above ``bound``; inf where its lines make no path."""
    p.trials[0] += 1
    turning = decode(p, lines, subject, free, m, c.path)
    if turning < 0.0:
        return np.inf
    cost = p.turning_weight * turning
    for i in range(m - 1):
        dx, dy = c.path[i + 1, 0] - c.path[i, 0], c.path[i + 1, 1] - c.path[i, 1]
        cost += p.length_weight * math.sqrt(dx * dx + dy * dy)
    if p.start_turn_weight > 0.0:
        cost += p.start_turn_weight * start_turn(p, c.path, m)
    if cost > bound:
        return cost
    return cost + p.penalty * intrusion(p, c.path, m, (bound - cost) / p.penalty, c.stack)


@njit(cache=True)
def _offer(p: Problem, lines: Lines, c: Class, k: int, free: int, m: int) -> None:
    """Greedy acceptance, Eq. 24: the candidate replaces learner k where it is better."""
    offered = _cost(p, lines, c.candidate, free, m, c.cost[k], c)
    if offered < c.cost[k]:
        c.cost[k] = offered
        for i in range(free):
            c.subject[k, i, 0] = c.candidate[i, 0]
            c.subject[k, i, 1] = c.candidate[i, 1]


@njit(cache=True)
def class_mean(subject: FloatArray, free: int, mean: FloatArray) -> None:
    """Compute the mean of each subject, Eq. 20.

    Args:
        subject: (learners, MAX_POINTS, 2) the learners' subjects.
        free: How many lines may move.
        mean: (MAX_POINTS, 2) takes the mean.
    """
    learners = subject.shape[0]
    for i in range(free):
        heading, offset = 0.0, 0.0
        for k in range(learners):
            heading += subject[k, i, 0]
            offset += subject[k, i, 1]
        mean[i, 0] = heading / learners
        mean[i, 1] = offset / learners


@njit(cache=True)
def teacher_phase(p: Problem, lines: Lines, c: Class, free: int, m: int, state: State) -> None:
    """Move every learner by r (X_teacher - T_f mean), Eqs. 20-24, and keep what is better.

    Args:
        p: The problem.
        lines: The coded path.
        c: The class; changed.
        free: How many lines may move.
        m: How many waypoints the path has.
        state: (1,) of the random generator.
    """
    teacher = c.subject[np.argmin(c.cost)].copy()
    class_mean(c.subject, free, c.mean)
    for k in range(c.cost.size):
        factor = 1.0 + below(state, 2)  # T_f, Eq. 22
        step = uniform(state)
        for i in range(free):
            for j in range(2):
                toward = teacher[i, j] - factor * c.mean[i, j]
                c.candidate[i, j] = c.subject[k, i, j] + step * toward
        _offer(p, lines, c, k, free, m)


@njit(cache=True)
def learner_phase(p: Problem, lines: Lines, c: Class, free: int, m: int, state: State) -> None:
    """Move each learner away from a worse fellow or towards a better one, Eqs. 25 and 24.

    Args:
        p: The problem.
        lines: The coded path.
        c: The class; changed.
        free: How many lines may move.
        m: How many waypoints the path has.
        state: (1,) of the random generator.
    """
    learners = c.cost.size
    for k in range(learners):
        q = (k + 1 + below(state, learners - 1)) % learners
        step = uniform(state) if c.cost[k] < c.cost[q] else -uniform(state)
        for i in range(free):
            for j in range(2):
                apart = c.subject[k, i, j] - c.subject[q, i, j]
                c.candidate[i, j] = c.subject[k, i, j] + step * apart
        _offer(p, lines, c, k, free, m)


@njit(cache=True)
def move_twins(
    p: Problem, lines: Lines, c: Class, free: int, m: int, alike: float, state: State
) -> None:
    """Move one line of each learner that is as costly as the teacher.

    Args:
        p: The problem.
        lines: The coded path.
        c: The class; changed.
        free: How many lines may move.
        m: How many waypoints the path has.
        alike: Difference of cost up to which two are as costly, as a share of the teacher's.
        state: (1,) of the random generator.
    """
    teacher = np.argmin(c.cost)
    for k in range(c.cost.size):
        if k == teacher or c.cost[k] - c.cost[teacher] > alike * c.cost[teacher]:
            continue
        i = below(state, free)
        for j in range(2):
            c.subject[k, i, j] += lines.spread[i, j] * normal(state)
        c.cost[k] = _cost(p, lines, c.subject[k], free, m, np.inf, c)


@njit(cache=True)
def draw_class(p: Problem, lines: Lines, c: Class, free: int, m: int, state: State) -> None:
    """Draw the class: the coded path itself, then its lines moved at random (in place of Eq. 19).

    Args:
        p: The problem.
        lines: The coded path.
        c: The class; overwritten.
        free: How many lines may move.
        m: How many waypoints the path has.
        state: (1,) of the random generator.
    """
    for k in range(c.cost.size):
        for i in range(free):
            for j in range(2):
                size = lines.spread[i, j] if k > 0 else 0.0
                c.subject[k, i, j] = size * normal(state)
        c.cost[k] = _cost(p, lines, c.subject[k], free, m, np.inf, c)


@njit(cache=True)
def tlbo(
    p: Problem,
    lines: Lines,
    c: Class,
    free: int,
    m: int,
    idle_limit: int,
    tolerance: float,
    budget: int,
    state: State,
) -> tuple[int, int]:
    """Teach a class about a coded path until generations bring no more.

    A generation is idle if the best cost falls by less than ``tolerance`` of itself.

    Args:
        p: The problem; its trials are counted.
        lines: The coded path.
        c: The class; overwritten.
        free: How many lines may move.
        m: How many waypoints the path has.
        idle_limit: Idle generations in a row that end it.
        tolerance: See above.
        budget: Trials that are not exceeded.
        state: (1,) of the random generator.

    Returns:
        Number of the best learner, and how many generations there were.
    """
    draw_class(p, lines, c, free, m, state)
    generations = 0
    idle = 0
    best = c.cost.min()
    while free > 0 and idle < idle_limit and p.trials[0] + 3 * c.cost.size <= budget:
        teacher_phase(p, lines, c, free, m, state)
        learner_phase(p, lines, c, free, m, state)
        move_twins(p, lines, c, free, m, 0.01 * tolerance, state)
        generations += 1
        now = c.cost.min()
        if now < best * (1.0 - tolerance):
            best = now
            idle = 0
        else:
            idle += 1
    return int(np.argmin(c.cost)), generations
