"""The two phases of teaching and learning against their equations, written out in plain Python."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest

from simloop.benchmarks.planners.scenes import disc_world
from simloop.planners.problem.clearance import Problem, make_problem
from simloop.planners.problem.objective import evaluate, make_stack
from simloop.planners.splitmix import below, make_state, normal, uniform
from simloop.planners.tlbo.lines import Lines, decode, encode, make_lines
from simloop.planners.tlbo.tlbo import (
    Class,
    draw_class,
    learner_phase,
    make_class,
    move_twins,
    teacher_phase,
    tlbo,
)

LEARNERS = 24
DISCS = np.array([[2.0, 0.3, 0.4], [4.1, 0.85, 0.3]])
BENT = np.array([[0.0, 0.0], [1.3, 0.9], [2.7, 0.9], [4.0, 0.2], [6.0, 1.0]])


class Bench(NamedTuple):
    """A coded path with a class about it."""

    problem: Problem
    lines: Lines
    group: Class
    free: int
    m: int
    path: np.ndarray


def bench(seed: int = 0, start_turn_weight: float = 0.2, learners: int = LEARNERS) -> Bench:
    """The class as drawn. The path intrudes a little, so that all its lines may move."""
    path = BENT.copy()
    world = disc_world(DISCS, (-1.0, -2.0, 7.0, 3.0))
    start = np.array([*path[0], 0.3])
    problem = make_problem(world, start, path[-1], safe_m=0.26, start_turn_weight=start_turn_weight)
    stack, lines = make_stack(), make_lines()
    free = encode(problem, path, len(path), lines, stack)
    assert free == len(path) - 1
    group = make_class(learners, stack)
    state = make_state(np.random.default_rng(seed))
    draw_class(problem, lines, group, free, len(path), state)
    return Bench(problem, lines, group, free, len(path), path)


class PlainSplitMix:
    """Steele, Lea, Flood 2014, in Python's whole numbers."""

    def __init__(self, state: int) -> None:
        self.state = state

    def next(self) -> int:
        mask = 2**64 - 1
        self.state = (self.state + 0x9E3779B97F4A7C15) & mask
        z = self.state
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & mask
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & mask
        return z ^ (z >> 31)

    def uniform(self) -> float:
        return (self.next() >> 11) / 2.0**53

    def below(self, n: int) -> int:
        return math.floor(self.uniform() * n)


def test_the_generator_is_splitmix64():
    state, plain = np.array([1234567], np.uint64), PlainSplitMix(1234567)
    published = [6457827717110365317, 3203168211198807973, 9817491932198370423]
    assert [plain.next() for _ in range(3)] == published
    plain = PlainSplitMix(1234567)
    assert [uniform(state) for _ in range(100)] == [plain.uniform() for _ in range(100)]
    assert [below(state, 7) for _ in range(100)] == [plain.below(7) for _ in range(100)]
    drawn = np.array([normal(state) for _ in range(20000)])
    assert drawn.mean() == pytest.approx(0.0, abs=0.03)
    assert drawn.std() == pytest.approx(1.0, rel=0.03)
    assert (drawn**4).mean() == pytest.approx(3.0, rel=0.1)


def price(at: Bench, subject: np.ndarray) -> float:
    """J of the path that a learner's lines make; inf where they make none."""
    path = np.zeros((len(at.group.path), 2))
    if decode(at.problem, at.lines, subject, at.free, at.m, path) < 0.0:
        return np.inf
    return evaluate(at.problem, path, at.m, np.inf, at.group.stack)


def plain_phase(at: Bench, seed: int, propose) -> tuple[np.ndarray, np.ndarray]:
    """Subjects and costs after a phase in which learner k is offered ``propose(k, x, f, rng)``."""
    x, f = at.group.subject[:, : at.free].copy(), at.group.cost.copy()
    rng = PlainSplitMix(seed)
    for k in range(len(f)):
        new = propose(k, x, f, rng)
        padded = np.zeros((len(at.group.path), 2))
        padded[: at.free] = new
        if (cost := price(at, padded)) < f[k]:  # Eq. 24
            x[k], f[k] = new, cost
    return x, f


