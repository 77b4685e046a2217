"""What of a log is kept, which of its ranges mean surfaces, and which of its clocks counts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.replay.laser_log import LaserLog, clean_log, usable_range_m
from simloop.replay.relations import times_on_relations_clock

times = st.one_of(st.floats(0.0, 5.0), st.sampled_from([math.nan, math.inf, 1.0, 2.0]))


def log_of(t_s, ranges=None, odom=None, clocks=()) -> LaserLog:
    """A log of three beams, cleaned."""
    t_s = np.array(t_s, float)
    n = len(t_s)
    ranges = np.ones((n, 3)) if ranges is None else np.array(ranges, float)
    odom = np.zeros((n, 3)) if odom is None else np.array(odom, float)
    angles = np.array([-1.0, 0.0, 1.0])
    return clean_log(t_s, ranges, angles, odom, np.zeros(3), "x", None, 0, tuple(clocks))


@given(st.lists(times, min_size=1, max_size=12))
def test_times_advance_and_every_scan_is_kept_or_counted(t_s):
    try:
        log = log_of(t_s)
    except InputError:
        assert not any(math.isfinite(t) for t in t_s)
        return
    assert (np.diff(log.t_s) > 0.0).all()
    assert len(log.t_s) + log.skipped == len(t_s)
    # A scan is dropped only for its own time or for an earlier scan's.
    finite = [t for t in t_s if math.isfinite(t)]
    assert log.t_s.tolist() == [t for k, t in enumerate(finite) if t > max(finite[:k], default=-1)]


def test_scans_without_odometry_are_dropped_and_ranges_that_mean_nothing_are_inf():
    log = log_of(
        [0.0, 1.0],
        ranges=[[1.0, 2.0, 3.0], [math.nan, -1.0, 0.0]],
        odom=[[0.0, math.nan, 0.0], [0.0, 0.0, 0.0]],
        clocks=[np.array([10.0, 11.0])],
    )
    assert log.t_s.tolist() == [1.0] and log.skipped == 1
    assert np.isinf(log.ranges_m).all()
    assert log.clocks_s[0].tolist() == [11.0]
    with pytest.raises(InputError, match="no finite range"):
        usable_range_m(log)


def test_a_greatest_range_that_repeats_means_that_nothing_came_back():
    ranges = np.linspace(1.0, 5.0, 30).reshape(10, 3)
    once = log_of(range(10), ranges=ranges)
    assert usable_range_m(once) == 5.0
    ranges[:5, 0] = 8.19
    assert 5.0 < usable_range_m(log_of(range(10), ranges=ranges)) < 8.19


def test_the_clock_in_which_most_relations_lie_is_taken():
    log = log_of([0.0, 1.0, 2.0], clocks=[np.array([100.0, 101.0, 102.0])])
    late = np.array([[100.5, 101.5, 0.0, 0.0, 0.0], [101.0, 102.0, 0.0, 0.0, 0.0]])
    assert times_on_relations_clock(log, late).tolist() == [100.0, 101.0, 102.0]
    assert times_on_relations_clock(log, late - [100.0, 100.0, 0, 0, 0]).tolist() == [0.0, 1.0, 2.0]
    # A clock that does not rise cannot order the poses.
    stuck = log_of([0.0, 1.0, 2.0], clocks=[np.array([100.0, 100.0, 102.0])])
    assert times_on_relations_clock(stuck, late).tolist() == [0.0, 1.0, 2.0]
