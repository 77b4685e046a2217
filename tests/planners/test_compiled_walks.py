"""The compiled searches of the walkers against their plain twins, and the walks' short cuts."""

from __future__ import annotations

import math
from dataclasses import astuple, replace

import numpy as np
import pytest
from helpers import walks

from simloop.benchmarks.planners.paper_scenes import ONLINE_SCENES, online_scene, paper_scene
from simloop.benchmarks.planners.scenes import disc_world
from simloop.config import PlannerConfig, VehicleConfig
from simloop.planners.metaheuristics.rule_avoa import AfricanVultures
from simloop.planners.metaheuristics.rule_swarm import AdaptiveSwarm, classify
from simloop.planners.metaheuristics.rule_wdo import WdoOptions
from simloop.planners.problem.clearance import make_problem
from simloop.planners.protocol import PlanningTask
from simloop.planners.reactive import controller_search, evolution, ga_apf
from simloop.planners.reactive.controller_search import CompiledFuzzySteering, tune
from simloop.planners.reactive.deformed_field import MOST_STEPS, NOTES, Field, walk
from simloop.planners.reactive.fuzzy import HIGH, LOW, FuzzySteering, controller_cost, sector_range
from simloop.planners.reactive.heading_search import (
    relevant,
    swarm_state,
    swarm_steering,
    vulture_steering,
)
from simloop.planners.reactive.online import RangeSensor, motion_box
from simloop.planners.reactive.sensing import LocalView
from simloop.planners.reactive.steering import RuleSteering, heading_cost
from simloop.planners.registry import make_planner
from simloop.planners.splitmix import make_state

TWINS = {
    "avoa": (vulture_steering, lambda: RuleSteering(AfricanVultures)),
    "apso": (swarm_steering, lambda: RuleSteering(AdaptiveSwarm)),
    "fuzzy_wdo": (CompiledFuzzySteering, FuzzySteering),
}


def views(count=6):
    """What a robot senses at free places of the papers' scenes, and its headings."""
    rng, out = np.random.default_rng(7), []
    for name in ONLINE_SCENES:
        world = online_scene(name)
        goal = world.goal.at(0)
        problem = make_problem(world.fixed, world.start, goal, safe_m=world.safe_m)
        box = motion_box(problem)
        sensor = RangeSensor(problem, world.reach_m, box, 0.62)
        for step in range(count):
            x, y = rng.uniform(box[:2] + 1.0, box[2:] - 1.0)
            points = sensor.points(x, y)
            if not len(points) or np.hypot(*(points - (x, y)).T).min() < 0.63:
                continue
            movers = sensor.movers(x, y, world.movers, step)
            view = LocalView(points, movers, x, y, *goal, 0.62, 0.5, world.reach_m, box)
            out.append((view, rng.uniform(-math.pi, math.pi)))
    return out


@pytest.mark.parametrize("name", TWINS)
def test_a_compiled_steering_chooses_the_headings_of_its_plain_twin(name):
    fast, plain = (make() for make in TWINS[name])
    states = [make_state(np.random.default_rng(3)) for _ in range(2)]
    for view, heading in views(4):
        found = fast.heading(view, heading, states[0])
        assert found == pytest.approx(plain.heading(view, heading, states[1]), abs=1e-12)
        assert states[0][0] == states[1][0] and fast.evaluations == plain.evaluations


def test_points_that_are_left_out_change_no_cost():
    rng = np.random.default_rng(5)
    for view, heading in views():
        bearing = math.atan2(view.target_y - view.y, view.target_x - view.x)
        fewer, fewer_of_many = relevant(view), controller_search.relevant(view)
        assert len(fewer.points) <= len(fewer_of_many.points) <= len(view.points)
        scratch = np.empty((4, max(len(view.points), 5), 3))
        here = tuple(sector_range(view, view.x, view.y, heading + off) for off in (1.1, 0.0, -1.1))
        for angle in rng.uniform(-math.pi, math.pi, 20):
            assert heading_cost(fewer, angle, bearing) == heading_cost(view, angle, bearing)
        for _ in range(20):
            x = rng.uniform(LOW, HIGH)
            quick = controller_search.cost_of(fewer_of_many, x, heading, here, scratch)
            assert quick == controller_cost(view, x, heading)


def test_tuning_never_worsens_the_controller():
    view, heading = views(2)[0]
    tuned = 0.5 * (LOW + HIGH)
    before = controller_cost(view, tuned, heading)
    state = make_state(np.random.default_rng(1))
    tune(view, tuned, heading, astuple(WdoOptions()), state)
    assert controller_cost(view, tuned, heading) <= before


def test_the_compiled_swarm_is_in_the_same_state():
    for f in np.concatenate((np.linspace(0.0, 1.0, 201), [0.1, 0.2, 0.3, 0.4, 0.6, 0.7, 0.8, 0.9])):
        for before in range(4):
            assert swarm_state(f, before) == classify(float(f), before)


