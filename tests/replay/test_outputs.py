"""Where a replay writes, and how a trajectory is written."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simloop.common.errors import InputError
from simloop.replay.outputs import STDOUT, ReplayFiles, to_tum


def test_files_lie_in_the_directory(tmp_path):
    files = ReplayFiles(tmp_path, None)
    assert files.map_file == tmp_path / "map.yaml"
    assert files.trajectory == tmp_path / "trajectory.tum"
    assert files.recording == tmp_path / "replay.rrd"


@pytest.mark.parametrize("name", ["map.yaml", "map.pgm", "trajectory.tum"])
def test_what_is_read_is_not_overwritten_by_the_directory(tmp_path, name):
    (tmp_path / name).write_text("mine")
    with pytest.raises(InputError, match=f"--out .* would overwrite .*{name}"):
        ReplayFiles(tmp_path, None).check(tmp_path / "other.log", None, tmp_path / name)


def test_what_is_read_is_not_overwritten_by_the_figures(tmp_path):
    log = tmp_path / "log.npz"
    log.write_text("mine")
    with pytest.raises(InputError, match=r"--json .* would overwrite an input file"):
        ReplayFiles(None, log).check(log)


def test_nothing_is_checked_for_what_is_not_written(tmp_path):
    ReplayFiles(None, None).check(tmp_path / "map.yaml")
    ReplayFiles(None, STDOUT).check(tmp_path / "log.npz")


def test_a_trajectory_is_written_with_unit_quaternions():
    poses = np.array([[1.0, -2.0, 0.5 * math.pi], [0.0, 0.0, -3.0]])
    rows = np.array([line.split() for line in to_tum(np.array([0.5, 1.5]), poses).splitlines()])
    rows = rows.astype(float)
    assert rows.shape == (2, 8)
    np.testing.assert_allclose(rows[:, :4], [[0.5, 1, -2, 0], [1.5, 0, 0, 0]])
    np.testing.assert_allclose(rows[:, 6] ** 2 + rows[:, 7] ** 2, 1.0, atol=1e-8)
    np.testing.assert_allclose(2.0 * np.arctan2(rows[:, 6], rows[:, 7]), poses[:, 2], atol=1e-8)
