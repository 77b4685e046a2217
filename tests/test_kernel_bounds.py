"""Compiled kernels with any finite input: no index leaves its array.

Compiled code does not check indices. So these tests say little by themselves; ``make bounds`` runs
them with numba's own check (NUMBA_BOUNDSCHECK=1), in which an index out of bounds raises.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest

from simloop.config import SlamConfig
from simloop.control import collision_monitor, fan, separation, window
from simloop.estimation.relocalise import explained, score_everywhere
from simloop.geometry import footprint
from simloop.geometry.distance_field import Field, distance_at, footprint_clearance
from simloop.mapping.correlative import MID, TOP, raise_field, thinned
from simloop.mapping.grid_map import GridMap
from simloop.mapping.scan_match import deskew
from simloop.navigation import bezier_smoother, elastic_band, feasibility, planner_world
from simloop.perception import changes, low_obstacles, mover_tracks
from simloop.physics.arena_rays import carry_ranges
from simloop.physics.track_model import FrictionMap, friction_at
from simloop.tracker import TrackingLaw, speed_profile, track
from simloop.worlds.movers import motion

SIZES = (0.0, 1e-300, 0.049999999999999996, 1.0, 63.9, 1e4, 1e9, 2.0**31, 1e19, 1e150)
OFFSETS = np.array([-0.16, 0.0, 0.16])


def wild(rng, *shape):
    """Finite numbers of all sizes and both signs; many of them equal."""
    values = rng.choice(SIZES, shape) * rng.choice([-1.0, 1.0], shape)
    return values * np.where(rng.random(shape) < 0.5, 1.0, rng.random(shape))


def few(rng):
    return int(rng.choice([0, 1, 2, 3, 7]))


def fields(rng):
    """Distance fields with one cell, one row, one column or many cells."""
    shape = [(1, 1), (1, 9), (9, 1), (40, 30)][int(rng.integers(4))]
    distance = rng.uniform(0.0, 3.0, shape).astype(np.float32)
    return Field(distance, -1.0, -1.0, 0.05, bool(rng.random() < 0.5))


def _grid(rng):
    config = SlamConfig(max_cells=200_000)
    grid = GridMap(config)
    for _ in range(4):
        n = few(rng)
        scale = float(rng.choice([1.0, 1e3]))
        points = scale * rng.normal(size=(n, 2)) if rng.random() < 0.7 else wild(rng, n, 2)
        origins = 0.1 * rng.normal(size=(n, 2)) if rng.random() < 0.7 else wild(rng, n, 2)
        pose = wild(rng, 3) if rng.random() < 0.3 else rng.uniform(-3.0, 3.0, 3)
        grid.insert(points, origins, pose, rng.random(n) < 0.3)
        assert grid.distances().shape == grid.log_odds.shape
    grid.insert(rng.uniform(-1.0, 1.0, (30, 2)), np.zeros((30, 2)), np.zeros(3))
    points = wild(rng, 20, 2)
    grid.refine(points, wild(rng, 3))
    grid.refine(rng.uniform(-1.0, 1.0, (30, 2)), rng.uniform(-0.3, 0.3, 3))
    grid.search(points + 1.0, wild(rng, 3), np.array([0.2, 0.1]), np.ones(2))


def _search_fields(rng):
    fine = np.zeros((64, 128), np.uint8)
    levels = [np.zeros((64 // side, 128 // side), np.uint8) for side in (MID, TOP)]
    places = wild(rng, few(rng), 2)
    raise_field(places, 0.0, 0.0, 0.05, fine, *levels)
    raise_field(rng.uniform(-1.0, 8.0, (30, 2)), 0.0, 0.0, 0.05, fine, *levels)
    thinned(places, 0.05, 3)


def _deskew(rng):
    n, k = few(rng), 1 + few(rng)
    stamps = np.cumsum(rng.integers(1, 10**7, k))
    beams = rng.integers(-(10**12), 10**12, n)
    deskew(wild(rng, n), wild(rng, n), beams, np.array([0.15, 1e200]), stamps, wild(rng, k, 3),
           wild(rng, 3))  # fmt: skip


def _relocalise(rng):
    likelihood = rng.random((20, 30)).astype(np.float32)
    points = rng.uniform(-30.0, 30.0, (few(rng), 2))
    score_everywhere(wild(rng, few(rng), 2), wild(rng, few(rng), 2), wild(rng, 3), likelihood,
                     0.0, 0.0, 0.05)  # fmt: skip
    explained(points, wild(rng, 3), likelihood, 0.0, 0.0, 0.05)


def _distance_field(rng):
    field = fields(rng)
    for x, y in wild(rng, 20, 2).tolist():
        distance_at(field, x, y)
        footprint_clearance(field, x, y, math.nan, OFFSETS)
    distance_at(field, math.nan, math.inf)


def _perception(rng):
    points, laser = wild(rng, few(rng), 2), wild(rng, 2)
    mover_tracks.label_clusters(points, laser)
    ranges = changes.nearest_ranges(points, laser)
    changes.mark_moved(np.vstack([points, [laser]]), laser, ranges, np.zeros(len(points) + 1, bool))
    depth = rng.choice([0.1, 0.5, 2.0, np.inf], (1 + few(rng), 1 + few(rng))).astype(np.float32)
    slopes = np.sort(rng.uniform(-1.0, 1.0, len(depth)))[::-1].copy()
    low_obstacles.find_obstacles(depth, slopes, 0.2, np.array([0.025, 0.5, 0.25, 2.5]))
    low_obstacles.on_scan_surfaces(points, wild(rng, few(rng), 2), np.ones(len(points)), 0.3)


def _control(rng):
    points, limits = wild(rng, few(rng), 2), np.array([0.15, 0.6, 6.0, 0.245, 0.23, 0.012])
    collision_monitor.average_along_surfaces(points, 4, 0.05)
    velocities = np.array([[0.4, 0.0], [-0.4, 1.6], [0.0, 1.6], [0.0, 0.0]])
    for speed, rate in velocities.tolist():
        collision_monitor.stoppable_part(points, speed, rate, limits)
    fan.examine_fan(velocities, points, limits, 1.5)
    movers, pose = wild(rng, few(rng), 8), wild(rng, 3)
    mover_limits = np.array([*limits, 0.1])
    separation.gaps_now(pose, movers, limits[3:5])
    fan.predict_gaps(pose, np.zeros(2), velocities, movers, movers, mover_limits, np.ones(2), 1.5)
    window.brake_along(wild(rng, 2), np.array([0.01, 0.01, 0.06, 1.6]))
    footprint.near_points(points, pose, 1.0)
    footprint.room_after(points, 0.3, 0.2, 0.2, 0.2)


def _paths(rng):
    field, n = fields(rng), int(rng.integers(2, 6))
    points = (
        rng.uniform(-3.0, 3.0, (n, 2)) if rng.random() < 0.7 else np.clip(wild(rng, n, 2), -9, 9)
    )
    if rng.random() < 0.3:
        points[-1] = points[-2]
    band = elastic_band.make_room(points, field, OFFSETS, 0.26, 0.30)
    cuts = bezier_smoother.fit_corners(band, field, OFFSETS, 0.26, 0.30, 0.6, 0.01)
    samples = bezier_smoother.sample_path(band, cuts, 0.05)
    clearance = bezier_smoother.path_clearance(samples, field, OFFSETS)
    if not len(samples):
        return
    arc = np.linspace(0.0, 1.0, len(samples))
    bezier_smoother.keeps_distance(samples, arc, field, OFFSETS, 0.26, 0.1)
    feasibility.stands_in_the_way(wild(rng, few(rng), 2), samples[:, :2].copy(),
                                  samples[:, 2].copy(), clearance, 0, OFFSETS, 0.26,
                                  0.01)  # fmt: skip
    limits = np.array([0.47, 1.6, 0.4, 0.3, 0.1, 0.6, 0.3])
    profile = speed_profile(arc, samples[:, 3].copy(), clearance, 0.26, limits)
    path = np.column_stack((samples, arc, profile))
    for at in (0, len(path) - 1):
        track(wild(rng, 3), path, at, False, TrackingLaw(12.0, 5.0, 4.0, 0.8, 0.15))


def _worlds(rng):
    floor = motion.FloorField(fields(rng).distance, 0.0, 0.0, 0.05, np.array([0.0, 0.0, 2.0, 2.0]))
    for x, y in [*wild(rng, 9, 2).tolist(), (math.nan, math.nan)]:
        motion.clearance_at(floor, x, y)
    zones = np.array([[-1.0, -1.0, 1.0, 1.0, np.nan], [0.0, 0.0, 1e-300, 1e-300, np.nan]])
    image = rng.random((1 + few(rng), 1 + few(rng)))
    for x, y in [*wild(rng, 9, 2).tolist(), (1.0, 1.0), (-1.0, -1.0), (0.0, 0.0)]:
        friction_at(x, y, FrictionMap(zones, image), 0.6)
    planner_world.put_discs(fields(rng).distance, *wild(rng, 2).tolist(), 0.05, wild(rng, 3, 3))
    n = few(rng)
    carry_ranges(wild(rng, n), wild(rng, n, 3), wild(rng, n, 3), wild(rng, n, 3), np.zeros(3), 5.0)


GROUPS = (_grid, _search_fields, _deskew, _relocalise, _distance_field, _perception, _control,
          _paths, _worlds)  # fmt: skip


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of numbers that overflow in numpy
@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group.__name__[1:])
def test_finite_numbers_of_all_sizes(group):
    for seed in range(25):
        partial(group, np.random.default_rng(seed))()
