"""The shortest path: known optima, a slow reference version, and properties of every path."""

from __future__ import annotations

import heapq
import math

import numpy as np
import pytest
from helpers.plain_shortest_path import shortest_path as plain_shortest_path
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.evaluation import shortest_path as module
from simloop.evaluation.shortest_path import shortest_path
from simloop.worlds.floor_plan import Section, rasterise, segment_distances

BOX = (-10.0, -10.0, 10.0, 10.0)


def disc(x, y, r):
    return Section("disc", np.array([[x, y]]), r)


def box(x, y, length, width, yaw=0.0):
    corners = 0.5 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [length, width]
    cos, sin = math.cos(yaw), math.sin(yaw)
    return Section("box", corners @ np.array([[cos, sin], [-sin, cos]]) + [x, y])


def solve(sections, start, goal, radius):
    plan = rasterise(sections, BOX, 0.5)
    return plan, shortest_path(plan, np.array(start, float), np.array(goal, float), radius)


def test_the_papers_four_obstacles():
    discs = [(3.2, 0.6, 0.30), (4.3, 1.7, 0.35), (5.3, 1.5, 0.30), (6.1, 2.7, 0.30)]
    plan, way = solve([disc(*one) for one in discs], (2, 0), (7, 3), 0.30)
    assert way.length_m == pytest.approx(6.2657, abs=5e-5)
    assert plan.clearance_m(way.xy_m).min() >= 0.30 - 1e-6


def test_without_obstacles_the_path_is_straight():
    _, way = solve([], (0, 0), (3, 4), 0.25)
    assert way.length_m == pytest.approx(5.0) and len(way.xy_m) == 2
    assert solve([disc(0, 5, 1)], (0, 0), (0, 0), 0.25)[1].length_m == 0.0


def test_round_one_disc_in_closed_form():
    # Two tangents and the arc between them, on a circle of radius 0.5 + 0.25.
    _, way = solve([disc(0, 0, 0.5)], (-2, 0), (2, 0), 0.25)
    tangent, lean = math.sqrt(4 - 0.75**2), math.acos(0.75 / 2)
    assert way.length_m == pytest.approx(2 * tangent + 0.75 * (math.pi - 2 * lean), rel=1e-12)


def test_round_one_wall_in_closed_form():
    # Up along a thin wall at the least distance, half round its end, and down again.
    for below_end in (0.0, 0.5):
        y = 1.0 - below_end
        _, way = solve([box(0, 0, 1e-9, 2)], (-0.25, y), (0.25, y), 0.25)
        assert way.length_m == pytest.approx(2 * below_end + math.pi * 0.25, rel=1e-5)


def test_a_gap_is_passed_exactly_when_the_disc_fits():
    def wall(gap):
        half = 0.5 * gap
        return [box(0, half + 2, 0.1, 4), box(0, -half - 2, 0.1, 4)]

    assert solve(wall(0.502), (-1, 0), (1, 0), 0.25)[1].length_m == pytest.approx(2.0)
    assert solve(wall(0.498), (-1, 0), (1, 0), 0.25)[1].length_m > 8.0


def test_no_path_is_none():
    ring = [box(0, 2, 4.2, 0.1), box(0, -2, 4.2, 0.1), box(2, 0, 0.1, 4.2), box(-2, 0, 0.1, 4.2)]
    assert solve(ring, (0, 0), (5, 5), 0.25)[1] is None
    assert solve([disc(1, 0, 0.5)], (0, 0), (1.6, 0), 0.25)[1] is None  # the goal is too near


def slow_reference(plan, start, goal, radius):
    """Search straight lines among many points around every grown vertex, checked by small steps.

    The points lie just outside the arcs, so that the chords between them are free. The result is
    therefore never too short.
    """
    count = 36
    angle = 2 * math.pi * np.arange(count) / count
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) / math.cos(math.pi / count)
    points = [np.array([start, goal], float)]
    for section in plan.sections:
        for vertex in section.vertices_m:
            points.append(vertex + (section.radius_m + radius) * ring)
    nodes = np.concatenate(points)
    nodes = nodes[(plan.clearance_m(nodes) >= radius - 1e-9)]
    best, queue, done = {0: 0.0}, [(0.0, 0)], set()
    share = np.linspace(0, 1, 200)[:, None, None]
    while queue:
        cost, node = heapq.heappop(queue)
        if node == 1:
            return cost
        if node in done:
            continue
        done.add(node)
        lines = nodes[node] + share * (nodes - nodes[node])
        clear = plan.clearance_m(lines.reshape(-1, 2)).reshape(200, -1).min(axis=0)
        for other in np.flatnonzero(clear >= radius - 1e-3):
            length = cost + math.dist(nodes[node], nodes[other])
            if length < best.get(int(other), math.inf):
                best[int(other)] = length
                heapq.heappush(queue, (length, int(other)))
    return None


