"""Map and matcher: what a scan enters, where a scan fits, and how sure a fit may be."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.rooms import ANGLES, Room
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.config import SlamConfig
from simloop.geometry.se2 import wrap_angle
from simloop.mapping.grid_kernels import Evidence, GridLayers, placed_bounds, trace_scan
from simloop.mapping.scan_match import refine, surface_at
from simloop.messages import LidarScan
from simloop.slam_grid import GridSlam

CONFIG = SlamConfig()
EVIDENCE = Evidence(
    CONFIG.hit_log_odds, CONFIG.miss_log_odds, CONFIG.max_log_odds, CONFIG.occupied_log_odds
)
LASER = np.zeros(3)
seeds = st.integers(0, 2**32 - 1)


WALL = 2.02  # in the middle of a cell
SQUARE = Room(
    (-WALL, -WALL, WALL, -WALL),
    (WALL, -WALL, WALL, WALL),
    (WALL, WALL, -WALL, WALL),
    (-WALL, WALL, -WALL, -WALL),
    (0.5, 1, 1, 0.7),
)
# Far longer than the laser reaches, and nothing in it: along x all places look alike.
CORRIDOR = Room((-40, -0.8, 40, -0.8), (-40, 0.8, 40, 0.8))


def mapped(room, poses, seed=0, config=CONFIG) -> GridSlam:
    slam, rng = GridSlam(config, LASER), np.random.default_rng(seed)
    for i, pose in enumerate(poses):
        slam.insert(room.scan(np.array(pose, float), rng, i), np.array(pose, float))
    return slam


def match(slam, room, true, prior, seed=1, sd=0.01):
    scan = room.scan(np.array(true, float), np.random.default_rng(seed), 10**9)
    prior = np.array(prior, float)
    covariance = np.diag([sd**2, sd**2, (0.5 * sd) ** 2])
    return slam.match(scan, np.array([10**9]), prior[None], prior, covariance)


def plain_trace(points, origins, through, pose, grid, number, config=CONFIG):
    """The oracle: every cell that a beam's segment crosses, found cell by cell."""
    x0, y0, odds, hits, stamp, occupied = grid
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    rotation = np.array([[cos, -sin], [sin, cos]])
    ends = points @ rotation.T + pose[:2] - [x0, y0]
    starts = origins @ rotation.T + pose[:2] - [x0, y0]
    before = occupied.copy()
    for x, y in ends[~through]:
        cell = (math.floor(y / config.resolution_m), math.floor(x / config.resolution_m))
        hits[cell] += (x, y, 1.0)
        if stamp[cell] != number:
            stamp[cell] = number
            odds[cell] = min(config.max_log_odds, odds[cell] + config.hit_log_odds)
    beams = zip(starts / config.resolution_m, ends / config.resolution_m, through, strict=True)
    for a, b, met_nothing in beams:
        length = math.dist(a, b)
        last = length if met_nothing else length - 2.0
        if last < 1.0:
            continue
        direction = (b - a) / length
        # Cut the segment where it crosses the grid's lines; each piece lies in one cell.
        cuts = [0.0]
        for axis in (0, 1):
            if direction[axis] != 0.0:
                low, high = sorted((a[axis], b[axis]))
                lines = np.arange(math.ceil(low), math.floor(high) + 1)
                cuts += [t for t in (lines - a[axis]) / direction[axis] if 0 < t < length]
        cuts = sorted(cuts)
        for start, end in zip(cuts, [*cuts[1:], length], strict=True):
            if start >= last:
                break
            middle = a + 0.5 * (start + end) * direction
            cell = (math.floor(middle[1]), math.floor(middle[0]))
            if stamp[cell] != number:
                stamp[cell] = number
                lower = odds[cell] - np.float32(config.miss_log_odds)
                odds[cell] = max(-config.max_log_odds, lower)
                if odds[cell] < 0.0:
                    hits[cell] = 0.0
    occupied[:] = odds > config.occupied_log_odds
    rows, cols = np.nonzero(occupied & ~before)
    return {
        (x0 + hits[r, c, 0] / hits[r, c, 2], y0 + hits[r, c, 1] / hits[r, c, 2])
        for r, c in zip(rows, cols, strict=True)
    }


