"""Recorded logs of a folder: what is mapped, how it is measured, thinned logs, and the command."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
from helpers.replay_logs import made_up_log, npz_arrays
from typer.testing import CliRunner

from simloop.benchmarks.logs import bench, tables
from simloop.benchmarks.logs.bench import Task
from simloop.benchmarks.logs.thin import thin
from simloop.cli.main import app
from simloop.common.errors import InputError
from simloop.geometry.se2 import between
from simloop.replay import session
from simloop.replay.read_log import read_log


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a log of each format, one that is broken, and files that are no logs."""
    folder = tmp_path_factory.mktemp("logs")
    np.savez(folder / "ring.npz", **npz_arrays())
    (folder / "broken.log").write_text("rubbish\n")
    (folder / "README.txt").write_text("Two logs, of which one is broken\n")
    (folder / "notes.md").write_text("nothing\n")
    (folder / "deep").mkdir()
    return folder


def data_folder() -> Path:
    """The folder of recorded logs beside the clone; skip the test if it is absent."""
    beside = Path(__file__).resolve().parents[2].parent / "shared"
    found = Path(os.environ.get("SIMLOOP_SHARED", beside)) / "data"
    if not (found / "logs").is_dir():
        pytest.skip(f"{found / 'logs'} is not on this machine")
    return found


# ---- what is mapped


def test_logs_are_found_by_name_and_the_rest_is_told(folder, tmp_path):
    logs, notes = bench.find_logs(folder)
    assert list(logs) == ["broken", "ring"]
    assert "README.txt" in notes[0] and "notes.md" in notes[0]
    for name in ("a.log", "a.npz", "b.clf.gz", "c.txt"):
        (tmp_path / name).write_text("PARAM x 0\n")
    logs, notes = bench.find_logs(tmp_path)
    assert list(logs) == ["a.log", "a.npz", "b", "c"] and not notes
    for empty in (folder / "deep", tmp_path / "missing", folder / "ring.npz"):
        with pytest.raises(InputError, match=re.escape(str(empty))):
            bench.find_logs(empty)


def test_logs_are_chosen_by_name_or_by_its_beginning():
    logs = {name: Path(f"{name}.npz") for name in ("aces_lidar", "aces_lidar_2", "fhw")}
    assert list(bench.choose(logs, ())) == list(logs)
    assert list(bench.choose(logs, ["fhw", "aces_lidar"])) == ["aces_lidar", "fhw"]
    assert list(bench.choose(logs, ["aces"])) == ["aces_lidar", "aces_lidar_2"]
    assert list(bench.choose(logs, ["fhw.npz"])) == ["fhw"]
    with pytest.raises(InputError, match="did you mean 'fhw'"):
        bench.choose(logs, ["fhv"])


@pytest.mark.parametrize("text", ["x", "0", "-1", "nan", "inf", "1_0", "1e3"])
def test_a_step_that_is_wrong_is_refused(text):
    assert bench.parse_steps([".25", "1"]) == [0.25, 1.0]
    with pytest.raises(InputError, match=f"--thin {re.escape(text)}"):
        bench.parse_steps([text])


# ---- thinned logs


def test_a_thinned_log_keeps_a_scan_each_so_many_metres_or_degrees(folder):
    log = read_log(folder / "ring.npz")
    few = thin(log, 0.3)
    steps = [between(a, b) for a, b in zip(few.odom, few.odom[1:], strict=False)]
    assert all(np.hypot(*s[:2]) >= 0.3 or abs(s[2]) >= np.pi / 6.0 for s in steps)
    assert 15 < len(few.t_s) == len(few.reference) == len(few.ranges_m) < 30
    assert few.odometry is log.odometry
    kept = np.searchsorted(log.t_s, few.t_s)
    np.testing.assert_array_equal(few.reference, log.reference[kept])


def test_a_thinned_log_is_scored_over_nearly_all_relations(folder):
    row = bench.map_log(Task("ring", folder / "ring.npz", 0.3))
    relations = row["relations"]
    assert relations["count"] + relations["left_out"] == len(
        npz_arrays()["relations_t1_t2_dx_dy_dyaw"]
    )
    assert relations["left_out"] == 0
    assert relations["translation_mean_m"] < 0.03
    assert row["reference"]["ate_rmse_m"] < 0.03 and row["scans"] < 30


