"""A made-up log for tests of replay: once round a room, with odometry that errs."""

from __future__ import annotations

import math

import numpy as np

from helpers.rooms import Room, box
from simloop.geometry.se2 import between, compose

ROOM = Room(*box(-3, -2.5, 4, 3), *box(1.0, 1.2, 1.6, 2.0), *box(-2.0, -1.8, -1.5, -1.2))


def flaser(ranges, laser, odom, t):
    text = " ".join(f"{r:.3f}" for r in ranges)
    poses = " ".join(f"{v:.6f}" for v in (*laser, *odom))
    return f"FLASER {len(ranges)} {text} {poses} {t:.6f} host {t:.6f}"


def made_up_log(n=90, beams=180):
    """Once round a room on a ring of 1 m: lines of a CARMEN log, and the truth."""
    rng = np.random.default_rng(3)
    angle = np.linspace(0, 2 * math.pi, n)
    truth = np.column_stack([np.cos(angle), np.sin(angle), angle + 0.5 * math.pi])
    odom, lines = np.zeros(3), ["# made up", "PARAM robot_frontlaser_offset 0.1 0 host 0"]
    for k, pose in enumerate(truth):
        if k:
            odom = compose(odom, between(truth[k - 1], pose) * [1.1, 1.0, 0.9])
        laser = compose(pose, np.array([0.1, 0.0, 0.0]))
        far = ROOM.ranges(laser)  # at -180, -179, ... degrees
        ranges = far[90 : 90 + beams] + 0.01 * rng.standard_normal(beams)
        ranges[~np.isfinite(ranges)] = 81.83
        lines.append(flaser(ranges, compose(odom, np.array([0.1, 0, 0])), odom, 0.2 * k))
    return lines, truth


def relations_of(truth, rng, count=60):
    pairs = np.sort(rng.integers(0, len(truth), (count, 2)), axis=1)
    rows = [[0.2 * a, 0.2 * b, *between(truth[a], truth[b])] for a, b in pairs if a < b]
    return np.array(rows)


def npz_arrays(n=90, beams=180, every=1):
    """The same log as arrays, with relations, a reference, and more odometry lines than scans.

    ``every`` thins the scans, but not the relations and the odometry lines.
    """
    lines, truth = made_up_log(n, beams)
    rows = [line.split() for line in lines if line.startswith("FLASER")]
    odom = np.array([row[beams + 5 : beams + 8] for row in rows], float)
    t_s = 0.2 * np.arange(n)
    chosen = slice(None, None, every)
    return {
        "scan_t_s": t_s[chosen],
        "scan_ranges_m": np.array([row[2 : beams + 2] for row in rows], np.float32)[chosen],
        "scan_odom_xyyaw": odom[chosen],
        "odom_t_s": t_s,
        "odom_xyyaw": odom + np.array([3.0, 0.0, 0.0]),  # in a frame of its own
        "fov_deg": np.float64(180.0),
        "laser_offset_x_m": np.float64(-0.1),
        "relations_t1_t2_dx_dy_dyaw": relations_of(truth, np.random.default_rng(2)),
        "ref_gmapping_xyyaw": truth[chosen],
    }