@pytest.mark.parametrize("seed", range(8))
def test_agrees_with_the_slow_reference(seed):
    rng = np.random.default_rng(seed)
    sections = []
    while len(sections) < 6:
        x, y = rng.uniform(0.6, 3.4, 2)
        new = disc(x, y, rng.uniform(0.1, 0.4))
        if len(sections) % 2:
            new = box(x, y, *rng.uniform(0.2, 1.0, 2), rng.uniform(0, 3))
        if rasterise([new], BOX, 1.0).clearance_m(np.array([[0, 0], [4, 4]])).min() > 0.3:
            sections.append(new)
    plan, way = solve(sections, (0, 0), (4, 4), 0.25)
    slow = slow_reference(plan, (0, 0), (4, 4), 0.25)
    assert way.length_m <= slow + 2e-3
    assert way.length_m == pytest.approx(slow, rel=5e-3)


@pytest.mark.parametrize("seed", range(12))
def test_agrees_with_the_whole_tangent_graph(seed):
    """Boxes on a lattice, flush and overlapping as those of a map, among discs and turned boxes."""
    rng = np.random.default_rng(seed)
    sections = []
    for _ in range(14):
        x, y = rng.uniform(0.0, 6.0, 2)
        kind = rng.integers(3)
        if kind == 0:
            sections.append(disc(x, y, rng.uniform(0.05, 0.4)))
        elif kind == 1:
            length, width = np.round(rng.uniform(0.1, 1.5, 2), 1)
            sections.append(box(round(x, 1), round(y, 1), length, width))
        else:
            sections.append(box(x, y, *rng.uniform(0.1, 1.5, 2), rng.uniform(0, 3)))
    plan = rasterise(sections, (0.0, 0.0, 6.0, 6.0), 0.05)
    for _ in range(4):
        start, goal = rng.uniform(0.0, 6.0, (2, 2))
        ours = shortest_path(plan, start, goal, 0.2)
        theirs = plain_shortest_path(plan, start, goal, 0.2)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            assert ours.length_m == pytest.approx(theirs.length_m, abs=1e-12)


def test_a_floor_of_too_many_corners_is_told_and_leaves_its_figures_out(monkeypatch):
    monkeypatch.setattr(module, "_MOST_PAIRS", 10)
    with pytest.raises(module.TooManyCornersError):
        solve([box(1, 0, 0.5, 2), box(2, 0.5, 0.5, 2)], (0, 0), (3, 0), 0.2)


def test_hundreds_of_cylinders_are_no_matter_of_minutes():
    rng = np.random.default_rng(3)
    discs = [disc(x, y, 0.2) for x, y in rng.uniform(1.0, 39.0, (800, 2))]
    plan = rasterise(discs, (0.0, 0.0, 40.0, 40.0), 0.05)
    way = shortest_path(plan, np.array([0.4, 0.4]), np.array([39.6, 39.6]), 0.25)
    straight = math.dist((0.4, 0.4), (39.6, 39.6))
    assert straight < way.length_m < 1.1 * straight
    assert plan.clearance_m(way.xy_m).min() >= 0.25 - 1e-6


SHAPES = st.lists(
    st.one_of(
        st.builds(disc, st.floats(-3, 3), st.floats(-3, 3), st.floats(0.05, 0.8)),
        st.builds(
            box,
            st.floats(-3, 3),
            st.floats(-3, 3),
            st.floats(0.05, 2),
            st.floats(0.05, 2),
            st.floats(-3, 3),
        ),
    ),
    max_size=6,
)
ENDS = st.tuples(st.floats(-4, 4), st.floats(-4, 4))


@given(SHAPES, ENDS, ENDS)
@settings(max_examples=60)
def test_every_path_is_safe_connected_and_the_same_both_ways(sections, start, goal):
    plan, way = solve(sections, start, goal, 0.25)
    if way is None:
        return
    assert way.length_m >= math.dist(start, goal) - 1e-9
    assert np.allclose(way.xy_m[0], start) and np.allclose(way.xy_m[-1], goal)
    chords = np.hypot(*np.diff(way.xy_m, axis=0).T).sum()
    assert way.length_m * 0.9995 - 1e-9 <= chords <= way.length_m + 1e-9
    share = np.linspace(0, 1, 20)[:, None, None]
    between = (way.xy_m[:-1] + share * np.diff(way.xy_m, axis=0)).reshape(-1, 2)
    # A chord of a two-degree arc about 1 m of radius dips 0.15 mm below it.
    assert plan.clearance_m(between).min(initial=1.0) >= 0.25 - 2e-4
    back = solve(sections, goal, start, 0.25)[1]
    assert back is not None and back.length_m == pytest.approx(way.length_m, rel=1e-6, abs=1e-9)


@given(SHAPES, ENDS, ENDS)
@settings(max_examples=30)
def test_one_more_obstacle_never_shortens_the_path(sections, start, goal):
    more = solve(sections, start, goal, 0.25)[1]
    less = solve(sections[:-1], start, goal, 0.25)[1]
    if more is not None:
        assert less is not None and less.length_m <= more.length_m + 1e-5


def test_segment_distances():
    a = np.array([[0.0, 0.0]])
    b = np.array([[2.0, 0.0]])
    c = np.array([[1.0, -1.0], [0.5, 1.0], [3.0, 4.0], [1.0, 0.5]])
    d = np.array([[1.0, 1.0], [1.5, 1.0], [5.0, 5.0], [1.0, 0.5]])
    expected = [[0.0, 1.0, math.hypot(1, 4), 0.5]]
    assert np.allclose(segment_distances(a, b, c, d), expected)
