"""Recorded logs: what is read, how a trajectory is measured, and the command from end to end."""

from __future__ import annotations

import json
import math
import subprocess
import sys

import numpy as np
import pytest
from helpers.relations import format_relations
from helpers.replay_logs import made_up_log, relations_of
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.geometry.se2 import between
from simloop.graph_slam.settings import MappingConfig
from simloop.mapping.map_files import load_map
from simloop.replay.carmen import parse_carmen
from simloop.replay.laser_log import ScanReader, usable_range_m
from simloop.replay.read_log import read_log
from simloop.replay.relations import read_relations, relation_errors

seeds = st.integers(0, 2**32 - 1)

# ---- reading


def test_a_carmen_log_is_read_as_it_was_written():
    lines, _ = made_up_log(20)
    log = parse_carmen([*lines, "ODOM 1 2 3 0 0 0 1 h 1", "FLASER 180 1 2"], "x.clf")
    assert log.ranges_m.shape == (20, 180)
    assert log.skipped == 1
    np.testing.assert_allclose(log.base_from_laser, [0.1, 0, 0], atol=1e-5)
    np.testing.assert_allclose(np.degrees(log.angles_rad[[0, 1, -1]]), [-90, -89, 89])
    assert usable_range_m(log) < 82.0


def test_a_robotlaser_line_brings_its_own_angles():
    text = "ROBOTLASER1 0 -1.0 2.0 0.5 20 0.01 0 5 1 2 3 4 5 0 1 2 0.3 1 2 0.3 0 0 0 0 0 7.5 h 7.6"
    log = parse_carmen([text])
    np.testing.assert_allclose(log.angles_rad, [-1.0, -0.5, 0.0, 0.5, 1.0])
    np.testing.assert_allclose(log.t_s, [7.5])


def test_the_first_line_that_cannot_be_read_is_named():
    with pytest.raises(InputError, match=r"x\.log, line 2"):
        parse_carmen(["# hello", "FLASER 3 1 2 x"], "x.log")


def test_an_npz_is_read_and_its_poses_stand_where_the_offset_leads(tmp_path):
    """laser_offset_x_m leads from the laser to the poses that odometry and relations are of."""
    data = {
        "scan_t_s": np.arange(3.0),
        "scan_ranges_m": np.full((3, 360), 2.0, np.float32),
        "scan_odom_xyyaw": np.zeros((3, 3)),
        "fov_deg": np.float64(180.0),
        "laser_offset_x_m": 0.04,
    }
    data["scan_ranges_m"][:, 0] = 81.91  # nothing came back
    np.savez(tmp_path / "log.npz", **data)
    log = read_log(tmp_path / "log.npz")
    points, origins = ScanReader(log, 30.0).points(0)
    np.testing.assert_allclose(origins[0], [-0.04, 0.0])
    np.testing.assert_allclose(np.hypot(*(points - origins).T), 2.0)
    del data["fov_deg"]
    np.savez(tmp_path / "log.npz", **data)
    with pytest.raises(InputError, match="fov_deg"):
        read_log(tmp_path / "log.npz")


def test_what_came_back_from_nothing_is_no_point():
    lines, _ = made_up_log(5)
    log = parse_carmen(lines)
    log.ranges_m[:, :40] = 81.83
    log.ranges_m[:, 40] = np.inf
    points, _ = ScanReader(log, 200.0).points(0)
    assert len(points) == 139


# ---- measuring


@given(seed=seeds)
@settings(max_examples=20)
def test_errors_are_those_of_the_motion_between_true_and_found(seed):
    rng = np.random.default_rng(seed)
    t = np.arange(8.0) * 0.3
    poses, rows = rng.uniform(-3, 3, (8, 3)), []
    expected = []
    for _ in range(6):
        a, b = rng.choice(8, 2, replace=False)
        true = rng.uniform(-2, 2, 3)
        rows.append([t[a], t[b], *true])
        off = between(true, between(poses[a], poses[b]))
        expected.append((math.hypot(off[0], off[1]), abs(math.degrees(off[2]))))
    found = relation_errors(t, poses, np.array(rows))
    assert found.translation_mean_m == pytest.approx(np.mean([e[0] for e in expected]))
    assert found.translation_std_m == pytest.approx(np.std([e[0] for e in expected]))
    assert found.rotation_mean_deg == pytest.approx(np.mean([e[1] for e in expected]))


def test_relations_come_back_from_their_file(tmp_path):
    rows = relations_of(made_up_log(20)[1], np.random.default_rng(1), 10)
    path = tmp_path / "r.relations"
    path.write_text("# t1 t2 ...\n" + format_relations(rows))
    np.testing.assert_allclose(read_relations(path), rows, atol=1e-8)
    path.write_text("1 2 3\n")
    with pytest.raises(InputError, match="line 1"):
        read_relations(path)


# ---- the command


def replay(*args):
    command = [sys.executable, "-m", "simloop.cli.main", "replay", *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("replay")
    lines, truth = made_up_log()
    (folder / "log.clf").write_text("\n".join(lines))
    rows = relations_of(truth, np.random.default_rng(2))
    (folder / "r.relations").write_text(format_relations(rows))
    done = replay(
        folder / "log.clf", "--relations", folder / "r.relations", "--out", folder / "out",
        "--json", "-",
    )  # fmt: skip
    return folder, truth, done


def test_replay_tells_its_figures(replayed):
    _, _, done = replayed
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout)
    assert figures["scans"] == 90
    assert figures["wall_time_s"] > 0 and figures["ms_per_scan_p50"] <= figures["ms_per_scan_p99"]
    for key in ("relations", "odometry_only"):
        assert {"translation_mean_m", "translation_std_m", "rotation_mean_deg"} <= set(figures[key])
    assert figures["relations"]["translation_mean_m"] < 0.02
    assert figures["relations"]["rotation_mean_deg"] < 0.5
    assert figures["odometry_only"]["translation_mean_m"] > 0.2


def test_replay_writes_trajectory_map_and_recording(replayed):
    folder, truth, _ = replayed
    rows = np.loadtxt(folder / "out" / "trajectory.tum")
    assert rows.shape == (90, 8)
    found = np.column_stack([rows[:, 1:3], 2.0 * np.arctan2(rows[:, 6], rows[:, 7])])
    end, true = between(found[0], found[30]), between(truth[0], truth[30])
    np.testing.assert_allclose(end[:2], true[:2], atol=0.02)
    grid = load_map(folder / "out" / "map.yaml", MappingConfig().grid)
    assert grid.occupied.sum() > 300
    assert (folder / "out" / "replay.rrd").stat().st_size > 10_000


def test_replay_finds_the_robot_in_the_map_that_it_made(replayed):
    folder, _, _ = replayed
    done = replay(
        folder / "log.clf", "--relations", folder / "r.relations",
        "--map", folder / "out" / "map.yaml", "--json", "-",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout)
    assert figures["relocalised"] == 1 and figures["scans_lost"] < 20
    assert figures["relations"]["translation_mean_m"] < 0.03


@pytest.mark.parametrize(
    ("name", "body"),
    [("bad.log", b"\x00\xff rubbish\n"), ("bad.npz", b"PK\x03\x04 cut"), ("bad.txt", b""),
     ("bad.bag", b"x"), ("bad.clf", b"FLASER 2 1 x\n")],
)  # fmt: skip
def test_rubbish_is_refused_in_one_line(tmp_path, name, body):
    (tmp_path / name).write_bytes(body)
    done = replay(tmp_path / name, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1 and name in done.stderr
    assert not (tmp_path / "out").exists()