def assert_class_is(at: Bench, x: np.ndarray, f: np.ndarray) -> None:
    np.testing.assert_allclose(at.group.subject[:, : at.free], x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(at.group.cost, f, rtol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_the_teacher_phase_is_equations_20_to_24(seed):
    at = bench(seed)
    before = at.group.cost.copy()
    teacher = at.group.subject[int(np.argmin(before)), : at.free].copy()
    mean = at.group.subject[:, : at.free].mean(axis=0)

    def towards_the_teacher(k, x, f, rng):
        teaching_factor = 1 + rng.below(2)
        return x[k] + rng.uniform() * (teacher - teaching_factor * mean)

    x, f = plain_phase(at, seed, towards_the_teacher)
    teacher_phase(at.problem, at.lines, at.group, at.free, at.m, np.array([seed], np.uint64))
    assert_class_is(at, x, f)
    assert (f < before).sum() >= 3 and (f <= before).all()


@pytest.mark.parametrize("seed", range(5))
def test_the_learner_phase_is_equation_25(seed):
    at = bench(seed)
    before = at.group.cost.copy()

    def from_the_worse_to_the_better(k, x, f, rng):
        q = (k + 1 + rng.below(len(f) - 1)) % len(f)
        assert q != k
        better, worse = (k, q) if f[k] < f[q] else (q, k)
        return x[k] + rng.uniform() * (x[better] - x[worse])

    x, f = plain_phase(at, seed, from_the_worse_to_the_better)
    learner_phase(at.problem, at.lines, at.group, at.free, at.m, np.array([seed], np.uint64))
    assert_class_is(at, x, f)
    assert (f < before).sum() >= 3 and (f <= before).all()


def test_a_class_is_drawn_about_the_coded_path():
    at = bench(learners=400)
    subject = at.group.subject[:, : at.free]
    assert np.all(subject[0] == 0.0)
    plain = evaluate(at.problem, at.path, at.m, np.inf, at.group.stack)
    assert at.group.cost[0] == pytest.approx(plain, rel=1e-9)
    np.testing.assert_allclose(subject.std(axis=0), at.lines.spread[: at.free], rtol=0.15)
    for k in range(0, 400, 20):
        assert at.group.cost[k] == pytest.approx(price(at, at.group.subject[k]), rel=1e-9)


def test_twins_of_the_teacher_are_sent_off_and_no_others():
    at, alike = bench(), 1e-4
    best = int(np.argmin(at.group.cost))
    twins = [k for k in (3, 7, 11) if k != best]
    for k in twins:
        at.group.subject[k] = at.group.subject[best]
        at.group.cost[k] = at.group.cost[best] * (1.0 + 0.5 * alike)
    before, costs = at.group.subject.copy(), at.group.cost.copy()
    move_twins(at.problem, at.lines, at.group, at.free, at.m, alike, np.array([1], np.uint64))
    moved = (at.group.subject != before).any(axis=2).sum(axis=1)
    others = [k for k in range(LEARNERS) if k not in twins]
    assert np.all(moved[twins] == 1) and not moved[others].any()
    assert np.array_equal(at.group.cost[others], costs[others])
    for k in twins:
        assert at.group.cost[k] == pytest.approx(price(at, at.group.subject[k]), rel=1e-9)


def teach(idle=30, tolerance=1e-5, budget=10**6, seed=0) -> tuple[Bench, int, int, int]:
    at = bench(seed)
    at.problem.trials[0] = 0
    teacher, generations = tlbo(
        at.problem, at.lines, at.group, at.free, at.m, idle, tolerance, budget,
        np.array([seed], np.uint64),
    )  # fmt: skip
    return at, teacher, generations, int(at.problem.trials[0])


def test_a_class_learns_and_tells_its_best():
    at, teacher, generations, trials = teach()
    assert teacher == int(np.argmin(at.group.cost))
    assert at.group.cost[teacher] == pytest.approx(price(at, at.group.subject[teacher]), rel=1e-9)
    plain = evaluate(at.problem, at.path, at.m, np.inf, at.group.stack)
    assert at.group.cost[teacher] < 0.97 * plain
    # Two offers a learner and generation, besides the twins' moves and the draw.
    assert LEARNERS * (1 + 2 * generations) <= trials <= LEARNERS * (1 + 3 * generations)


@pytest.mark.parametrize("budget", [LEARNERS, 4 * LEARNERS - 1, 4 * LEARNERS, 300, 1001])
def test_the_budget_of_trials_is_kept_and_used(budget):
    _, _, generations, trials = teach(idle=10**6, tolerance=0.0, budget=budget)
    assert trials <= budget
    assert budget - trials < 3 * LEARNERS or generations == 0
    assert (generations > 0) == (budget >= 4 * LEARNERS)


@pytest.mark.parametrize("idle", [1, 4])
def test_it_stops_after_so_many_generations_without_gain(idle):
    assert teach(idle=idle, tolerance=0.9)[2] == idle  # nothing is worth that much
    assert teach(idle=idle, tolerance=1e-6)[2] > idle


def test_idle_generations_are_counted_from_the_last_gain():
    """Replayed a generation longer each time: the end comes ``idle`` after the last gain."""
    idle, tolerance = 3, 1e-3
    _, _, generations, _ = teach(idle=idle, tolerance=tolerance)
    costs = []
    for length in range(generations + 1):
        at = bench()
        draws = np.array([0], np.uint64)
        draw_class(at.problem, at.lines, at.group, at.free, at.m, draws)
        for _ in range(length):
            teacher_phase(at.problem, at.lines, at.group, at.free, at.m, draws)
            learner_phase(at.problem, at.lines, at.group, at.free, at.m, draws)
            move_twins(at.problem, at.lines, at.group, at.free, at.m, 0.01 * tolerance, draws)
        costs.append(at.group.cost.min())
    best, last_gain = costs[0], 0
    for generation, cost in enumerate(costs):
        if cost < best * (1.0 - tolerance):
            best, last_gain = cost, generation
    assert generations == last_gain + idle > idle