def cells_of(points, pose, corner):
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    placed = points @ np.array([[cos, sin], [-sin, cos]]) + pose[:2] - corner
    return len({tuple(cell) for cell in np.floor(placed / CONFIG.resolution_m)})


@given(seeds)
@settings(max_examples=15)
def test_tracing_a_scan_is_what_the_plain_twin_does(seed):
    rng = np.random.default_rng(seed)
    shape, x0, y0 = (80, 80), -1.9, -2.0

    def empty():
        return (
            np.zeros(shape, np.float32),
            np.zeros((*shape, 3)),
            np.zeros(shape, np.int32),
            np.zeros(shape, np.bool_),
        )

    fast, slow = empty(), empty()
    for number in range(1, 6):
        pose = np.array([*rng.uniform(-0.2, 0.2, 2), rng.uniform(-3, 3)])
        points = rng.uniform(-1.0, 1.0, (40, 2))
        origins = rng.uniform(-0.02, 0.02, (40, 2))
        through = rng.random(40) < rng.choice([0.0, 0.3])
        odds, hits, stamp, occupied = fast
        found, share = trace_scan(
            points, origins, through, pose, (x0, y0), CONFIG.resolution_m,
            GridLayers(odds, hits, stamp, occupied), number, EVIDENCE,
        )  # fmt: skip
        expected = plain_trace(points, origins, through, pose, (x0, y0, *slow), number)
        np.testing.assert_allclose(odds, slow[0], atol=1e-5)
        np.testing.assert_allclose(hits, slow[1], atol=1e-9)
        np.testing.assert_array_equal(occupied, slow[3])
        assert len(found) == len(expected)
        assert share == pytest.approx(len(expected) / cells_of(points[~through], pose, (x0, y0)))
        if expected:
            np.testing.assert_allclose(sorted(map(tuple, found)), sorted(expected), atol=1e-9)


@given(seeds)
@settings(max_examples=30)
def test_bounds_of_placed_points(seed):
    rng = np.random.default_rng(seed)
    points, pose = rng.normal(size=(20, 2)), rng.normal(size=3)
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    placed = points @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]
    expected = [*placed.min(axis=0), *placed.max(axis=0)]
    assert placed_bounds(points, pose) == pytest.approx(expected, abs=1e-12)


def plain_refine_step(points, pose, slam):
    """One Gauss-Newton step with every surface found anew: the oracle of the cached one."""
    h, g, surface = np.zeros((3, 3)), np.zeros(3), np.empty(5)
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    for x, y in points:
        arm = np.array([cos * x - sin * y, sin * x + cos * y])
        place = pose[:2] + arm - slam.origin_m
        col, row = (math.floor(v / slam.resolution_m) for v in place)
        if not (0 <= row < slam.occupied.shape[0] and 0 <= col < slam.occupied.shape[1]):
            continue
        if not surface_at(row, col, slam.grid.hits, CONFIG.grain_m, slam.resolution_m, surface):
            continue
        off = place - surface[:2]
        inverse = np.array([[surface[2], surface[3]], [surface[3], surface[4]]])
        weight = 1.0 / (1.0 + off @ inverse @ off / 9.0) ** 2
        jacobian = np.array([[1.0, 0.0, -arm[1]], [0.0, 1.0, arm[0]]])
        h += weight * jacobian.T @ inverse @ jacobian
        g += weight * jacobian.T @ inverse @ off
    step = np.linalg.solve(h + 1e-9 * np.eye(3), g)
    return np.array([*(pose - step)[:2], wrap_angle(pose[2] - step[2])]), step


