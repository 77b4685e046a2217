"""Thin a log: keep a scan each so many metres or degrees, as many published logs do."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from simloop.geometry.se2 import between
from simloop.replay.laser_log import LaserLog
from simloop.replay.odometry import Odometry

_TURN_RAD = math.pi / 6.0  # the usual step of GMapping

LEAST_M, MOST_M = 0.01, 100.0
"""Least and greatest step of a thinned log, m."""


def thin(log: LaserLog, step_m: float) -> LaserLog:
    """Keep the first scan, and then each one that lies far enough from the last one kept.

    The odometry of all scans is kept, so that poses between the kept scans are still measured.

    Args:
        log: the log.
        step_m: distance by odometry after which a scan is kept, m. A turn of 30 deg is enough, too.

    Returns:
        The thinned log.
    """
    keep = [0]
    for scan in range(1, len(log.odom)):
        off = between(log.odom[keep[-1]], log.odom[scan])
        if math.hypot(off[0], off[1]) >= step_m or abs(off[2]) >= _TURN_RAD:
            keep.append(scan)
    chosen = np.array(keep)
    return replace(
        log,
        t_s=log.t_s[chosen],
        ranges_m=log.ranges_m[chosen],
        odom=log.odom[chosen],
        clocks_s=tuple(clock[chosen] for clock in log.clocks_s),
        reference=None if log.reference is None else log.reference[chosen],
        odometry=log.odometry or Odometry(log.clocks_s or (log.t_s,), log.odom),
    )