def field_of(name):
    one = paper_scene(name)
    problem = make_problem(one.world, one.start, one.goal, safe_m=one.safe_m)
    found = ga_apf.classify(one.world.discs_xyr_m, one.start, one.goal, one.safe_m)
    unit = math.dist(one.start[:2], one.goal) / 100.0
    return Field(problem, found.along, ga_apf.EPSILON * unit**2, found.adjacent_m)


@pytest.mark.parametrize("scene", ["abed5", "abed50", "strip20x60"])
def test_a_walk_that_goes_on_from_a_note_is_the_whole_walk(scene):
    field, rng = field_of(scene), np.random.default_rng(2)
    count, nowhere = len(field.along), np.zeros((0, 2))
    for _ in range(30):
        genes = rng.uniform(-1.5, 1.5, count)
        notes = np.zeros((count, NOTES))
        noted = walk(field, genes, notes, 0, np.inf, nowhere)[3]
        known = rng.integers(1, count)
        other = np.concatenate((genes[:known], rng.uniform(-1.5, 1.5, count - known)))
        whole = walk(field, other, np.zeros((count, NOTES)), 0, np.inf, nowhere)
        if noted > known:
            assert walk(field, other, notes, known, np.inf, nowhere) == whole
        else:  # the first walk ended before a gene that differs
            assert whole[:3] == walk(field, genes, notes, 0, np.inf, nowhere)[:3]
        path = np.zeros((MOST_STEPS, 2))
        points, cost, reached, _ = walk(field, other, notes.copy(), 0, np.inf, path)
        length = np.hypot(*np.diff(path[:points], axis=0).T).sum()
        assert not reached or cost == pytest.approx(length, rel=1e-9)
        # It is cut short only if it costs more than the limit.
        for limit in (0.9 * cost, 1.1 * cost):
            cut = walk(field, other, np.zeros((count, NOTES)), 0, limit, nowhere)[1]
            assert cut == cost or (cut == np.inf and limit < cost)


def test_the_kept_chromosomes_have_the_fitness_of_their_whole_walks():
    field = field_of("abed50")
    herd = evolution.make_herd(evolution.POPULATION, len(field.along))
    evolution.evolve(field, herd, 30, 40_000, make_state(np.random.default_rng(4)))
    kept = evolution.POPULATION // 2
    for genes, fit in zip(herd.genes[:kept], herd.fit[:kept], strict=True):
        notes = np.zeros((len(genes), NOTES))
        cost = walk(field, genes, notes, 0, np.inf, np.zeros((0, 2)))[1]
        assert fit == 1.0 / cost
    assert (np.diff(herd.fit) <= 0.0).all()


@pytest.mark.parametrize("name", ["ga_apf", "avoa_online"])
def test_a_walker_keeps_the_way_that_it_is_on_until_it_finds_a_better_one(name):
    one = walks.room_in_a_field()
    planner = make_planner(PlannerConfig(name=name), VehicleConfig())
    task = PlanningTask(one.world, one.start, one.goal, one.safe_m)
    first = planner.plan(task, np.random.default_rng(0))
    assert first.safe
    for seed in range(1, 6):
        again = planner.plan(replace(task, previous=first), np.random.default_rng(seed))
        assert again.safe and again.cost <= first.cost


def test_the_strip_widens_only_if_no_path_reaches_the_goal(monkeypatch):
    """The overhang of the footprint, for which paths are walked again, is no reason to widen it."""
    one, widened = walks.room_in_a_field(), []

    def classify(*given):
        widened.append(given[-1])
        return real(*given)

    real = ga_apf.classify
    monkeypatch.setattr(ga_apf, "classify", classify)
    planner = make_planner(PlannerConfig(name="ga_apf"), VehicleConfig())
    task = PlanningTask(one.world, one.start, one.goal, one.safe_m)
    assert planner.plan(task, np.random.default_rng(0)).safe
    assert set(widened) == {1.0}
    # A wall of discs wider than the strip: only a wider strip leads round it.
    wall = np.array([[2.0, y, 0.2] for y in np.arange(-1.4, 1.5, 0.2)])
    task = replace(task, world=disc_world(wall, (-4.0, -6.0, 8.0, 6.0)), goal=np.array([4.0, 0.0]))
    widened.clear()
    planner = make_planner(PlannerConfig(name="ga_apf"), walks.POINT)
    assert planner.plan(task, np.random.default_rng(0)).safe
    assert widened[0] == 1.0 and max(widened) > 1.0


def test_a_walk_ends_when_it_has_circled_the_obstacle_both_ways():
    turn = np.linspace(0.0, 2.0 * math.pi, 40, endpoint=False)
    ring = np.stack((4.0 + np.cos(turn), np.sin(turn), np.full(40, 0.1)), axis=1)
    task = PlanningTask(
        disc_world(ring, (-2.0, -4.0, 8.0, 4.0)), np.zeros(3), np.array([4.0, 0.0]), 0.26
    )
    planner = make_planner(PlannerConfig(name="avoa_online"), walks.POINT)
    plan = planner.plan(task, np.random.default_rng(0))
    most_steps = 50 + 10 * 4.0 / (0.4 * 0.26)
    assert not plan.safe and plan.evaluations < 0.8 * 110 * most_steps