@pytest.mark.parametrize("lines", [True, False])
def test_a_log_recorded_thin_is_scored_if_it_has_its_odometry_lines(tmp_path, lines):
    arrays = npz_arrays(every=6)  # 1.2 s apart
    if not lines:
        del arrays["odom_t_s"], arrays["odom_xyyaw"]
    np.savez(tmp_path / "x.npz", **arrays)
    log, relations = session.load(tmp_path / "x.npz", None)
    found = session.measure(log, log.reference, relations)
    assert (found.count == len(relations)) == lines and (found.in_gaps > 30) != lines
    assert found.translation_mean_m < 0.04  # the odometry's own error between two scans


# ---- what is measured


def test_a_log_that_cannot_be_read_is_a_row_with_its_message(folder):
    row = bench.map_log(Task("broken", folder / "broken.log"))
    assert "broken.log" in row["error"] and "FLASER" in row["error"]
    assert set(tables.cells(row)[1:]) == {"-"}
    assert "broken: " in tables.failures([row])[0]


def test_the_command_prints_a_table_and_writes_figures_and_pages(folder, tmp_path):
    done = CliRunner().invoke(
        app,
        ["bench", "logs", str(folder), "--json", str(tmp_path / "f.json"), "--thin", "0.3",
         "--report", str(tmp_path / "pages"), "--workers", "1", "--only", "ring,broken"],
        standalone_mode=False,
    )  # fmt: skip
    assert done.exception is None and done.return_value == 1  # one log is broken
    assert "README.txt" in done.stderr and "broken.log: has no FLASER" in done.stdout
    figures = json.loads((tmp_path / "f.json").read_text())
    rows = figures["logs"]
    assert [(row["name"], row["thin_m"]) for row in rows] == [
        ("broken", None), ("broken", 0.3), ("ring", None), ("ring", 0.3),
    ]  # fmt: skip
    dense = rows[2]
    assert not figures["ok"] and not figures["interrupted"]
    assert dense["reference"]["ate_rmse_m"] < 0.02 < dense["odometry_only_reference"]["ate_rmse_m"]
    assert dense["relations"]["left_out"] == 0 and dense["way_m"] == pytest.approx(6.2, abs=0.1)
    assert 50.0 < dense["peak_memory_mb"] < 4000.0 and dense["ms_per_scan_p99"] > 0.0
    pages = tmp_path / "pages"
    names = {"index.html", "ring.html", "ring-0.3m.html"}
    assert {file.name for file in pages.iterdir()} == names
    index = (pages / "index.html").read_text()
    assert 'href="ring-0.3m.html"' in index and "has no FLASER" in index
    for name in names:
        text = (pages / name).read_text()
        assert not re.findall(r'(?:src|href)="(?!data:|ring)', text)  # no other file is needed


def test_the_command_overwrites_no_log(folder):
    done = CliRunner().invoke(
        app,
        ["bench", "logs", str(folder), "--json", str(folder / "ring.npz")],
        standalone_mode=False,
    )
    assert isinstance(done.exception, InputError) and "would overwrite" in str(done.exception)


# ---- recorded logs


@pytest.mark.slow
def test_relations_of_a_real_log_are_scored_dense_and_thin():
    file = data_folder() / "fr079_lidar.npz"
    dense, few = (bench.map_log(Task("fr079", file, step)) for step in (None, 0.25))
    assert dense["relations"]["count"] >= 1678 and few["relations"]["count"] >= 1670
    assert dense["relations"]["translation_mean_m"] < 0.04
    assert few["relations"]["translation_mean_m"] < 0.06


@pytest.mark.slow
def test_real_logs_are_compared_with_their_reference():
    row = bench.map_log(Task("freiburg-101", data_folder() / "logs" / "freiburg-101_lidar.npz"))
    assert row["error"] is None and row["reference"]["poses"] == 292
    assert row["reference"]["ate_rmse_m"] < 0.2 < row["odometry_only_reference"]["ate_rmse_m"]


def test_carmen_logs_bring_their_odometry_lines(tmp_path):
    lines, truth = made_up_log(20)
    stamps = 0.2 * np.arange(20)
    odom = [f"ODOM {x} {y} {a} 0 0 0 {t} host {t + 50}"
            for t, (x, y, a) in zip(stamps, truth, strict=True)]  # fmt: skip
    (tmp_path / "x.log").write_text("\n".join([*lines, *odom, "ODOM 1 2 3 0 0 0 9.0 host x"]))
    odometry = read_log(tmp_path / "x.log").odometry
    np.testing.assert_allclose(odometry.usable(0).t_s[:20], stamps)
    np.testing.assert_allclose(odometry.usable(1).t_s, stamps + 50.0)