def test_refinement_is_gauss_newton_with_every_surface_found_anew():
    slam = mapped(SQUARE, [(0, 0, 0)] * 3)
    scan = SQUARE.scan(np.array([0.02, -0.01, 0.02]), np.random.default_rng(5))
    points = np.stack((scan.ranges_m * np.cos(ANGLES), scan.ranges_m * np.sin(ANGLES)), axis=1)
    pose = np.zeros(3)
    for _ in range(CONFIG.refine_steps):
        pose, step = plain_refine_step(points, pose, slam)
        if abs(step[0]) + abs(step[1]) < 1e-4 and abs(step[2]) < 1e-4:
            break
    fast, *_ = refine(
        points, np.zeros(3), slam.grid.hits, *slam.origin_m, slam.resolution_m, CONFIG.grain_m,
        CONFIG.refine_steps,
    )  # fmt: skip
    np.testing.assert_allclose(fast, pose, atol=1e-9)


def test_a_scan_finds_its_place_to_a_fraction_of_a_cell():
    slam = mapped(SQUARE, [(0, 0, 0)] * 3)
    for seed in range(5):
        fix = match(slam, SQUARE, (0.05, -0.03, 0.02), (0.03, -0.02, 0.01), seed)
        assert fix.ok
        assert fix.pose == pytest.approx([0.05, -0.03, 0.02], abs=6e-3)


def test_the_grain_of_the_cells_is_added_to_what_every_fix_leaves_open():
    found = []
    for xy, yaw in ((1e-4, 1e-4), (0.01, 0.004)):
        config = replace(CONFIG, match_std_xy_m=xy, match_std_yaw_rad=yaw)
        slam = mapped(SQUARE, [(0, 0, 0)] * 3, config=config)
        found.append(match(slam, SQUARE, (0.05, -0.03, 0.02), (0.03, -0.02, 0.01)).covariance)
    added = np.square([0.01, 0.01, 0.004]) - 1e-8
    np.testing.assert_allclose(found[1] - found[0], np.diag(added), atol=1e-9)


def test_a_bad_prior_is_corrected_by_the_search():
    slam = mapped(SQUARE, [(0, 0, 0)] * 3)
    fix = match(slam, SQUARE, (0, 0, 0), (0.12, -0.1, 0.08), sd=0.1)
    assert fix.ok
    assert fix.pose == pytest.approx([0, 0, 0], abs=8e-3)


def test_a_scan_is_deskewed_by_the_ages_of_its_beams():
    """The robot moves and turns during the sweep; seen from its end, the walls are straight."""
    start, end, t_ns = np.array([-0.2, 0.1, 0.1]), np.array([0.1, -0.1, 0.6]), 500_000_000
    age_ns = np.arange(359, -1, -1, dtype=np.int64) * 277_777
    poses = end + (start - end) * (age_ns / 1e8)[:, None]
    ranges = np.array([SQUARE.ranges(pose)[i] for i, pose in enumerate(poses)])
    scan = LidarScan(t_ns, ANGLES, ranges, age_ns, 0.15, 12.0)
    sweep_ns = t_ns - np.arange(10, -1, -1) * 10_000_000
    poses_in_sweep = end + (start - end) * ((t_ns - sweep_ns) / 1e8)[:, None]
    slam = GridSlam(CONFIG, LASER)
    slam.match(scan, sweep_ns, poses_in_sweep, end, 1e-6 * np.eye(3))
    slam.insert(scan, end)
    cos, sin = math.cos(end[2]), math.sin(end[2])
    points = slam.points_m @ np.array([[cos, sin], [-sin, cos]]) + end[:2]
    on_plank = np.abs((points - [0.5, 1.0]) @ [0.3, 0.5]) < 1e-6
    assert on_plank.sum() > 10
    np.testing.assert_allclose(np.abs(points[~on_plank]).max(axis=1), WALL, atol=1e-6)


def test_a_scan_of_another_place_does_not_fit():
    slam = mapped(SQUARE, [(0, 0, 0)] * 3)
    elsewhere = Room((0.6, -3, 0.6, 3), (-0.9, -3, -0.9, 3))
    assert not match(slam, elsewhere, (0, 0, 0), (0, 0, 0)).ok


