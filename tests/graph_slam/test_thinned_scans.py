"""Logs that keep a scan each metre: the way along corridors, and odometry that lies."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from helpers.ring import mapped, rms, way_round, wheels
from helpers.rooms import ANGLES, Room

from simloop.geometry.se2 import between, compose


def thinned(poses, apart):
    keep = [0]
    for k in range(1, len(poses)):
        off = between(poses[keep[-1]], poses[k])
        if math.hypot(off[0], off[1]) >= apart or abs(off[2]) >= math.pi / 6:
            keep.append(k)
    return poses[keep]


@pytest.mark.parametrize("apart", [0.5, 1.0])
def test_a_ring_is_round_with_few_scans(apart):
    poses = thinned(way_round(step=0.06), apart)
    odometry = wheels(poses, np.random.default_rng(3), bias=0.02)
    mapper = mapped(poses, odometry)
    assert rms(mapper.trajectory(), poses) < 0.06


@pytest.mark.parametrize("step", [0.5, 1.0])
def test_a_corridor_keeps_its_length(step):
    """Scans of new ground must not be slid back onto the ground that is known."""
    corridor = Room((-40, -1, 40, -1), (-40, 1, 40, 1))
    count = round(8.0 / step) + 1
    poses = np.column_stack([step * np.arange(count), np.zeros(count), np.zeros(count)])
    mapper = mapped(poses, poses, corridor)
    assert mapper.trajectory()[-1][0] == pytest.approx(8.0, abs=0.05)


def test_counters_without_a_sign_do_not_lead_astray():
    """The robot goes to and fro; odometry always says forward."""
    along = way_round(laps=0.5, step=0.06)
    poses = thinned(np.concatenate([along[:90], along[90:40:-1], along[40:]]), 0.5)
    odometry = [np.zeros(3)]
    for a, b in pairwise(poses):
        motion = between(a, b)
        odometry.append(compose(odometry[-1], np.array([abs(motion[0]), *motion[1:]])))
    mapper = mapped(poses, np.array(odometry), angles=ANGLES)
    assert rms(mapper.trajectory(), poses) < 0.06
