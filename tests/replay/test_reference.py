"""References: read from TUM files and from an npz, and matched to the scans."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.replay.laser_log import RawScans, clean_log
from simloop.replay.outputs import to_tum
from simloop.replay.reference import read_tum, with_reference
from simloop.replay.unused import Unused

POSES = np.column_stack([np.arange(20.0), -np.arange(20.0), np.linspace(-3.0, 3.0, 20)])


def log_of(t_s, reference=None, odom=None):
    n = len(t_s)
    odom = np.zeros((n, 3)) if odom is None else odom
    raw = RawScans(
        np.ones((n, 3), np.float32), odom, (np.array(t_s, float),), range(n), "scan", reference
    )
    return clean_log(raw, np.array([-1.0, 0.0, 1.0]), np.zeros(3), "x", Unused())


def matched(tmp_path, log, t_s, poses=POSES):
    path = tmp_path / "r.tum"
    path.write_text("# a comment\n" + to_tum(np.array(t_s), poses))
    return with_reference(log, path)


def test_poses_at_the_times_of_the_scans_are_matched(tmp_path):
    t_s = 0.5 * np.arange(20)
    log = matched(tmp_path, log_of(t_s), t_s)
    np.testing.assert_allclose(log.reference, POSES, atol=1e-6)
    assert "20 of 20 scans have one of its 20 poses within 0.1 s" in log.notes[-1]


def test_poses_that_are_too_far_away_in_time_are_not(tmp_path):
    t_s = 2.0 * np.arange(20)
    late = np.where(np.arange(20) % 2, 0.09, 0.11)
    log = matched(tmp_path, log_of(t_s), t_s + late)
    assert np.isfinite(log.reference[1::2]).all() and np.isnan(log.reference[::2]).all()
    assert "10 of 20 scans" in log.notes[-1]
    quick = 0.1 * np.arange(20)  # half the step between two scans is less than 0.1 s
    log = matched(tmp_path, log_of(quick[:10]), quick)
    assert "10 of 10 scans have one of its 20 poses within 0.05 s" in log.notes[-1]
    assert np.array_equal(np.round(log.reference[:, 0]), np.arange(10.0))


def test_of_several_poses_a_scan_gets_the_nearest(tmp_path):
    t_s = [0.98, 1.01, 1.03]
    log = matched(tmp_path, log_of([0.0, 1.0, 2.0]), t_s, POSES[:3])
    np.testing.assert_allclose(log.reference[1], POSES[1], atol=1e-6)


def test_times_that_do_not_rise_and_tilts_are_told(tmp_path):
    t_s = 0.5 * np.arange(20)
    log = matched(tmp_path, log_of(t_s), t_s[::-1], POSES[::-1])
    np.testing.assert_allclose(log.reference, POSES, atol=1e-6)
    assert "do not rise" in log.notes[-2]
    path = tmp_path / "r.tum"
    path.write_text(f"0 1 2 0.0 0 0 0 1\n1 1 2 0.5 0 {math.sin(0.1)} 0 {math.cos(0.1)}\n")
    (_, notes), yaw = read_tum(path), math.radians(0.0)
    assert "0.5 m" in notes[0] and "11 deg" in notes[0]
    assert read_tum(path)[0][1, 3] == pytest.approx(yaw)


@pytest.mark.parametrize(
    "line",
    ["1 2 3", "1 2 3 0 0 0 0 0", "1 2 3 0 0 0 0 nan", "1 2 3 0 0 0 0 x", "1_0 2 3 0 0 0 0 1",
     "1e13 2 3 0 0 0 0 1", "1 1e9 3 0 0 0 0 1", "1 2 3 0 0 0 0 1 1", "1 2 3 0 1e300 0 0 1"],
)  # fmt: skip
def test_a_line_that_is_wrong_is_named(tmp_path, line):
    path = tmp_path / "r.tum"
    path.write_text(f"0 1 2 0 0 0 0 1\n{line}\n")
    with pytest.raises(InputError, match=r"r\.tum, line 2"):
        read_tum(path)


def test_a_reference_of_another_log_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"0 of 3 scans .* another log"):
        matched(tmp_path, log_of([0.0, 1.0, 2.0]), 1e3 + np.arange(20))
    (tmp_path / "e.tum").write_text("# nothing\n")
    with pytest.raises(InputError, match="no pose"):
        read_tum(tmp_path / "e.tum")
    with pytest.raises(InputError, match="--reference"):
        read_tum(tmp_path / "missing.tum")


def test_a_reference_loses_the_scans_that_are_left_out_and_poses_that_are_not_finite():
    odom, reference = np.zeros((20, 3)), POSES.copy()
    odom[3], reference[7] = math.nan, math.nan
    log = log_of(np.arange(20.0), reference, odom)
    assert len(log.reference) == 19 and np.isnan(log.reference[6]).all()
    assert log.reference[3, 0] == 4.0
    assert any("1 of 19 poses of the reference" in note for note in log.notes)


@given(st.text(alphabet="0123456789. -e#nax\n\t_", max_size=120))
@settings(max_examples=60)
def test_no_text_breaks_the_reader(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("tum") / "r.tum"
    path.write_text(f"0 1 2 0 0 0 0 1\n{text}")
    try:
        table, _ = read_tum(path)
    except InputError as error:
        assert "r.tum" in str(error)
    else:
        assert np.isfinite(table).all() and (np.diff(table[:, 0]) >= 0.0).all()
