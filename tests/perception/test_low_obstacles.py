"""What the depth camera shows, what of it is in the way, and how long that is remembered."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.paths import smooth
from helpers.tracking import K, allowed, at_pose, monitor_of, tracker_to
from helpers.truths import truth_at
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from simloop.config import CameraConfig, Config, LowObstaclesConfig, RatesConfig, SlamConfig
from simloop.control.watchdog import Stale
from simloop.geometry.se2 import between, transform_points
from simloop.loop import Simulation
from simloop.mapping.grid_map import GridMap
from simloop.messages import DepthImage, Event, LowObstacles, Mode, MoverTracks
from simloop.perception.low_obstacles import (
    LowObstacleMap,
    find_obstacles,
    on_scan_surfaces,
)
from simloop.physics.plant import Plant
from simloop.scenario.load import load
from simloop.sensors import DepthCamera
from simloop.truth import Truth
from simloop.worlds.arena import build
from simloop.worlds.cross_section import floor_plan
from simloop.worlds.obstacles import Obstacle

MOUNT = np.array([0.205, 0.0, 0.158])
CLEAN = CameraConfig(enabled=True, noise_1pm=0.0, dropout=0.0)
LIMITS = np.array([0.025, 0.5, 0.25, 2.5])
ORIGIN = np.zeros(3)
NO_SCAN = np.empty((0, 2))
ROWS = (0.5 * (CLEAN.rows - 1) - np.arange(CLEAN.rows)) * 2 * math.tan(0.5 * CLEAN.fov_rad[1])
ROWS = ROWS / CLEAN.rows
seeds = st.integers(0, 2**32 - 1)


class Shapes:
    """A floor z = 0 and boxes (x0, y0, z0, x1, y1, z1) on it or over it."""

    def __init__(self, *boxes, ramp=0.0, pitch=0.0):
        self.boxes, self.ramp = np.array(boxes, float).reshape(-1, 6), ramp

    def look(self, origin_m, directions, cutoff_m):
        # The ground z = ramp * (x - 0.4) beyond x = 0.4, level before.
        with np.errstate(divide="ignore", invalid="ignore"):
            level = -origin_m[2] / directions[:, 2]
            level = np.where(origin_m[0] + level * directions[:, 0] < 0.4, level, np.inf)
            high = origin_m[2] - self.ramp * (origin_m[0] - 0.4)
            rising = high / (self.ramp * directions[:, 0] - directions[:, 2])
            rising = np.where(origin_m[0] + rising * directions[:, 0] >= 0.4, rising, np.inf)
            best = np.minimum(
                np.where(level > 0, level, np.inf), np.where(rising > 0, rising, np.inf)
            )
            for box in self.boxes:
                sides = np.stack(
                    [(box[:3] - origin_m) / directions, (box[3:] - origin_m) / directions]
                )
                first, last = sides.min(axis=0).max(axis=1), sides.max(axis=0).min(axis=1)
                hit = (first <= last) & (first > 0)
                best = np.where(hit, np.minimum(best, first), best)
        return np.where(best <= cutoff_m, best, -1.0)


def image_of(world, config=CLEAN, pose=(0.0, 0.0, 0.0), t_s=0.1, seed=0) -> DepthImage:
    camera = DepthCamera(config, 0.1, MOUNT, np.random.default_rng(seed))
    image = camera.shoot(truth_at(t_s, pose), world)
    assert image is not None
    return image


def block(x, bottom=0.0, top=0.1, depth=0.2, y=(-0.3, 0.3)):
    """A box whose face is x m before base_link."""
    return (x, y[0], bottom, x + depth, y[1], top)


def low_map(config=None) -> LowObstacleMap:
    return LowObstacleMap(config or LowObstaclesConfig(), SlamConfig(), MOUNT, 0.2)


def seen(
    world, looks=3, scan=NO_SCAN, pose=ORIGIN, into=None, movers=None, scan_pose=None
) -> LowObstacleMap:
    into, scan_pose = into or low_map(), pose if scan_pose is None else scan_pose
    for k in range(looks):
        into.update(image_of(world, pose=pose, seed=k), np.array(pose), scan, scan_pose, movers)
    return into


# --- the sensor


def test_the_floor_and_a_wall_come_out_where_they_are():
    image = image_of(Shapes(block(1.205, top=2.0, y=(-9, 9))))
    assert image.depth_m.shape == (48, 64)
    assert image.depth_m.dtype == np.float32
    for row, high in enumerate(ROWS):
        floor = -MOUNT[2] / high if high < 0 else np.inf
        assert image.depth_m[row] == pytest.approx(min(floor, 1.0), rel=1e-6)
    assert not image.depth_m.flags.writeable


def test_what_is_too_near_too_far_or_dropped_is_empty():
    assert np.isinf(image_of(Shapes(block(0.205 + 0.16, top=2.0, y=(-9, 9)))).depth_m).all()
    assert np.isinf(image_of(Shapes()).depth_m[ROWS > -0.158 / 3.0]).all()
    config = replace(CLEAN, dropout=0.25)
    wall = Shapes(block(1.0, top=2.0, y=(-9, 9)))
    lost = [np.isinf(image_of(wall, config, seed=s).depth_m).mean() for s in range(20)]
    assert np.mean(lost) == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize("far", [0.5, 1.0, 2.0])
def test_noise_grows_with_the_square_of_the_depth(far):
    config = replace(CLEAN, noise_1pm=0.002)
    depths = np.stack(
        [
            image_of(Shapes(block(0.205 + far, top=9.0, y=(-9, 9))), config, seed=s).depth_m[10]
            for s in range(40)
        ]
    )
    assert depths.std() == pytest.approx(0.002 * far**2, rel=0.06)
    assert depths.mean() == pytest.approx(far, abs=4 * 0.002 * far**2 / math.sqrt(depths.size))


def test_an_image_comes_once_a_period_and_the_same_seed_gives_the_same():
    camera = DepthCamera(CLEAN, 0.1, MOUNT, np.random.default_rng(0))
    due = [camera.shoot(truth_at(k * 0.01), Shapes()) is not None for k in range(21)]
    assert [k for k, is_due in enumerate(due) if is_due] == [0, 10, 20]
    noisy = replace(CLEAN, noise_1pm=0.002, dropout=0.1)
    first, again = (image_of(Shapes(block(1.0)), noisy, seed=3).depth_m for _ in range(2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, image_of(Shapes(block(1.0)), noisy, seed=4).depth_m)


def test_the_vehicle_in_its_arena_sees_what_hangs_there():
    things = [Obstacle("box", (1.2, 0.0), (0.2, 2.0), 0.0, 0.05, bottom_m=0.1)]
    plant = Plant(build("open", things), Config())
    truth = plant.reset(ORIGIN)
    camera = DepthCamera(CLEAN, 0.1, plant.base_from_camera, np.random.default_rng(0))
    image = camera.shoot(truth, plant)
    face = 1.1 - truth.position_m[0] - plant.base_from_camera[0]
    height = plant.base_from_camera[2] + ROWS * face
    inside = (height > 0.105) & (height < 0.145)
    assert inside.any()
    assert image.depth_m[inside, 30] == pytest.approx(face, abs=0.005)
    below = height < 0.09
    floor = -plant.base_from_camera[2] / ROWS[below]
    assert image.depth_m[below, 30] == pytest.approx(floor, rel=0.05)


# --- what of an image is in the way


def plain_obstacles(depth, high, camera_m, limits):
    """The oracle: the same rules, pixel by pixel, without a thought for speed."""
    step, slope, height, reach = limits
    found = []
    for column in depth.T:
        z = camera_m + high * column
        valid = [r for r in range(len(column)) if np.isfinite(column[r])]
        marks, ground = [], [0.0]
        for r in valid:
            lower = [b for b in valid if b > r]
            before = column[lower[0]] if lower else 0.0
            if z[r] < step:
                ground.append(column[r])
                continue
            if column[r] > reach:
                continue
            climbs = z[r] <= height and any(
                z[r] - z[b] >= max(step, slope * abs(column[r] - column[b])) for b in lower
            )
            under = r + 1 < len(column) and before > column[r]
            hangs = under and camera_m + high[r + 1] * column[r] < height <= z[r]
            if climbs or hangs:
                marks.append((column[r], before))
        sure = [far for far, before in marks if far - before < 0.04]
        free = min([max(ground), *(min(pair) for pair in marks)])
        at_it = np.abs(column - min(sure, default=-9.0)) < 0.04
        top = max([0.0, *z[at_it]])
        found.append((min(sure, default=np.inf), free, top))
    return np.array(found)


@given(
    seeds,
    st.lists(st.tuples(st.floats(0.5, 2.5), st.floats(0.0, 0.3), st.floats(0.02, 0.4)), max_size=3),
    st.floats(0.0, 0.3),
)
def test_the_kernel_is_its_plain_twin(seed, things, ramp):
    boxes = [block(x, bottom, bottom + tall) for x, bottom, tall in things]
    config = replace(CLEAN, noise_1pm=0.002, dropout=0.05)
    image = image_of(Shapes(*boxes, ramp=ramp), config, seed=seed)
    depth = image.depth_m.astype(float)
    found = find_obstacles(image.depth_m, ROWS, MOUNT[2], LIMITS)
    assert found == pytest.approx(plain_obstacles(depth, ROWS, MOUNT[2], LIMITS))


@given(st.floats(0.0, 0.35), seeds)
def test_ground_and_ramps_are_no_obstacles(ramp, seed):
    config = replace(CLEAN, noise_1pm=0.002, dropout=0.05)
    image = image_of(Shapes(ramp=ramp), config, seed=seed)
    assert np.isinf(find_obstacles(image.depth_m, ROWS, MOUNT[2], LIMITS)[:, 0]).all()


@given(st.floats(0.4, 0.95), st.floats(0.05, 0.5))
def test_whatever_stands_is_found_at_its_face(far, tall):
    image = image_of(Shapes(block(MOUNT[0] + far, top=tall, y=(-9, 9))))
    nearest, free, top = find_obstacles(image.depth_m, ROWS, MOUNT[2], LIMITS).T
    assert nearest == pytest.approx(far, abs=1e-3)
    assert (free <= far + 1e-3).all()
    assert (top <= tall + 1e-3).all()


@given(st.floats(0.5, 2.4), st.floats(0.05, 0.24))
def test_whatever_hangs_too_low_is_found_at_its_face(far, bottom):
    hung = block(MOUNT[0] + far, bottom, 1.5, y=(-9, 9))
    image = image_of(Shapes(hung))
    nearest, free, _ = find_obstacles(image.depth_m, ROWS, MOUNT[2], LIMITS).T
    assert nearest == pytest.approx(far, abs=1e-3)
    assert (free <= far + 1e-3).all()


@given(st.floats(0.5, 1.5), st.floats(0.3, 0.8))
def test_what_hangs_high_enough_is_no_obstacle(far, bottom):
    image = image_of(Shapes(block(MOUNT[0] + far, bottom, 1.5, y=(-9, 9))))
    assert np.isinf(find_obstacles(image.depth_m, ROWS, MOUNT[2], LIMITS)[:, 0]).all()


def test_what_can_be_climbed_is_no_obstacle():
    image = image_of(Shapes(block(0.8, top=0.02, y=(-9, 9))))
    assert np.isinf(find_obstacles(image.depth_m, ROWS, MOUNT[2], LIMITS)[:, 0]).all()


@given(seeds, st.integers(1, 30))
def test_points_of_a_scan_are_known_again(seed, count):
    rng = np.random.default_rng(seed)
    bearing = np.sort(rng.uniform(-math.pi, math.pi, count))
    scan = rng.uniform(0.5, 3.0, count)[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], 1)
    points = np.concatenate((rng.uniform(-3, 3, (10, 2)), scan + 0.01))
    same = rng.uniform(0.02, 0.3, len(points))
    told = on_scan_surfaces(points, scan, same, 0.3)
    for point, reach, said in zip(points, same, told, strict=True):
        apart = np.inf
        for a, b in zip(np.roll(scan, 1, axis=0), scan, strict=True):
            joined = np.hypot(*(b - a)) <= 0.3
            for f in np.linspace(0.0, 1.0, 101) if joined else (0.0,):
                apart = min(apart, math.hypot(*(a + f * (b - a) - point)))
        if abs(apart - reach) > 2e-3:
            assert said == (apart < reach)


# --- what is remembered


def test_it_is_still_there_when_the_camera_comes_too_near_to_see_it():
    thing = Shapes(block(1.0))
    into = seen(thing)
    kept = into.surfaces_m
    face = kept[kept[:, 0] < 1.02]
    assert face[:, 0] == pytest.approx(1.0, abs=0.03)
    assert (face[:, 1].min(), face[:, 1].max()) == pytest.approx((-0.3, 0.3), abs=0.05)
    for x in np.arange(0.05, 0.75, 0.05):
        seen(thing, 1, pose=np.array([x, 0.0, 0.0]), into=into)
    near = into.surfaces_m
    assert near[np.abs(near[:, 1]) < 0.2, 0].min() == pytest.approx(1.0, abs=0.03)


def test_two_sightings_are_needed_and_a_second_look_from_afar_does_not_move_it():
    thing = Shapes(block(1.0))
    assert len(seen(thing, 1).surfaces_m) == 0
    assert len(seen(thing, 2).surfaces_m) > 0


def test_what_has_gone_is_forgotten_once_its_place_is_seen_to_be_free():
    into = seen(Shapes(block(0.9, y=(-0.1, 0.1))))
    assert len(into.surfaces_m) > 0
    seen(Shapes(), 20, into=into)
    assert len(into.surfaces_m) == 0


def test_a_wall_that_the_scan_shows_is_left_to_it_and_a_kerb_before_it_is_not():
    y = np.linspace(-2, 2, 80)
    wall = np.stack([np.full(80, 1.5), y], axis=1)
    tall = block(1.5, top=1.0, y=(-3, 3))
    assert len(seen(Shapes(tall), scan=wall).surfaces_m) == 0
    assert len(seen(Shapes(tall)).surfaces_m) > 0
    kerb = seen(Shapes(tall, block(1.4, top=0.08, depth=0.1)), scan=wall).surfaces_m
    assert kerb[:, 0].min() == pytest.approx(1.4, abs=0.03)


def test_a_scan_of_a_moment_ago_is_moved_with_the_robot():
    """An image between two scans must know a wall that the last scan showed from elsewhere."""
    before, now = np.array([-0.05, 0.02, -0.15]), np.array([0.0, 0.0, 0.1])
    y = np.linspace(-2, 2, 80)
    wall_in_map = np.stack([np.full(80, 1.5), y], axis=1)
    wall = transform_points(between(before, ORIGIN), wall_in_map)
    tall = Shapes(block(1.5, top=1.0, y=(-3, 3)))
    assert len(seen(tall, scan=wall, pose=now, scan_pose=before).surfaces_m) == 0
    assert len(seen(tall, scan=wall, pose=now, scan_pose=now).surfaces_m) > 0


def test_what_moves_is_left_out_and_makes_what_is_remembered_fade():
    here = MoverTracks(
        0, np.arange(1), np.array([[1.1, 0.0]]), np.zeros((1, 2)), np.array([0.3]),
        np.zeros(1), np.zeros(1),
    )  # fmt: skip
    assert len(seen(Shapes(block(1.0, y=(-0.1, 0.1))), movers=here).surfaces_m) == 0
    elsewhere = replace(here, position_m=np.array([[9.0, 9.0]]))
    into = seen(Shapes(block(1.0)))
    away = np.array([0.0, 0.0, math.pi])
    seen(Shapes(), 400, pose=away, into=into)
    assert len(into.surfaces_m) > 0
    seen(Shapes(), 400, pose=away, into=into, movers=elsewhere)
    assert len(into.surfaces_m) == 0


def test_it_knows_the_way_that_it_came():
    into = low_map()
    assert not into.has_driven(ORIGIN, 0.0)
    for x in np.arange(0.0, 2.0, 0.03):
        seen(Shapes(), 1, pose=np.array([x, 0.0, 0.0]), into=into)
    there = np.array([2.0, 0.05, 0.0])
    assert into.has_driven(there, math.pi)
    assert not into.has_driven(there, 0.0)
    assert not into.has_driven(there, 0.5 * math.pi)
    assert not into.has_driven(np.array([0.3, 0.0, 0.0]), math.pi)


def test_what_is_only_guessed_is_told_apart():
    into = seen(Shapes(block(1.0, bottom=0.05, top=0.18)))
    assert into.seen_m[:, 0].max() < 1.05 < into.surfaces_m[:, 0].max()
    assert len(into.seen_m) < len(into.surfaces_m)


def test_what_is_seen_is_taken_to_be_deep():
    kept = seen(Shapes(block(1.0, bottom=0.05, top=0.18))).surfaces_m
    assert kept[:, 0].max() == pytest.approx(1.25, abs=0.05)


# --- who uses it


@given(seeds, st.integers(1, 20))
def test_a_joined_map_has_the_distances_of_both(seed, count):
    rng = np.random.default_rng(seed)
    grid = GridMap(SlamConfig())
    grid.insert(rng.uniform(-2, 2, (30, 2)), np.zeros((30, 2)), ORIGIN)
    alone, more = grid.distances().copy(), rng.uniform(-3, 3, (count, 2))
    both = grid.joined(more)
    assert np.array_equal(grid.distances(), alone)
    distance, res = both.distances(), grid.resolution_m
    rows, cols = distance.shape
    x = both.origin_m[0] + (np.arange(cols) + 0.5) * res
    y = both.origin_m[1] + (np.arange(rows) + 0.5) * res
    places = np.concatenate((grid.surfaces(), both.surfaces()))
    cells = np.stack(np.meshgrid(x, y), axis=-1)
    true = np.hypot(*np.moveaxis(cells[:, :, None] - places, -1, 0)).min(axis=2)
    # Which occupied cell is the nearest is found by the cells' middles, and not quite exactly.
    assert (np.abs(distance - true) < 2.0 * res + 0.03 * true).all()
    cell = np.floor((more - both.origin_m) / res).astype(int)
    assert both.occupied[cell[:, 1], cell[:, 0]].all()


def test_the_monitor_stops_before_what_no_scan_shows():
    monitor = monitor_of()
    scan = np.array([[3.0, 0.0]])
    monitor.observe(scan, ORIGIN)
    assert allowed(monitor, 0.4, 0.0, ORIGIN) == (0.4, 0.0)
    monitor.observe(scan, ORIGIN, np.array([[0.265, 0.1]]))
    assert allowed(monitor, 0.4, 0.0, ORIGIN)[0] < 0.1
    monitor.observe(scan, np.array([5.0, 0.0, 0.0]), np.array([[0.265, 0.1]]))
    assert allowed(monitor, 0.4, 0.0, np.array([5.0, 0.0, 0.0])) == (0.4, 0.0)


def test_a_robot_with_a_camera_turns_before_it_goes():
    """At a heading error that a robot without one takes on a curve; the settings say so."""
    half, config = 0.5 * CLEAN.fov_rad[0], Config()
    assert config.tracker.turn_on_spot_with_camera_rad < half
    assert config.smoother.lead_in_max_turn_with_camera_rad < half
    for has_camera, mode in ((False, Mode.FOLLOW), (True, Mode.TURN)):
        tracker = tracker_to((9.0, 9.0), has_camera=has_camera)
        tracker.follow(smooth([(0, 0), (3.0, 0.0)], (0, 0, 0)), K)
        assert tracker.velocity(at_pose(0.5, 0.0, 0.6))[1] is mode


@pytest.mark.parametrize(("bottom", "stands"), [(0.0, True), (0.15, True), (0.3, False)])
def test_what_hangs_higher_than_the_robot_is_not_on_the_floor_plan(bottom, stands):
    thing = Obstacle("cylinder", (1.0, 0.0), (0.3,), height_m=0.1, bottom_m=bottom)
    plan = floor_plan(build("open", [thing]))
    assert any(s.name.startswith("obstacle_drawn") for s in plan.sections) == stands


def test_a_camera_out_of_step_or_that_cannot_see_is_refused():
    with pytest.raises(ValidationError, match=r"camera\.period_s .* rates\.control_s"):
        Config(camera=CameraConfig(enabled=True, period_s=0.105))
    assert Config(camera=CameraConfig(period_s=0.105)).rates == RatesConfig()
    with pytest.raises(ValidationError, match=r"camera\.period_s .* watchdog\.image_s"):
        Config(camera=CameraConfig(enabled=True, period_s=0.5))
    with pytest.raises(ValidationError, match=r"camera\.range_min_m .* camera\.range_max_m"):
        CameraConfig(range_min_m=2.0, range_max_m=1.0)


# --- the whole loop


def test_without_the_camera_it_collides_and_with_it_arrives():
    blind = Simulation(load("low", ["camera.enabled=false"], seed=0)).run()
    assert blind.outcome == "collision"
    heard = []
    run = Simulation(load("low", seed=0), listeners=[heard.append]).run()
    assert run.outcome == "reached"
    assert run.metrics["contact_count"] == 0
    images = [m for m in heard if isinstance(m, DepthImage)]
    assert [i.t_ns for i in images[:2]] == [100_000_000, 200_000_000]
    assert max(len(m.surfaces_m) for m in heard if isinstance(m, LowObstacles)) > 20
    again = Simulation(load("low", seed=0)).run()
    assert again.metrics["state_hash"] == run.metrics["state_hash"]


def walls_round(x0, y0, x1, y1):
    """The setting for four walls, 0.35 m high, round a rectangle."""
    x, y, wide, deep = 0.5 * (x0 + x1), 0.5 * (y0 + y1), x1 - x0, y1 - y0
    walls = [(x, y0, wide, 0.1), (x, y1, wide, 0.1), (x0, y, 0.1, deep), (x1, y, 0.1, deep)]
    text = ",".join(
        f'{{shape="box",position_m=[{px},{py}],size_m=[{length},{width}]}}'
        for px, py, length, width in walls
    )
    return f"obstacles=[{text}]"


@pytest.mark.parametrize("period_s", [0.1, 0.05])
def test_walls_that_the_lidar_sees_are_no_low_obstacles(period_s):
    """Every second image of 0.05 s comes without a scan; the last one still tells of the walls."""
    heard = []
    camera = ["camera.enabled=true", f"camera.period_s={period_s}"]
    room = [walls_round(-1.0, -1.5, 2.6, 1.5), "goal=[1.8,0.6]", *camera]
    run = Simulation(load("open", room, seed=0), listeners=[heard.append]).run()
    assert run.outcome == "reached"
    told = [m for m in heard if isinstance(m, LowObstacles)]
    assert len(told) > 30
    assert max(len(m.surfaces_m) for m in told) == 0


def test_without_images_it_stops_and_goes_on_when_they_come_again():
    heard = []
    fault = ['faults=[{kind="camera_silent", at_s=3.0, for_s=3.0}]']
    run = Simulation(load("low", fault, seed=3), listeners=[heard.append]).run()
    assert run.outcome == "reached"
    speeds = [(m.t_ns, abs(m.velocity_body[0])) for m in heard if isinstance(m, Truth)]
    assert max(v for t, v in speeds if 4.2e9 < t < 6.0e9) < 0.01
    assert max(v for t, v in speeds if t < 3.0e9) > 0.3
    said = [m.text for m in heard if isinstance(m, Event) and m.text.startswith("watchdog")]
    assert said == [f"watchdog: {Stale.BLIND}, stopping", "watchdog: all is fresh again, going on"]


@pytest.mark.slow
def test_twenty_rooms_of_which_half_is_not_in_the_scans():
    blind = [Simulation(load("low", ["camera.enabled=false"], seed=s)).run() for s in range(20)]
    assert sum(run.outcome == "collision" for run in blind) >= 10
    runs = [Simulation(load("low", seed=s)).run() for s in range(20)]
    assert all(run.reached for run in runs)
    assert sum(run.metrics["contact_count"] for run in runs) == 0