def test_a_scan_that_scatters_about_its_surfaces_does_not_fit():
    """Each point has a surface nearby but is off by twice the grain: a strict gate refuses it."""
    ranges = SQUARE.ranges(np.zeros(3)) + 0.02 * np.random.default_rng(3).choice([-1.0, 1.0], 360)
    scan = LidarScan(10**9, ANGLES, ranges, np.zeros(360, np.int64), 0.15, 12.0)
    for most, ok in ((5.0, True), (2.0, False)):
        slam = mapped(SQUARE, [(0, 0, 0)] * 3, config=replace(CONFIG, most_residual=most))
        fix = slam.match(scan, np.array([10**9]), np.zeros((1, 3)), np.zeros(3), 1e-4 * np.eye(3))
        assert fix.ok == ok and fix.score > 0.95


@pytest.mark.parametrize("yaw", [0.0, 0.6, math.pi / 2])
def test_along_a_bare_corridor_the_match_does_not_pretend_to_know(yaw):
    """The corridor is laid at ``yaw``; one direction of the fix must stay all but open."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    ends = CORRIDOR.segments.reshape(-1, 2) @ np.array([[cos, sin], [-sin, cos]])
    room = Room(*ends.reshape(-1, 4))
    along, across = np.array([cos, sin]), np.array([-sin, cos])
    start = np.array([0.0, 0.0, yaw])
    slam = mapped(room, [start] * 3)
    off = 0.04
    fix = match(slam, room, start, [*(off * along), yaw], sd=0.05)
    assert fix.ok
    # What a filter that was unsure by 5 cm believes after it: as before along, but not across.
    before = np.diag([0.05**2, 0.05**2, 0.025**2])
    after = np.linalg.inv(np.linalg.inv(before) + np.linalg.inv(fix.covariance))[:2, :2]
    assert math.sqrt(across @ after @ across) < 0.01
    assert math.sqrt(along @ after @ along) > 0.048
    assert abs(across @ fix.pose[:2]) < 0.006


def test_the_end_of_a_corridor_holds_the_match_along_it():
    room = Room(*CORRIDOR.segments, (2.52, -0.8, 2.52, 0.8))
    slam = mapped(room, [(0, 0, 0)] * 3)
    fix = match(slam, room, (0, 0, 0), (0.02, 0.01, 0.005))
    assert fix.ok
    assert fix.pose[:2] == pytest.approx([0, 0], abs=6e-3)
    assert math.sqrt(fix.covariance[0, 0]) < 0.01


def test_new_surfaces_are_returned_once():
    slam = GridSlam(CONFIG, LASER)
    scan = SQUARE.scan(np.zeros(3), np.random.default_rng(0), 0)
    first, share = slam.insert(scan, np.zeros(3))
    assert share == 1.0
    assert len(first) > 200
    assert np.abs(np.abs(first).max(axis=1) - WALL).max() < 1.4  # walls, and the plank at 0.5-1
    again, share = slam.insert(SQUARE.scan(np.zeros(3), None, 7), np.zeros(3))
    assert len(again) < 0.2 * len(first) and share < 0.3
    post = Room(*SQUARE.segments, (-1.02, -0.2, -1.02, 0.2))
    seen = []
    for i in range(3):
        seen.append(slam.insert(post.scan(np.zeros(3), None, 8 + i), np.zeros(3))[0])
    seen = np.concatenate(seen)
    on_post = (np.abs(seen[:, 0] + 1.02) < 0.03) & (np.abs(seen[:, 1]) < 0.23)
    assert on_post.sum() >= 6
    assert len({tuple(np.round(p, 2)) for p in seen[on_post]}) == on_post.sum()


@pytest.mark.parametrize("off_m", [0.0, 0.01, 0.02, 0.025, 0.03, 0.04])
def test_a_wall_stays_where_it_is_wherever_the_cells_lie(off_m):
    """If beams voted the near half of the noise free, walls would recede from the robot."""
    x = 2.0 + off_m
    room = Room((x, -0.6, x, 0.6), (-x, -0.6, -x, 0.6))
    slam = mapped(room, [(0, 0, 0)] * 30, seed=3)
    hits = slam.grid.hits
    sums = hits[..., 0] + slam.origin_m[0] * hits[..., 2]
    columns = slam.origin_m[0] + slam.resolution_m * (np.arange(hits.shape[1]) + 0.5)
    for side in (-1.0, 1.0):
        about = np.abs(columns - side * x) < 3.0 * slam.resolution_m
        mean = sums[:, about].sum() / hits[:, about, 2].sum()
        assert mean == pytest.approx(side * x, abs=1e-3)


def test_the_grid_grows_and_keeps_what_it_holds():
    slam = mapped(SQUARE, [(0, 0, 0)])
    rows, cols = np.nonzero(slam.occupied)
    before = {tuple(p) for p in np.round(np.stack((cols, rows), 1) * 0.05 + slam.origin_m, 6)}
    far = Room(*SQUARE.segments, (5.0, -1.0, 5.0, 1.0))
    slam.insert(far.scan(np.array([4.0, 0.0, 0.0]), None, 5), np.array([4.0, 0.0, 0.0]))
    rows, cols = np.nonzero(slam.occupied)
    after = {tuple(p) for p in np.round(np.stack((cols, rows), 1) * 0.05 + slam.origin_m, 6)}
    assert len(before & after) > 0.9 * len(before)
    np.testing.assert_array_equal(slam.occupied, slam.log_odds > CONFIG.occupied_log_odds)


def test_the_planners_distances_are_those_to_the_surfaces():
    slam = mapped(SQUARE, [(0, 0, 0)] * 3)
    view = slam.view(0, np.array([1.0, 1.0]))
    rows, cols = np.nonzero(slam.occupied)
    hits = slam.grid.hits[rows, cols]
    places = hits[:, :2] / hits[:, 2:] + slam.origin_m
    rng = np.random.default_rng(0)
    for row, col in rng.integers(0, min(slam.occupied.shape), (100, 2)):
        centre = slam.origin_m + (np.array([col, row]) + 0.5) * slam.resolution_m
        nearest = np.hypot(*(places - centre).T).min()
        # The nearest cell is found on the grid; another's hits may be a little nearer.
        assert -1e-5 <= view.distance_m[row, col] - nearest < 0.05


def test_a_view_shows_what_has_come_into_the_map_since_the_last_one():
    slam = mapped(SQUARE, [(0, 0, 0)] * 3)
    goal = np.array([1.0, 1.0])
    before = slam.view(0, goal)
    post = Room(*SQUARE.segments, (-1.02, -0.2, -1.02, 0.2))
    for i in range(3):
        slam.insert(post.scan(np.zeros(3), None, 8 + i), np.zeros(3))
    after = slam.view(1, goal)
    col, row = np.floor((np.array([-1.02, 0.0]) - slam.origin_m) / slam.resolution_m).astype(int)
    assert before.distance_m[row, col] > 0.8
    assert after.distance_m[row, col] < slam.resolution_m
    for view, there in ((before, False), (after, True)):
        discs = view.discs_xyr_m
        assert np.any(np.hypot(*(discs[:, :2] - [-1.02, 0.0]).T) <= discs[:, 2]) == there


@pytest.mark.parametrize("goal", [(9.0, 0.5), (-9.0, -8.0), (0.5, 7.0), (0.3, -0.2)])
def test_a_view_reaches_over_the_map_and_beyond_the_goal(goal):
    slam = mapped(SQUARE, [(0, 0, 0)])
    low, high = np.split(slam.view(0, np.array(goal)).bounds_m, 2)
    size = slam.resolution_m * np.array(slam.occupied.shape[::-1])
    expected = np.array([slam.origin_m, slam.origin_m + size])
    beyond = np.array(goal) + CONFIG.beyond_m * np.array([[-1.0], [1.0]])
    np.testing.assert_allclose(low, np.minimum(expected[0], beyond[0]))
    np.testing.assert_allclose(high, np.maximum(expected[1], beyond[1]))
