"""The grid: it grows over all that a scan touches, and drops its distances when it does."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from simloop.config import SlamConfig
from simloop.mapping.grid_kernels import Evidence, GridLayers, trace_scan
from simloop.mapping.grid_map import NOWHERE_M, GridMap

CONFIG = SlamConfig()
NEAR = np.array([[0.3, 0.0], [0.0, 0.3], [-0.3, -0.2]])
INSERT_FROM_AFAR = """
import numpy as np
from simloop.config import SlamConfig
from simloop.mapping.grid_map import GridMap

grid = GridMap(SlamConfig())
points = np.array([[0.3, 0.0], [0.0, 0.3], [-0.3, -0.2]])
for offset in ([5.0, 0.0], [-5.0, 0.0], [0.0, 5.0], [0.0, -5.0]):
    grid.insert(points, points * 0.01 + offset, np.zeros(3))
"""


@pytest.mark.parametrize("offset_m", [(1.5, 0.0), (-1.5, 0.0), (0.0, 1.5), (0.0, -1.5), (-4, 4)])
@pytest.mark.parametrize("yaw", [0.0, 1.0])
def test_the_grid_reaches_over_the_beams_origins_too(offset_m, yaw):
    """A laser mounted far off: beams begin outside the box of their hits."""
    grid, pose = GridMap(CONFIG), np.array([2.0, -3.0, yaw])
    grid.insert(NEAR, np.zeros_like(NEAR) + offset_m, pose)
    cos, sin = np.cos(yaw), np.sin(yaw)
    laser = pose[:2] + np.array([[cos, -sin], [sin, cos]]) @ offset_m
    size = grid.resolution_m * np.array(grid.log_odds.shape[::-1])
    assert np.all(laser >= grid.origin_m) and np.all(laser <= grid.origin_m + size)
    col, row = np.floor((laser - grid.origin_m) / grid.resolution_m).astype(int)
    assert grid.log_odds[row, col] < 0.0


def test_no_index_leaves_the_grid_with_a_laser_mounted_far_off(tmp_path):
    """numba's own check of bounds; a cache of its own, so that no other process gets that code."""
    env = {**os.environ, "NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", INSERT_FROM_AFAR], env=env, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def _empty_grid(rows=40, cols=40):
    return (
        np.zeros((rows, cols), np.float32),
        np.zeros((rows, cols, 3)),
        np.zeros((rows, cols), np.int32),
        np.zeros((rows, cols), np.bool_),
    )


@pytest.mark.parametrize(
    ("point", "origin"),
    [
        ((9.0, 0.0), (1.0, 1.0)),
        ((1.0, 1.0), (-9.0, 0.0)),
        ((np.nan, 1.0), (1.0, 1.0)),
        ((1.0, 1.0), (1.0, np.inf)),
    ],
)
def test_the_kernel_leaves_out_beams_that_leave_the_grid(point, origin):
    """In plain Python an index out of range raises, or writes at the other end."""
    grid = _empty_grid()
    surfaces, share = trace_scan.py_func(
        np.array([point]), np.array([origin]), np.zeros(1, np.bool_), np.zeros(3),
        (0.0, 0.0), 0.05, GridLayers(*grid), 1, Evidence(1.0, 0.5, 5.0, 0.5),
    )  # fmt: skip
    assert len(surfaces) == 0 and share == 0.0
    for layer in grid:
        assert not layer.any()


@pytest.mark.parametrize("through", [False, True])
def test_a_scan_without_beams_leaves_the_distances_as_they_belong(through):
    """It may make the grid grow; distances of the old extent must not be seen any more."""
    grid = GridMap(CONFIG)
    grid.insert(NEAR, np.zeros_like(NEAR), np.zeros(3))
    before, origin = grid.distances(), grid.origin_m.copy()
    empty = np.empty((0, 2))
    grid.insert(empty, empty, np.array([-9.0, -9.0, 0.0]), np.full(0, through))
    assert np.all(grid.origin_m < origin)
    after = grid.distances()
    assert after.shape == grid.log_odds.shape != before.shape
    rows, cols = np.nonzero(grid.occupied)
    assert np.all(after[rows, cols] < grid.resolution_m)


def test_an_empty_grid_has_nothing_near():
    grid = GridMap(CONFIG)
    empty = np.empty((0, 2))
    surfaces, share = grid.insert(empty, empty, np.zeros(3))
    assert surfaces.shape == (0, 2) and share == 0.0
    assert np.all(grid.distances() == NOWHERE_M)
