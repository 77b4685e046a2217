"""Movers: their settings, how they move, and who is to blame for a touch."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.loop import Simulation
from simloop.messages import GoalReading, MapUpdate, MoverTracks, RobotStatus, TrackCommand
from simloop.scenario.load import load
from simloop.truth import LooseTruth
from simloop.worlds.body import Body
from simloop.worlds.floor_plan import Section, rasterise
from simloop.worlds.movers.crowd import Crowd, MovingGoal, on_path
from simloop.worlds.movers.motion import FloorField, RobotOutline, clearance_at, gap_to_outline
from simloop.worlds.movers.random_crowd import draw_crowd
from simloop.worlds.movers.settings import Crowd as CrowdSettings
from simloop.worlds.movers.settings import GoalMotion, Mover

PERIOD_S = 0.01
FLOOR = rasterise(
    [Section("pillar", np.array([[2.0, 2.0]]), 0.3)], np.array([0.0, 0.0, 5.0, 4.0]), 0.02
)
BODY = Body(0.49, 0.465, 0.2)


def crowd_of(*movers, seed=0):
    return Crowd(movers, FLOOR, BODY, PERIOD_S, np.random.default_rng(seed))


def mover(motion, x=1.0, y=1.0, **more):
    return Mover(motion=motion, position_m=(x, y), **more)


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        (["movers=[{motion='walk'}]"], "needs position_m"),
        (["movers=[{motion='path',keys_txy=[[0,1,1]]}]"], "two keys"),
        (["movers=[{motion='path',keys_txy=[[0,1,1],[0,2,2]]}]"], "later than the one before"),
        (["movers=[{motion='swim',position_m=[1,1]}]"], "motion"),
        (["crowd.count=0"], "crowd.count"),
        (["crowd.speed_mps=[0.5,0.2]"], "least first"),
        (["crowd.count=100", "crowd.diameter_m=[1.0,1.2]"], "ask for fewer"),
        (["movers=[{motion='walk',position_m=[1.0,1.0]}]"], "overlap at the start"),
        (["goal_motion.motion=path", "goal_motion.keys_txy=[[0,1,1],[2,2,2]]"], "first key"),
        (["goal_motion.speed_mps=-1"], "goal_motion.speed_mps"),
    ],
)
def test_what_is_wrong_with_a_mover_is_said_in_one_line(keys, line):
    with pytest.raises(InputError, match=line) as caught:
        Simulation(load("hall", keys))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("motion", ["constant", "walk", "pedestrian"])
def test_movers_keep_to_the_free_floor_and_to_their_speed(motion):
    crowd = crowd_of(mover(motion, speed_mps=0.5), mover(motion, 4.0, 3.0, speed_mps=0.3))
    before, way = np.array([[1.0, 1.0], [4.0, 3.0]]), np.zeros(2)
    for _ in range(6000):
        after = crowd.step(None).copy()
        step = np.hypot(*(after - before).T)
        # A wall that was entered puts one back by as much as it was entered.
        assert np.all(step <= 2.0 * PERIOD_S * np.array([0.5, 0.3]) + 1e-9)
        way, before = way + step, after
        assert np.all(FLOOR.clearance_m(after) > 0.2 - 0.02)
        assert np.all((after > 0.18) & (after < np.array([4.82, 3.82])))
    assert np.all(way > 5.0)


def test_a_crowd_depends_on_its_seed_alone():
    def places(seed):
        crowd = crowd_of(mover("walk"), mover("pedestrian", 4.0, 3.0), seed=seed)
        return np.array([crowd.step(None).copy() for _ in range(500)])

    assert np.array_equal(places(1), places(1))
    assert not np.array_equal(places(1), places(2))


@given(st.floats(0.0, 100.0))
def test_a_path_is_walked_over_and_over(t_s):
    keys = np.array([[0.0, 1.0, 1.0], [2.0, 3.0, 1.0], [5.0, 1.0, 1.0]])
    place = on_path(keys, t_s)
    phase = t_s % 5.0
    x = 1.0 + phase if phase <= 2.0 else 3.0 - 2.0 * (phase - 2.0) / 3.0
    assert place == pytest.approx([x, 1.0], abs=1e-6)


@pytest.mark.parametrize("pushes", [False, True])
def test_a_mover_on_a_path_steps_back_from_the_robot_unless_it_pushes(pushes):
    path = Mover(motion="path", keys_txy=((0.0, 1.0, 1.0), (10.0, 4.0, 1.0)), pushes=pushes)
    crowd, robot = crowd_of(path), np.array([3.0, 1.0, 0.0])
    places = np.array([crowd.step(robot)[0].copy() for _ in range(900)])
    most = places[:, 0].max()
    if pushes:
        assert most > 3.5
    else:
        assert most == pytest.approx(3.0 - 0.245 - 0.2 + 0.06, abs=0.01)
        assert places[-1, 0] < most


def test_pedestrians_keep_clear_of_the_robot_that_others_run_into():
    def least_gap(motion):
        crowd, robot = crowd_of(mover(motion, 1.0, 1.0)), np.array([3.0, 1.0, 0.0])
        gaps = []
        for _ in range(3000):
            x, y = crowd.step(robot)[0]
            gaps.append(gap_to_outline(RobotOutline(*robot, 0.245, 0.2325), x, y)[0] - 0.2)
        return min(gaps)

    assert least_gap("pedestrian") > 0.0
    assert -0.08 < least_gap("constant") < 0.0


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-math.pi, math.pi))
def test_the_gap_to_the_outline_is_that_to_its_nearest_point(x, y, yaw):
    gap, nx, ny = gap_to_outline(RobotOutline(0.1, -0.2, yaw, 0.245, 0.2325), x, y)
    assert math.hypot(nx, ny) == pytest.approx(1.0)
    t = np.linspace(-1.0, 1.0, 401)
    sides = [(0.245 * s, 0.2325 * t) for s in (-1, 1)] + [(0.245 * t, 0.2325 * s) for s in (-1, 1)]
    edge = np.concatenate([np.stack(np.broadcast_arrays(a, b), axis=1) for a, b in sides])
    cos, sin = math.cos(yaw), math.sin(yaw)
    edge = edge @ np.array([[cos, sin], [-sin, cos]]) + [0.1, -0.2]
    assert abs(gap) == pytest.approx(np.hypot(*(edge - [x, y]).T).min(), abs=2e-3)


def test_room_is_that_of_the_floor_plan_and_of_its_bounds():
    corner = FLOOR.origin_m.tolist()
    field = FloorField(FLOOR.distance_m, *corner, FLOOR.resolution_m, FLOOR.bounds_m)
    for x, y in np.random.default_rng(0).uniform([0.1, 0.1], [4.9, 3.9], (200, 2)):
        room, nx, ny = clearance_at(field, x, y)
        sides = min(x, y, 5.0 - x, 4.0 - y)
        exact = min(float(FLOOR.clearance_m(np.array([x, y]))[0]), sides)
        assert room == pytest.approx(exact, abs=0.01)
        from_pillar = math.dist((x, y), (2.0, 2.0))
        if abs(from_pillar - 0.3 - exact) < 1e-6 and exact < sides - 0.05:
            assert (nx * (x - 2.0) + ny * (y - 2.0)) / from_pillar > 0.95


def test_a_drawn_crowd_has_room_and_each_motion_in_turn():
    settings = CrowdSettings(count=8, diameter_m=(0.3, 0.4))
    movers = draw_crowd(settings, FLOOR, (0.5, 0.5, 0.0), np.random.default_rng(3))
    assert [m.motion for m in movers] == 2 * ["pedestrian", "walk", "constant", "path"]
    for i, one in enumerate(movers):
        assert FLOOR.clearance_m(np.array(one.start_m))[0] > 0.5 * one.diameter_m
        assert math.dist(one.start_m, (0.5, 0.5)) > 1.5
        assert 0.2 <= one.speed_mps <= 0.5
        for other in movers[:i]:
            apart = math.dist(one.start_m, other.start_m)
            assert apart > 0.5 * (one.diameter_m + other.diameter_m)


def test_a_moving_goal_keeps_its_room_and_is_told_with_its_noise():
    motion = GoalMotion(speed_mps=0.5, noise_m=0.02, room_m=0.4)
    goal = MovingGoal(motion, (1.0, 1.0), FLOOR, BODY, PERIOD_S, np.random.default_rng(0))
    errors, t_ns = [], 0
    for _ in range(20_000):
        place = goal.step()
        t_ns += 10_000_000
        reading = goal.reading(t_ns, place)
        if reading is not None:
            errors.append(reading.position_m - place)
        assert FLOOR.clearance_m(place)[0] > 0.37
    assert len(errors) == 2000
    assert np.std(errors) == pytest.approx(0.02, rel=0.1)


ROUND = ((0.0, 3.0, 1.0), (4.0, 1.3, 1.0), (40.0, 1.3, 1.0))


def driven(volts, **more):
    """A robot at (1, 1) that looks along x, at a fixed voltage, and a mover that approaches it."""
    one = Mover(motion="path", keys_txy=ROUND, **more)
    scenario = replace(load("hall", ["time_limit_s=6", "start=[1.0,1.0,0.0]"]), movers=(one,))
    sim = Simulation(replace(scenario, crowd=None))

    def hand(readings):
        still, t_ns = np.zeros(2), readings.encoders.t_ns
        return TrackCommand(t_ns, 0.0, 0.0, still, np.full(2, volts), "follow")

    sim.robot = SimpleNamespace(step=hand, messages=[], status=RobotStatus.DRIVING)
    return sim.run().metrics


@pytest.mark.parametrize("pushes", [False, True])
def test_a_robot_that_stands_is_hit_and_not_to_blame(pushes):
    figures = driven(0.0, pushes=pushes)
    assert figures["hit_count"] > 0
    assert figures["contact_count"] == 0
    assert figures["outcome"] == "timeout"


def test_a_robot_that_drives_into_a_mover_is_to_blame():
    figures = driven(10.0)
    assert figures["outcome"] == "collision"
    assert (figures["contact_count"], figures["hit_count"]) == (1, 0)


def test_the_hall_is_crossed_the_same_way_each_time_and_movers_are_known():
    def crossing(seed):
        heard = []
        run = Simulation(load("hall", seed=seed), listeners=[heard.append]).run()
        return run, heard

    run, heard = crossing(1)
    assert run.reached
    assert run.metrics["contact_count"] == 0
    assert crossing(1)[0].metrics["state_hash"] == run.metrics["state_hash"]
    truths = {m.t_ns: m for m in heard if isinstance(m, LooseTruth)}
    tracks = [m for m in heard if isinstance(m, MoverTracks) and m.t_ns in truths]
    errors = []
    for told in tracks:
        places = truths[told.t_ns].position_m[:, :2]
        apart = np.hypot(*np.moveaxis(told.position_m[:, None] - places, -1, 0))
        errors += apart.min(axis=1).tolist()
    # Of a disc only the near half is seen, so that its middle is taken to be a little nearer.
    assert len(errors) > 1000
    assert np.median(errors) < 0.15
    assert np.mean(np.array(errors) < 0.4) > 0.9


def test_a_goal_that_walks_is_caught():
    heard = []
    run = Simulation(load("moving_goal", seed=2), listeners=[heard.append]).run()
    assert run.reached
    told = [m.position_m for m in heard if isinstance(m, GoalReading)]
    assert math.dist(told[0], told[-1]) > 0.5
    assert run.metrics["distance_to_go_m"] <= 0.10


def test_movers_are_kept_out_of_the_map():
    """What crosses the room for ten seconds leaves no trace of itself."""
    heard = []
    sim = Simulation(load("hall", ["time_limit_s=12"], seed=4), listeners=[heard.append])
    sim.run()
    last, floor = [m for m in heard if isinstance(m, MapUpdate)][-1], sim.world.floor
    rows, columns = np.nonzero(last.log_odds > sim.scenario.config.slam.occupied_log_odds)
    centres = last.origin_m + (np.stack([columns, rows], axis=1) + 0.5) * last.resolution_m
    inside = np.all((centres > 0.3) & (centres < 9.7), axis=1)
    ghosts = floor.clearance_m(centres[inside]) > 0.15
    assert ghosts.sum() < 60
    near = np.array([[0.0, 5.0], [5.0, 0.0]])
    for place in near:
        assert np.hypot(*(centres - place).T).min() < 0.2
