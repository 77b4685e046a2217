"""Surfaces that beams should have measured, against a plain walk along each beam."""

from __future__ import annotations

import math

import numpy as np

from simloop.mapping.echoes import unanswered_surfaces

RESOLUTION, CORNER = 0.05, (-1.0, -2.0)


def walked(ends, origins, pose, occupied):
    """First occupied cell of each beam, in half cells, up to two cells before its end."""
    found = []
    turn = np.array(
        [[math.cos(pose[2]), -math.sin(pose[2])], [math.sin(pose[2]), math.cos(pose[2])]]
    )
    for end, origin in zip(ends, origins, strict=True):
        a = (turn @ origin + pose[:2] - CORNER) / RESOLUTION
        b = (turn @ end + pose[:2] - CORNER) / RESOLUTION
        length = math.dist(a, b)
        for k in range(1, math.floor(2.0 * (length - 2.0)) + 1):
            col, row = np.floor(a + 0.5 * k / length * (b - a)).astype(int)
            inside = 0 <= row < occupied.shape[0] and 0 <= col < occupied.shape[1]
            if inside and occupied[row, col]:
                found.append((row, col))
                break
    return found


def test_the_kernel_walks_as_the_plain_one_does():
    rng = np.random.default_rng(5)
    for _ in range(20):
        occupied = rng.random((60, 80)) < 0.02
        stamp = rng.integers(0, 50, occupied.shape).astype(np.int32)
        angles = rng.uniform(-math.pi, math.pi, 30)
        reach = rng.uniform(0.02, 6.0, (30, 1))
        ends = reach * np.stack((np.cos(angles), np.sin(angles)), axis=1)
        origins = rng.normal(0.0, 0.02, ends.shape)
        pose = np.array([*rng.uniform(-1.5, 2.5, 2), rng.uniform(-3, 3)])
        places, stamps = unanswered_surfaces(
            ends, origins, pose, CORNER, RESOLUTION, occupied, stamp
        )
        cells = walked(ends, origins, pose, occupied)
        cols, rows = np.floor((places - CORNER) / RESOLUTION + 1e-9).astype(int).T
        assert len(places) == len(cells)
        assert all(
            abs(r - row) <= 1 and abs(c - col) <= 1
            for r, c, (row, col) in zip(rows, cols, cells, strict=True)
        )
        assert stamps.tolist() == [stamp[cell] for cell in cells]


def test_beams_that_are_not_finite_or_too_short_meet_nothing():
    occupied, stamp = np.ones((20, 20), bool), np.zeros((20, 20), np.int32)
    ends = np.array([[np.nan, 1.0], [np.inf, 0.0], [0.05, 0.0], [0.0, 0.0]])
    for pose in (np.array([-0.5, -1.5, 0.0]), np.full(3, np.nan)):
        places, _ = unanswered_surfaces(
            ends, np.zeros((4, 2)), pose, CORNER, RESOLUTION, occupied, stamp
        )
        assert len(places) == 0
