"""What of a log is kept, which of its ranges mean surfaces, and which of its clocks counts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.replay.clocks import choose_times, rising_part
from simloop.replay.laser_log import LaserLog, RawScans, ScanReader, clean_log, usable_range_m
from simloop.replay.relations import clock_of, measure_relations
from simloop.replay.unused import Unused

times = st.one_of(
    st.floats(0.0, 5.0), st.integers(0, 3).map(float), st.sampled_from([math.nan, math.inf, 1e300])
)


def log_of(t_s, ranges=None, odom=None, clocks=(), stated=math.inf) -> LaserLog:
    """A log of three beams, cleaned."""
    n = len(t_s)
    ranges = np.array(np.ones((n, 3)) if ranges is None else ranges, np.float32)
    odom = np.zeros((n, 3)) if odom is None else np.array(odom, float)
    angles = np.array([-1.0, 0.0, 1.0])
    both = tuple(np.array(clock, float) for clock in (t_s, *clocks))
    raw = RawScans(ranges, odom, both, range(n), "scan")
    return clean_log(raw, angles, np.zeros(3), "x", Unused(), None, stated)


# ---- times


def longest_rising(stamps):
    """Length of a longest strictly rising sequence, the slow way."""
    best = []
    for k, stamp in enumerate(stamps):
        before = [best[i] for i in range(k) if stamps[i] < stamp and best[i]]
        best.append(1 + max(before, default=0) if abs(stamp) <= 4e9 else 0)
    return max(best, default=0)


@given(st.lists(times, min_size=1, max_size=12))
def test_times_rise_and_no_scan_is_dropped_for_its_stamp(t_s):
    log = log_of(t_s)
    assert len(log.t_s) == len(t_s) and log.skipped == 0
    assert np.isfinite(log.t_s).all() and (np.diff(log.t_s) > 0.0).all()
    # All stamps of a clock are kept that belong to a rising sequence, and no others.
    part = rising_part(np.array(t_s))
    assert np.count_nonzero(part) == longest_rising(t_s)
    assert (np.diff(np.array(t_s)[part]) > 0.0).all()
    if log.measured:
        assert log.t_s[part].tolist() == np.array(t_s)[part].tolist()


@pytest.mark.parametrize(
    ("stamps", "logger", "expected", "note"),
    [
        ([0.0, 1.0, 2.5, 3.0], None, [0.0, 1.0, 2.5, 3.0], ""),
        ([0.0] * 4, None, [0.0, 1.0, 2.0, 3.0], "order of the file"),
        ([3.0, 2.0, 1.0, 0.0], None, [0.0, 1.0, 2.0, 3.0], "order of the file"),
        ([1.7e12, 1.8e12, 1.9e12, 2e12], None, [0.0, 1.0, 2.0, 3.0], "order of the file"),
        ([0.0] * 4, [5.0, 6.0, 8.0, 9.0], [5.0, 6.0, 8.0, 9.0], "logger's clock"),
        ([9.0, 6.0, 8.0, 9.0], [1.0] * 4, [4.5, 6.0, 8.0, 9.0], "1 of 4 of the stamps"),
        ([1.0, 1.0, 2.0, 2.0, 3.0], None, [1.0, 1.5, 2.0, 2.5, 3.0], "2 of 5 of the stamps"),
        ([1.0, 2.0, 1e6, 4.0, math.nan], None, [1.0, 2.0, 3.0, 4.0, 5.0], "2 of 5 of the stamps"),
    ],
)  # fmt: skip
def test_the_clock_that_rises_gives_the_times(stamps, logger, expected, note):
    clocks = [stamps, logger if logger is not None else [math.nan] * len(stamps)]
    found = choose_times([np.array(clock) for clock in clocks])
    np.testing.assert_allclose(found.t_s, expected)
    assert note in found.note and bool(note) == bool(found.note)
    assert found.measured == ("order of the file" not in found.note)


def test_the_clock_in_which_most_relations_lie_is_taken():
    log = log_of([0.0, 1.0, 2.0], clocks=[[100.0, 101.0, 102.0]])
    late = np.array([[100.5, 101.5], [101.0, 102.0]])
    assert log.clocks_s[clock_of(log, late)].tolist() == [100.0, 101.0, 102.0]
    assert log.clocks_s[clock_of(log, late - 100.0)].tolist() == [0.0, 1.0, 2.0]
    # A clock counts only where it rises.
    stuck = log_of([0.0, 1.0, 2.0], clocks=[[100.0, 100.0, 102.0]])
    np.testing.assert_equal(stuck.clocks_s[clock_of(stuck, late)], [100.0, math.nan, 102.0])


def test_relations_need_a_clock():
    log = log_of([math.nan] * 3)
    rows = np.array([[0.0, 1.0, 0.0, 0.0, 0.0]])
    with pytest.raises(InputError, match="no clock that rises"):
        measure_relations(log, log.odom, rows)


# ---- poses


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 1e9, -1e300, 3e5])
def test_a_scan_with_a_wrong_pose_is_left_out_and_said(wrong):
    log = log_of([0.0, 1.0, 2.0], odom=[[0.0, wrong, 0.0], [0.0] * 3, [1.0, 0.0, 0.0]])
    assert log.t_s.tolist() == [1.0, 2.0] and log.skipped == 1
    assert "1 of 3 scans" in log.notes[0] and "odometry" in log.notes[0]
    with pytest.raises(InputError, match=r"x: most of the log cannot be used: 2 of 3 .*odometry"):
        log_of([0.0, 1.0, 2.0], odom=[[0.0, math.nan, 0.0], [0.0, math.nan, 0.0], [0.0] * 3])


def test_odometry_far_from_zero_is_no_error():
    log = log_of([0.0, 1.0], odom=[[5.4e5, 5.9e6, 300.0], [5.4e5, 5.9e6, 301.0]])
    assert log.skipped == 0 and log.notes == ()


# ---- ranges


def test_ranges_that_mean_nothing_are_inf():
    log = log_of([0.0], ranges=[[math.nan, -1.0, 0.0]], clocks=[[10.0]])
    assert np.isinf(log.ranges_m).all()
    assert usable_range_m(log) == 0.0
    assert len(ScanReader(log, 30.0).points(0)[0]) == 0


def walls(rng, n=40, beams=60, most=6.0):
    """Ranges of a room, rounded as a laser does."""
    return np.round(rng.uniform(1.0, most, (n, beams)), 2)


@pytest.mark.parametrize("code", [8.0, 8.191, 31.9, 50.0, 81.83])
@pytest.mark.parametrize("glitch", [None, 1.5])
def test_a_value_for_no_echo_is_found_below_a_glitch(code, glitch):
    ranges = walls(np.random.default_rng(1))
    longest = ranges.max()
    ranges[:, :7] = code
    if glitch is not None:
        ranges[3, 9] = code * glitch
    log = log_of(np.arange(40.0), ranges=ranges)
    assert usable_range_m(log) == pytest.approx(longest)
    notes = ScanReader(log, 200.0).notes
    assert len(notes) == (glitch is not None)


def test_two_values_for_no_echo_are_found():
    ranges = walls(np.random.default_rng(2))
    ranges[:, :7], ranges[:5, 7] = 81.91, 81.83
    assert usable_range_m(log_of(np.arange(40.0), ranges=ranges)) < 6.1


def test_the_corner_of_a_room_where_the_robot_stands_is_no_error():
    one = np.hypot(3.0, np.linspace(0.0, 4.0, 90)).round(3)
    log = log_of(np.arange(20.0), ranges=np.tile(one, (20, 1)))
    assert usable_range_m(log) == pytest.approx(5.0)


def test_a_round_room_is_a_room_but_sicks_codes_are_none():
    assert usable_range_m(log_of(np.arange(9.0), ranges=np.full((9, 50), 5.0))) == 5.0
    assert usable_range_m(log_of(np.arange(9.0), ranges=np.full((9, 50), 81.91))) == 0.0


def test_the_maximum_that_the_log_states_counts():
    ranges = walls(np.random.default_rng(3))
    ranges[2, 2] = 12.7
    assert usable_range_m(log_of(np.arange(40.0), ranges=ranges, stated=8.0)) < 6.1
    assert usable_range_m(log_of(np.arange(40.0), ranges=ranges)) == pytest.approx(12.7)
    # A log that states too little: what is left out is said.
    notes = ScanReader(log_of(np.arange(40.0), ranges=ranges, stated=3.0), 30.0).notes
    assert f"{np.count_nonzero(ranges > 2.997)} ranges are left out" in notes[0]
