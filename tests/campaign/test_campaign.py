"""Campaigns: the request, the journal that survives kills, and what the results show."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from xml.etree import ElementTree as Xml

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simloop.campaign import (
    closer_look,
    compare,
    execute,
    journal,
    junit,
    report,
    summary,
    thresholds,
)
from simloop.campaign.spec import Request, RunSpec
from simloop.campaign.sweeps import parse_seeds, sweep_values
from simloop.campaign.work import TIMING, do_run, row_of
from simloop.common.errors import InputError
from simloop.common.pool import Workers, local_workers

QUICK = ("time_limit_s=0.3", "goal=[1.5,0.0]")


def spec(seed=0, **changes):
    given_ = {"scenario": "open", "planner": None, "sweep": (), "overrides": QUICK, "seed": seed}
    return RunSpec(**{**given_, **changes})


def row(seed, success, scenario="open", **figures):
    made = row_of(spec(seed, scenario=scenario), "reached" if success else "timeout")
    return {**made, **figures}


def test_a_request_is_the_product_of_all_that_it_names():
    request = Request(("open", "trap"), (3, 5), ("tlbo", "exact"), (), ("planner.penalty=30,60",))
    runs = request.runs()
    assert len(runs) == len({run.key for run in runs}) == 2 * 2 * 2 * 2
    assert runs[0].command() == (
        "simloop run open --seed 3 --planner tlbo --set planner.penalty=30"
    )


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a=1,2", ["a=1", "a=2"]),
        ("a=0.1:0.3:0.1", ["a=0.1", "a=0.2", "a=0.3"]),
        ("goal=[1,2],[3,4]", ["goal=[1,2]", "goal=[3,4]"]),
        ('a="x,y",z', ['a="x,y"', "a=z"]),
    ],
)
def test_a_sweep_is_split_where_a_reader_would(text, values):
    assert sweep_values(text) == values


@pytest.mark.parametrize("text", ["a", "=1", "a=", "a=1:2:0", "a=3:1:1", "a=1:2:-1"])
def test_a_sweep_that_is_none_is_refused(text):
    with pytest.raises(InputError, match="--sweep"):
        sweep_values(text)


@given(st.text())
def test_no_seeds_text_ends_in_anything_but_seeds_or_one_line(text):
    try:
        first, last = parse_seeds(text)
    except InputError as error:
        assert "--seeds" in str(error)
    else:
        assert 0 <= first < last


def test_a_run_is_a_pure_function_and_its_error_a_row():
    ran, again = do_run(spec()), do_run(spec())
    assert ran["outcome"] == "timeout" and not ran["success"]
    assert {k: v for k, v in ran.items() if k not in TIMING} == {
        k: v for k, v in again.items() if k not in TIMING
    }
    wrong = do_run(spec(overrides=("goal=[99.0,0.0]",)))
    assert wrong["outcome"] == "error" and "outside" in wrong["error"]


def test_a_torn_line_is_run_again_and_whole_ones_are_kept(tmp_path):
    request = Request(("open",), (0, 3))
    with journal.Journal(tmp_path, request) as kept:
        kept.add(spec(0), row(0, True))
        kept.add(spec(1), row(1, True))
    file = tmp_path / "journal.jsonl"
    file.write_bytes(file.read_bytes()[:-7])
    with journal.Journal(tmp_path, request) as kept:
        assert kept.missing([spec(0), spec(1)]) == [spec(1)]
        kept.add(spec(1), row(1, False))
    with journal.Journal(tmp_path, request) as kept:
        assert kept.rows[spec(1).key]["success"] is False and len(kept.rows) == 2


def test_a_folder_belongs_to_one_campaign_and_one_process(tmp_path):
    request = Request(("open",), (0, 3))
    running = pytest.raises(InputError, match="another process is running a campaign")
    with journal.Journal(tmp_path, request), running, journal.Journal(tmp_path, request):
        pass
    other = journal.Journal(tmp_path, Request(("trap",), (0, 3)))
    with pytest.raises(InputError, match="only the seeds may differ"), other:
        pass
    with journal.Journal(tmp_path, Request(("open",), (0, 9))):
        pass
    (tmp_path / "journal.jsonl").write_text("rubbish\n")
    with pytest.raises(InputError, match="byte 0"), journal.Journal(tmp_path, request):
        pass


def test_results_go_through_parquet_and_rubbish_is_refused(tmp_path):
    rows = [row(0, True, sim_time_s=3, health=None), row(1, False, sim_time_s=3.5)]
    journal.write_results(tmp_path, rows)
    back = journal.read_results(tmp_path)
    assert [r["sim_time_s"] for r in back] == [3.0, 3.5] and back[1]["health"] is None
    (tmp_path / "no.parquet").write_text("rubbish")
    for name in ("no.parquet", "missing"):
        with pytest.raises(InputError, match=name):
            journal.read_results(tmp_path / name)


def crash_at_two(one):
    if one.seed == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return row(one.seed, True)


def test_a_worker_that_dies_takes_no_other_run_with_it():
    specs = [spec(seed) for seed in range(6)]
    found = dict(execute.run_all(specs, local_workers(2), work=crash_at_two))
    assert set(found) == set(specs)
    assert [s.seed for s, r in found.items() if r["outcome"] == "error"] == [2]


def test_a_stop_keeps_what_has_begun_and_begins_nothing():
    asked = []
    found = dict(
        execute.run_all(
            [spec(seed) for seed in range(100)],
            Workers(lambda: ThreadPoolExecutor(1), 1),
            lambda: len(asked) > 3,
            lambda one: asked.append(one) or row(one.seed, True),
        )
    )
    assert set(asked) == set(found) and 3 < len(found) < 100


def rows_by(workers):
    found = dict(execute.run_all([spec(seed) for seed in range(4)], workers))
    return {
        s.seed: {k: v for k, v in r.items() if k not in TIMING} for s, r in found.items()
    }  # fmt: skip


def test_the_rows_do_not_depend_on_the_executor():
    distributed = pytest.importorskip("distributed")
    alone = {s.seed: {k: v for k, v in do_run(s).items() if k not in TIMING}
             for s in (spec(seed) for seed in range(4))}  # fmt: skip
    assert rows_by(local_workers(2)) == alone
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        execute.dask_cluster(cluster.scheduler_address) as workers,
    ):
        assert rows_by(workers) == alone


def test_a_run_that_kills_its_cluster_worker_is_a_row_too():
    distributed = pytest.importorskip("distributed")
    dask = pytest.importorskip("dask")
    specs = [spec(seed) for seed in range(1, 4)]
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        execute.dask_cluster(cluster.scheduler_address) as workers,
    ):
        found = dict(execute.run_all(specs, workers, work=crash_at_two))
    assert {s.seed: r["outcome"] for s, r in found.items()} == {
        1: "reached", 2: "error", 3: "reached"
    }  # fmt: skip


def test_no_cluster_at_an_address_is_one_line():
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="--dask"), execute.dask_cluster("nonsense://here"):
        pass


def test_wilson_intervals_and_spreads():
    rows = [row(k, k < 9, sim_time_s=float(k), path_length_m=2.0, shortest_path_m=1.0)
            for k in range(10)]  # fmt: skip
    (one,) = summary.summarise(rows)
    assert (one.low, one.high) == pytest.approx((0.5958, 0.9821), abs=1e-3)
    assert one.outcomes == {"reached": 9, "timeout": 1}
    assert one.figures["sim_time_s"]["max"] == 8.0 and one.figures["path_ratio"]["mean"] == 2.0


def test_thresholds_hold_or_are_missed_by_what_was_measured():
    rows = [row(k, k < 9, sim_time_s=float(k)) for k in range(10)]
    texts = ("success_rate>=0.9", "success_rate > 0.9", "timeout_rate<=0.1", "sim_time_s_max<=8",
             "sim_time_s_mean<4")  # fmt: skip
    verdicts = thresholds.judge([thresholds.parse(text) for text in texts], rows)
    assert [v.holds for v in verdicts] == [True, False, True, True, False]
    none = thresholds.judge([thresholds.parse("sim_time_s_max<=8")], [row(0, False)])
    assert [v.holds for v in none] == [False]


@pytest.mark.parametrize("text", ["success_rate", "time<3", "success_rate>=x", "a_mean>=1e", ""])
def test_what_is_no_threshold_is_refused(text):
    with pytest.raises(InputError, match="--require"):
        thresholds.parse(text)


def test_the_rate_of_an_unknown_outcome_is_refused():
    with pytest.raises(InputError, match=r"did you mean 'collision_rate'\?"):
        thresholds.parse("colision_rate<=0.01")
    assert thresholds.parse("error_rate<=0.01").name == "error_rate"


def test_junit_counts_failures_unless_thresholds_decide(tmp_path):
    runs = [(spec(k), row(k, k > 0)) for k in range(3)]
    file = tmp_path / "x.xml"
    junit.write_junit(file, runs, [])
    (suite,) = Xml.parse(file).getroot()
    assert (suite.get("tests"), suite.get("failures")) == ("3", "1")
    verdicts = thresholds.judge([thresholds.parse("success_rate>=0.9")], [r for _, r in runs])
    junit.write_junit(file, runs, verdicts)
    (suite,) = Xml.parse(file).getroot()
    assert (suite.get("tests"), suite.get("failures")) == ("4", "1")
    assert len(list(suite.iter("skipped"))) == 1


def test_compare_finds_what_changed_and_leaves_chance_alone():
    before = [row(k, k % 2 == 0, sim_time_s=10.0 + 0.1 * k) for k in range(40)]
    slower = [{**r, "sim_time_s": r["sim_time_s"] + 1.0} for r in before]
    changes = {c.figure: c for c in compare.compare(before, slower)}
    assert changes["sim_time_s"].verdict == "worse" and changes["success"].verdict == "same"
    better = [{**r, "success": True, "outcome": "reached"} for r in before]
    changes = {c.figure: c for c in compare.compare(before, better)}
    assert changes["success"].verdict == "better" and changes["success"].p_holm < 0.001
    one_more = [{**r, "success": r["success"] or r["seed"] == 1} for r in before]
    assert {c.verdict for c in compare.compare(before, one_more)} == {"same"}
    with pytest.raises(InputError, match="no run in common"):
        compare.compare(before, [row(99, True)])


def command(out, seeds="0:12"):
    overrides = [part for text in QUICK for part in ("--set", text)]
    options = ["--no-report", "--record-failures", "0", "--workers", "1", "--out", str(out)]
    program = [sys.executable, "-m", "simloop.cli", "campaign", "open", "--seeds", seeds]
    return [*program, *options, *overrides]


def test_a_campaign_killed_at_any_moment_loses_and_doubles_nothing(tmp_path):
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    assert subprocess.run(command(whole), capture_output=True).returncode == 1
    for lines in (2, 7):  # killed once so many runs are kept
        process = subprocess.Popen(
            command(killed), stdout=subprocess.DEVNULL, start_new_session=True
        )
        file = killed / "journal.jsonl"
        until = time.monotonic() + 60
        while time.monotonic() < until and process.poll() is None:
            if file.exists() and file.read_bytes().count(b"\n") >= lines:
                break
            time.sleep(0.005)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    assert not (killed / "results.parquet").exists()
    done = subprocess.run(command(killed), capture_output=True, text=True)
    assert done.returncode == 1, done.stderr
    keys = [json.loads(line)["key"] for line in file.read_text().splitlines()]
    assert len(keys) == len(set(keys)) == 12
    strip = [
        [{k: v for k, v in r.items() if k not in TIMING} for r in journal.read_results(folder)]
        for folder in (whole, killed)
    ]
    assert strip[0] == strip[1]


def test_the_report_names_every_cell_and_every_failure(tmp_path):
    runs = [(spec(k), row(k, k > 0, sim_time_s=5.0 + k)) for k in range(3)]
    verdicts = thresholds.judge([thresholds.parse("success_rate>=0.9")], [r for _, r in runs])
    page = report.render(runs, verdicts, [(*runs[0], "")])
    assert (
        "2 of 3 runs reached the goal" in page
        and ">fails<" in page
        and page.count("data:image/png") == 2
    )
    assert "simloop run open --seed 0" in page and "No picture could be drawn" in page


def test_failures_come_first_among_the_worst_and_errors_have_nothing_to_show():
    runs = [(spec(k), row(k, k != 1, sim_time_s=float(k))) for k in range(4)]
    runs.append((spec(9), row_of(spec(9), "error", "broken")))
    assert [s.seed for s, _ in closer_look.worst(runs, 3)] == [1, 3, 2]
    assert [s.seed for s, _ in closer_look.failures(runs, 9)] == [1]


def test_a_failure_is_recorded_once(tmp_path):
    runs = [(spec(0), row(0, False))]
    (file,) = closer_look.record(runs, tmp_path)
    assert file.name.startswith("open_seed0_") and file.stat().st_size > 1000
    stamp = file.stat().st_mtime_ns
    assert list(closer_look.record(runs, tmp_path)) == [file]
    assert file.stat().st_mtime_ns == stamp
