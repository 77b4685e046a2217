"""Teaching-learning-based optimisation of a class of polylines, compiled.

Source: Sabiha 2022 (online TLBO), Eqs. 19-26; Rao 2011. It differs from the paper in four places:
- The subjects are the lines of a path's segments, not its waypoints: see `lines`.
- Positions are relative to the coded path, so Eq. 21 does not depend on the map's origin (with
  T_f = 2 it does in the paper).
- There is one random factor per learner, not per subject, so a step keeps the shape of a path.
- A learner that equals the teacher is moved elsewhere.

In this module ``m`` is the number of waypoints of the coded path, and ``free`` the number of its
lines that may move.
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
    """The learners, and scratch arrays.

    Attributes:
        subject: (learners, MAX_POINTS, 2) heading, rad, and offset, m, of each free line: see
            `lines`.
        cost: (learners,) J of each learner.
        mean: (MAX_POINTS, 2) mean of the class.
        candidate: (MAX_POINTS, 2) the new subject to be evaluated.
        path: (MAX_POINTS, 2) the waypoints of the evaluated learner, m.
        stack: Scratch for the clearance of segments.
    """

    subject: FloatArray
    cost: FloatArray
    mean: FloatArray
    candidate: FloatArray
    path: FloatArray
    stack: FloatArray


def make_class(learners: int, stack: FloatArray) -> Class:
    """Allocate a class.

    Args:
        learners: Number of learners.
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
    """Compute J of a learner, or a value above ``bound``; inf if its lines make no path."""
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
    """Accept greedily, Eq. 24: the candidate replaces learner k if it is better."""
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
        free: Number of lines that may move.
        mean: (MAX_POINTS, 2) receives the mean.
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
    """Move every learner by r (X_teacher - T_f mean), Eqs. 20-24, and keep improvements.

    Args:
        p: The problem.
        lines: The coded path.
        c: The class; changed.
        free: Number of lines that may move.
        m: Number of waypoints of the path.
        state: (1,) state of the random generator.
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
    """Move each learner away from a worse learner or towards a better one, Eqs. 25 and 24.

    Args:
        p: The problem.
        lines: The coded path.
        c: The class; changed.
        free: Number of lines that may move.
        m: Number of waypoints of the path.
        state: (1,) state of the random generator.
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
    """Move one line of each learner that costs the same as the teacher.

    Args:
        p: The problem.
        lines: The coded path.
        c: The class; changed.
        free: Number of lines that may move.
        m: Number of waypoints of the path.
        alike: Difference up to which two costs count as equal, as a share of the teacher's cost.
        state: (1,) state of the random generator.
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
    """Draw the class: the coded path, then copies with randomly moved lines (replaces Eq. 19).

    Args:
        p: The problem.
        lines: The coded path.
        c: The class; overwritten.
        free: Number of lines that may move.
        m: Number of waypoints of the path.
        state: (1,) state of the random generator.
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
    """Optimise a class about a coded path until further generations bring no gain.

    A generation is idle if it lowers the best cost by less than ``tolerance`` of that cost.

    Args:
        p: The problem; its trials are counted.
        lines: The coded path.
        c: The class; overwritten.
        free: Number of lines that may move.
        m: Number of waypoints of the path.
        idle_limit: Number of consecutive idle generations after which it stops.
        tolerance: Relative gain below which a generation is idle.
        budget: Upper limit of the trials.
        state: (1,) state of the random generator.

    Returns:
        Number of the best learner, and number of generations.
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
