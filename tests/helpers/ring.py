"""A ring of corridors, ways round it, odometry with errors, and the mapper on their scans."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from helpers.rooms import ANGLES, Room, box
from simloop.geometry.se2 import between, compose
from simloop.graph_slam.mapper import GraphMapper
from simloop.graph_slam.settings import MappingConfig

AHEAD = ANGLES[np.abs(ANGLES) <= 0.5 * math.pi]
# A ring of corridors about a block, with things in them that no two sides have alike.
RING = Room(
    *box(-6.0, -5.0, 6.0, 5.0),
    *box(-4.3, -3.3, 4.3, 3.3),
    *box(-2.0, -5.0, -1.2, -4.6),
    *box(2.5, -5.0, 2.7, -4.5),
    *box(5.6, -1.0, 6.0, 1.2),
    *box(1.0, 4.5, 3.2, 5.0),
    *box(-3.5, 3.3, -3.2, 3.8),
    *box(-1.5, 3.3, -0.2, 3.6),
    *box(-6.0, 0.5, -5.5, 0.9),
    *box(-4.3, -2.0, -4.1, 1.5),
)


def way_round(laps=1.25, step=0.12):
    """Poses along the ring's middle, corners cut round."""
    corners = np.array([[-5.1, -4.1], [5.1, -4.1], [5.1, 4.1], [-5.1, 4.1]])
    pieces = [[0.0, -4.1], *corners[1:], corners[0], [0.0, -4.1], [5.0, -4.1]]
    points = [np.array(pieces[0])]
    for a, b in pairwise(pieces):
        a, b = np.array(a), np.array(b)
        count = max(1, round(math.dist(a, b) / step))
        points += [a + (b - a) * k / count for k in range(1, count + 1)]
    points = np.array(points)
    smooth = np.array([points[max(0, i - 4) : i + 5].mean(axis=0) for i in range(len(points))])
    smooth = smooth[: round(len(smooth) * laps / 1.25)]
    heading = np.arctan2(*np.gradient(smooth, axis=0).T[::-1])
    return np.column_stack([smooth, heading])


def wheels(poses, rng, bias=0.0, noise=0.03):
    """Raw odometry: each step off by some percent, and turned by a bias a metre."""
    out = [np.array([1.0, 2.0, 0.5])]
    for a, b in pairwise(poses):
        motion = between(a, b) * (1.0 + noise * rng.standard_normal(3))
        motion[2] += bias * math.hypot(*motion[:2])
        out.append(compose(out[-1], motion))
    return np.array(out)


def mapped(poses, odometry, room=RING, seed=0, angles=AHEAD, config=None):
    rng, mapper = (
        np.random.default_rng(seed),
        GraphMapper(config or MappingConfig(), start=poses[0]),
    )
    for pose, odom in zip(poses, odometry, strict=True):
        points = room.hits(pose, rng, angles=angles)
        mapper.step(points, np.zeros_like(points), odom)
    mapper.finish()
    return mapper


def rms(found, true):
    return math.sqrt(np.mean(np.sum((found - true)[:, :2] ** 2, axis=1)))
