"""What a replay says of itself: its page, its recording, and the lines below its table."""

from __future__ import annotations

import re

import numpy as np
import pytest
from helpers.recordings import read, scalars
from helpers.replay_logs import made_up_log, npz_arrays, relations_of
from typer.testing import CliRunner

from simloop.cli.main import app
from simloop.common.errors import InputError
from simloop.recording.stream import TIMELINE
from simloop.replay import session
from simloop.replay.carmen import parse_carmen
from simloop.replay.outputs import ReplayFiles, to_tum
from simloop.replay.read_log import read_log
from simloop.replay.recording import record
from simloop.replay.report import charts, page
from simloop.replay.result import measure_lines


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    """The result for a log with relations and a reference; a scan in its middle fits nowhere."""
    arrays = npz_arrays(45)
    arrays["scan_ranges_m"][20] = np.random.default_rng(1).uniform(1.0, 20.0, 180)
    arrays["ref_gmapping_xyyaw"][3] = np.nan
    file = tmp_path_factory.mktemp("log") / "ring.npz"
    np.savez(file, **arrays)
    log, relations = session.load(file, None)
    return session.run(log, relations)


@pytest.fixture(scope="module")
def bare():
    """The result for a log that nothing measures."""
    return session.run(parse_carmen(made_up_log(12)[0]), None)


def test_figures_hold_the_errors_of_trajectory_and_odometry(replayed, bare):
    figures = replayed.figures
    assert figures["reference"]["poses"] == 44 == figures["odometry_only_reference"]["poses"]
    assert figures["reference"]["ate_rmse_m"] < 0.03
    assert figures["odometry_only_reference"]["ate_rmse_m"] > 0.03
    assert figures["scans_unmatched"] == 1 and list(replayed.unfitted) == [20]
    names = ("relations", "odometry_only", "reference", "odometry_only_reference")
    assert [bare.figures[name] for name in names] == [None] * 4


def test_the_line_of_a_figure_tells_what_was_left_out():
    relations = {"translation_mean_m": 0.0371, "count": 1678, "left_out": 7,
                 "in_gaps": 7, "outside": 0, "lost": 0}  # fmt: skip
    assert measure_lines({"relations": relations}) == [
        "relations: mean 0.037 m over 1678 of 1685 (7 in gaps)"
    ]
    none = {"translation_mean_m": None, "count": 0, "left_out": 5,
            "in_gaps": 2, "outside": 2, "lost": 1}  # fmt: skip
    assert measure_lines({"odometry_only": none, "reference": None}) == [
        "relations, odometry alone: none of 5 can be used (2 in gaps, 2 outside the log's times, "
        "1 where the robot is lost)"
    ]
    short = {"ate_rmse_m": 0.1, "ate_max_m": 0.2, "rpe_5m_median_m": 0.05,
             "rpe_20m_median_m": None, "poses": 9}  # fmt: skip
    assert measure_lines({"reference": short}) == [
        "reference: ATE 0.100 m (max 0.20 m), RPE over 5 m 0.050 m, 9 poses"
    ]


def test_the_page_needs_no_other_file_and_escapes_what_it_quotes(replayed, bare):
    for result in (replayed, bare):
        text = page.render("<b>log</b>", result)
        assert "<b>log" not in text and "&lt;b&gt;log" in text
        assert text.count('src="data:image/png;base64,') == 2
        assert not re.findall(r'(?:src|href)="(?!data:)', text)
    assert "Nothing measures this trajectory" in text and "poses of odometry alone" in text
    text = page.render("ring", replayed)
    for line in measure_lines(replayed.figures):
        assert line.replace("'", "&#39;") in text
    assert "scans that fitted nowhere (1, red)" in text and "poses of the reference" in text
    assert all(note in text for note in replayed.figures["notes"])


def test_the_reference_lies_on_the_trajectory_where_both_are_right(replayed):
    name, poses = charts.beside(replayed)
    assert name == "the reference" and np.isnan(poses[3]).all()
    off = np.delete(poses - replayed.trajectory, 3, axis=0)
    assert np.hypot(*off[:, :2].T).max() < 0.05


def test_a_result_without_any_pose_has_a_page():
    blind = [re.sub(r" \d\.\d{3}", " 81.910", line) for line in made_up_log(5)[0]]
    result = session.run(parse_carmen(blind), None)
    assert result.figures["worthless"]
    assert "The result is worthless" in page.render("blind", result)


def test_the_recording_has_the_timeline_of_all_recordings(replayed, tmp_path):
    record(tmp_path / "x.rrd", replayed)
    found = read(tmp_path / "x.rrd")
    names = {name for tables in found.values() for table in tables for name in table.schema.names}
    assert TIMELINE in names and not names & {"log_time", "log_tick"}
    times, unfitted = scalars(found["/plots/unfitted"])
    np.testing.assert_allclose(times * 1e-9, 0.2 * np.arange(45), atol=1e-9)
    assert np.flatnonzero(unfitted).tolist() == [20]
    times, errors = scalars(found["/plots/error_reference/mapper"])
    assert len(times) == 44 and errors.max() < 0.1
    trails = {name for name in found if name.startswith("/map/trails/")}
    assert trails == {f"/map/trails/{name}" for name in ("mapper", "odometry", "reference")}
    assert [file.name for file in tmp_path.iterdir()] == ["x.rrd"]


def test_the_recording_of_a_log_without_reference(bare, tmp_path):
    record(tmp_path / "x.rrd", bare)
    assert not [name for name in read(tmp_path / "x.rrd") if "reference" in name]


def test_the_command_takes_a_reference_and_writes_a_page(tmp_path):
    lines, truth = made_up_log(30)
    (tmp_path / "x.log").write_text("\n".join(lines))
    (tmp_path / "r.tum").write_text(to_tum(0.2 * np.arange(30) + 0.01, truth))
    done = CliRunner().invoke(
        app,
        ["replay", str(tmp_path / "x.log"), "--reference", str(tmp_path / "r.tum"),
         "--report", str(tmp_path / "page")],
        standalone_mode=False,
    )  # fmt: skip
    assert done.exception is None and done.return_value == 0
    assert "30 of 30 scans have one of its 30 poses" in done.stderr
    assert re.search(r"reference: ATE 0\.0\d\d m .*30 poses", done.stdout)
    assert "x.log" in (tmp_path / "page" / "index.html").read_text()


def test_the_page_overwrites_no_input(tmp_path):
    (tmp_path / "index.html").write_text("mine")
    with pytest.raises(InputError, match=r"--report .* would overwrite"):
        ReplayFiles(None, None, tmp_path).check(tmp_path / "index.html")


def test_a_reference_is_used_instead_of_that_in_the_log(tmp_path):
    np.savez(tmp_path / "x.npz", **npz_arrays(20))
    path, moved = tmp_path / "r.tum", read_log(tmp_path / "x.npz").reference + np.array([5, 0, 0])
    path.write_text(to_tum(0.2 * np.arange(20), moved))
    log, relations = session.load(tmp_path / "x.npz", None, path)
    np.testing.assert_allclose(log.reference[:, :2], moved[:, :2], atol=1e-5)
    assert len(relations) == len(relations_of(made_up_log(20)[1], np.random.default_rng(2)))
