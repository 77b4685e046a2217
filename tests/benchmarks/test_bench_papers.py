"""The benchmark of the papers: what drives, what is counted, how it resumes, and its page."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict

import numpy as np
import pytest

from simloop.benchmarks.papers import figures, findings, tables
from simloop.benchmarks.papers.drive import TIMES, drive
from simloop.benchmarks.papers.entries import (
    EVERY,
    WORLDS,
    Drives,
    Entry,
    default_entries,
    with_libraries,
)
from simloop.benchmarks.papers.papers import LEAD, PAPERS, Drive, Paper
from simloop.benchmarks.papers.reasons import REASONS, contradicted, reason_of
from simloop.benchmarks.planners import weights
from simloop.benchmarks.planners.paper_runs import Panel, PaperTable
from simloop.benchmarks.planners.scenes import scene
from simloop.benchmarks.planners.trials import settings, try_once
from simloop.campaign.journal import Journal
from simloop.campaign.spec import RunSpec
from simloop.campaign.work import do_run
from simloop.cli.main import main
from simloop.common.errors import InputError
from simloop.common.pool import Workers
from simloop.config import PlannerConfig, VehicleConfig
from simloop.planners import registry
from simloop.planners.protocol import PlanningTask

SMALL = (
    Entry(EVERY, "open", "tlbo"),
    Entry(EVERY, "open", "de"),
    Entry("wu", "trap", "tlbo", "lead"),
)


def spec(planner="tlbo", seed=0, world="open"):
    return RunSpec(world, planner, (), (), seed)


def row(seed, success, **changes):
    base = {
        "scenario": "open", "planner": "tlbo", "sweep": "", "seed": seed, "success": success,
        "outcome": "reached" if success else "stuck", "error": "", "contact_count": 0,
        "hit_count": 1, "sim_time_s": 10.0 + seed, "path_length_m": 4.4, "shortest_path_m": 4.0,
        "plan_evaluations": 100, "frame_ms": [1.0, 3.0], "cpu_s": 0.5,
        "path_m": [[0.0, 0.0], [1.0, 0.5]], "goal_path_m": [],
    }  # fmt: skip
    return {**base, **changes}


def test_every_planner_and_every_papers_method_drives():
    every = default_entries()
    assert len({(one.world, one.planner) for one in every}) == len(every)
    for world in WORLDS:
        here = [one.planner for one in every if one.world == world]
        assert here == list(registry.available())
    assert {one.group for one in every} == {EVERY} | {p.key for p in PAPERS if p.drives}
    for paper in PAPERS:
        for drives in paper.drives:
            here = {one.planner: one.role for one in every if one.world == drives.world}
            assert here[drives.own] == "own" and LEAD in here
            assert set(here) <= set(registry.available())
            assert {here[name] for name in drives.rivals} <= {"rival"}


def test_only_chooses_by_paper_world_and_planner():
    def chosen(*only):
        return [(e.world, e.planner) for e in Drives(SMALL, (0, 2), only).chosen()]

    assert chosen() == [("open", "tlbo"), ("open", "de"), ("trap", "tlbo")]
    assert chosen("de") == [("open", "de")]
    assert chosen("tlbo", "open") == [("open", "tlbo")]
    assert chosen("wu") == [("trap", "tlbo")]
    assert len(Drives((*SMALL, Entry("x", "low", "de")), (3, 6)).runs()) == 4 * 3


@pytest.mark.parametrize(
    ("only", "message"),
    [
        (("opn",), "did you mean 'open'?"),
        (("wu", "de"), "no planner drives in such a world"),
    ],
)
def test_a_wrong_choice_is_refused_in_one_line(only, message):
    with pytest.raises(InputError) as error:
        Drives(SMALL, (0, 1), only).check()
    assert message in str(error.value) and "\n" not in str(error.value)


def test_a_world_that_is_missing_is_refused_before_the_first_run():
    with pytest.raises(InputError, match="paper_nowhere"):
        Drives((Entry("wu", "paper_nowhere", "tlbo"),), (0, 1)).check()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--only", "tblo"], "did you mean 'tlbo'?"),
        (["--seeds", "5:5"], "empty range"),
        (["--json", "."], "is a directory"),
    ],
)
def test_wrong_input_ends_with_exit_code_two(monkeypatch, capsys, tmp_path, arguments, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["simloop", "bench", "papers", *arguments])
    with pytest.raises(SystemExit) as end:
        main()
    shown = capsys.readouterr().err
    assert end.value.code == 2 and message in shown and len(shown.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_drive_is_the_campaigns_run_with_the_path():
    driven, plain = drive(spec()), do_run(spec())
    assert driven["success"] and driven["state_hash"] == plain["state_hash"]
    assert {k: v for k, v in drive(spec()).items() if k not in TIMES} == {
        k: v for k, v in driven.items() if k not in TIMES
    }
    path = np.array(driven["path_m"])
    assert np.hypot(*np.diff(path, axis=0).T).sum() == pytest.approx(
        driven["path_length_m"], rel=0.02
    )
    assert len(driven["frame_ms"]) >= 1 and driven["cpu_s"] > 0.0
    json.dumps(driven, allow_nan=False)


def test_the_way_of_a_moving_goal_is_kept():
    driven = drive(spec(world="moving_goal"))
    assert len(driven["goal_path_m"]) > 10


def test_a_run_that_cannot_be_built_is_a_row_with_an_error():
    wrong = drive(RunSpec("open", "tlbo", (), ("goal=[99.0,0.0]",), 0))
    assert wrong["outcome"] == "error" and "outside" in wrong["error"]


def test_the_figures_of_a_cell():
    rows = [row(0, True), row(1, True), row(2, False, contact_count=2, path_length_m=99.0)]
    cell = figures.cell_of(Entry(EVERY, "open", "tlbo"), rows)
    assert (cell["runs"], cell["arrivals"], cell["contacts"], cell["hits"]) == (3, 2, 2, 3)
    assert cell["outcomes"] == {"reached": 2, "stuck": 1}
    assert cell["time_mean_s"] == cell["time_median_s"] == 10.5
    assert cell["path_ratio"] == pytest.approx(1.1)
    assert cell["frames"] == 6 and cell["frame_ms_p50"] == 2.0
    assert cell["evaluations"] == 100.0 and cell["evaluations_per_frame"] == 50.0
    low, high = cell["arrival_interval"]  # Wilson's interval of 2 of 3
    assert (low, high) == (pytest.approx(0.2077, abs=1e-4), pytest.approx(0.9385, abs=1e-4))
    assert cell["reason"] == ""


def test_a_cell_without_an_arrival_has_no_time():
    error = {"success": False, "outcome": "error", "error": "broken", "seed": 0}
    cell = figures.cell_of(Entry(EVERY, "open", "tlbo"), [error])
    assert cell["time_mean_s"] is None and cell["frame_ms_p50"] is None
    assert cell["errors"] == ["broken"]


def test_a_reason_is_shown_only_if_it_is_measured():
    key = ("potential_field", "trap")
    assert reason_of(*key, 0, 20) == REASONS[key].text
    assert reason_of(*key, 20, 20) == "" and reason_of("tlbo", "trap", 0, 20) == ""
    assert contradicted({key: (20, 20), ("tlbo_paper", "trap"): (3, 20)}) == [key]
    known = {(one.planner, one.world) for one in default_entries()}
    assert set(REASONS) <= known


def test_the_plain_field_does_not_come_out_of_the_trap():
    """Others arrive within 20 s."""
    done = drive(RunSpec("trap", "potential_field", (), ("time_limit_s=45.0",), 0))
    assert not done["success"] and done["contact_count"] == 0
    assert reason_of("potential_field", "trap", 0, 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["niwtlbo", "ga_apf"])
def test_no_plan_of_cross_lines_or_of_a_deformed_field_leads_out_of_a_u(name):
    one = scene("S4b")[0]
    trial = try_once(name, one, 0, settings(name, one, 1000, 100))
    assert not trial.verdict.success


def test_the_printed_tlbo_plans_without_the_vehicles_overhang():
    """In narrow rooms most of its plans are unsafe for the vehicle, where DE's are safe."""
    safe = {}
    for name in ("tlbo_paper", "de"):
        plans = []
        for one in scene("S3")[:4]:
            task = PlanningTask(one.world, one.start, one.goal, one.safe_m)
            config = PlannerConfig(name=name, safe_distance_m=one.safe_m, max_evaluations=5000)
            planner = registry.make_planner(config, VehicleConfig())
            plans += [planner.plan(task, np.random.default_rng(seed)).safe for seed in range(2)]
        safe[name] = float(np.mean(plans))
    assert safe["de"] == 1.0 and safe["tlbo_paper"] <= 0.5


def test_a_benchmark_resumes_and_does_nothing_twice(tmp_path, monkeypatch):
    from simloop.cli import papers
    from simloop.cli.runs import How

    request = Drives(SMALL, (0, 1), ("open", "tlbo"))
    rows, found = papers.do_papers(request, tmp_path, How(1), False)
    assert found == {} and [one["success"] for one in rows.values()] == [True]

    def never(spec):
        raise AssertionError("driven again")

    monkeypatch.setattr(papers, "drive", never)
    again, _ = papers.do_papers(request, tmp_path, How(1), False)
    assert again == rows
    made = figures.figures_of(Drives(SMALL, (0, 1), ("open",)), rows, {})
    assert made["interrupted"] and made["runs_finished"] == 1 and made["runs"] == 2
    assert not figures.figures_of(request, rows, {})["interrupted"]
    # All runs are finished, but not the tables.
    assert figures.figures_of(request, rows, None)["interrupted"]


def test_a_folder_of_a_changed_scenario_is_refused(tmp_path):
    world = tmp_path / "mine.toml"
    world.write_text('start = [0.0, 0.0, 0.0]\ngoal = [3.0, 0.0]\narena = "open"\n')
    request = Drives((Entry(EVERY, str(world), "tlbo"),), (0, 1))
    with Journal(tmp_path / "out", request):
        pass
    with Journal(tmp_path / "out", Drives((*SMALL, *request.entries), (0, 9), ("de",))):
        pass  # more entries, other seeds and another choice go on
    world.write_text(world.read_text().replace("3.0", "3.5"))
    with pytest.raises(InputError, match="differ"), Journal(tmp_path / "out", request):
        pass


def test_entries_without_their_library_are_left_out():
    assert [one.planner for one in with_libraries(SMALL, ["de"])] == ["de"]


def some_tables():
    """The parts of the tables, as ``measure`` makes them, with little data."""
    path = np.array([[2.0, 0.0], [7.0, 3.0]])
    table = PaperTable("Path length", "Wu 2016, Table 1", ("a", "b"), (("TLBO", 1.5),))
    table.ours.append(("TLBO", 2.5))
    table.note(True, "alike <here>")
    table.note(False, "unlike")
    table.pictures.panels.append(Panel("sabiha4", "TLBO", [path], [True]))
    table.pictures.curves["TLBO"] = np.array([[100.0, 9.0], [1000.0, 4.5]])
    table.pictures.samples["length, m"] = {"TLBO": np.array([6.1, 6.2])}
    study = weights.study(scene("S1")[0], "theta_star", 14)
    return {"wu": [tables._plain(asdict(table))], "weights": tables._plain(asdict(study))}


def test_parts_are_kept_and_measured_once(tmp_path):
    made = []

    def work(name):
        made.append(name)
        return [{"source": f"{name} 2016"}] if name != "weights" else {"count": 1}

    workers = Workers(lambda: ThreadPoolExecutor(1), 1)
    first = tables.measure_missing(tmp_path, workers, work=work)
    assert dict([next(first)]).keys() == {"sabiha"}
    first.close()
    assert list(tables.read(tmp_path)) == ["sabiha"]
    rest = dict(tables.measure_missing(tmp_path, workers, work=work))
    assert list(rest) == ["wu", "mohamed", "abed", "weights"] and made.count("sabiha") == 1
    (tmp_path / "tables_wu.json").write_text("{")
    assert "wu" not in tables.read(tmp_path)
    assert tables.tables_of(tables.read(tmp_path), "abed") == [{"source": "abed 2016"}]


def test_the_weight_study_survives_json():
    part = json.loads(json.dumps(some_tables()["weights"]))
    study = tables.study_of(part)
    assert study.front.dtype == bool and study.pls.scores.shape == (14, 2)


def test_findings_compare_drives_with_claims():
    paper = Paper("x", "X", "X", (), "", "X", (Drive("w", "own", ("a",), ("arrives", "shortest")),),
                  why={"shortest": "because"})  # fmt: skip

    def cell(arrivals, path):
        return {"arrivals": arrivals, "runs": 4, "path_m": path}

    good = findings.findings(paper, {("w", "own"): cell(4, 5.0), ("w", "a"): cell(4, 6.0)})
    assert [one.holds for one in good] == [True, True] and good[1].reason == ""
    bad = findings.findings(paper, {("w", "own"): cell(3, 7.0), ("w", "a"): cell(4, 6.0)})
    assert [one.holds for one in bad] == [False, False] and bad[1].reason == "because"
    assert findings.findings(paper, {}) == []


def test_the_page_needs_no_network_and_shows_what_is_known():
    pytest.importorskip("jinja2")
    pytest.importorskip("matplotlib")
    from simloop.benchmarks.papers import page

    request = Drives((*SMALL, Entry(EVERY, "trap", "potential_field")), (0, 2))
    rows = {one.key: row(one.seed, True, planner=one.planner) for one in request.runs()}
    for one in request.runs():
        if one.planner == "potential_field":
            rows[one.key] = row(one.seed, False)
    found = figures.figures_of(request, rows, some_tables())
    json.dumps(found, allow_nan=False)
    text = page.render(request, rows, found)
    assert all(f'id="{paper.key}"' in text for paper in PAPERS)
    assert "alike &lt;here&gt;" in text and REASONS["potential_field", "trap"].text in text
    assert text.count("<img") >= 6 and 'src="http' not in text and 'href="http' not in text
    assert "0 of 2" in text


def test_figures_without_times_are_those_of_any_machine():
    request = Drives(SMALL[:1], (0, 1))
    key = request.runs()[0].key
    quick = figures.figures_of(request, {key: row(0, True)}, {})
    slow = figures.figures_of(request, {key: row(0, True, frame_ms=[9.0, 9.0], cpu_s=7.0)}, {})
    assert quick != slow
    assert figures.without_times(quick) == figures.without_times(slow)


def test_every_entry_of_the_table_gets_every_seed():
    entries = default_entries()
    runs = Drives(entries, (0, 20)).runs()
    assert len(runs) == 20 * len(entries) == len({one.key for one in runs})
    assert len([one for one in entries if one.role == "own"]) == 13
    every = {(one.world, one.planner) for one in entries if one.group == "planners"}
    assert every >= {(world, name) for world in WORLDS for name in registry.available()}


def test_no_output_is_a_file_of_the_benchmarks_folder(tmp_path, monkeypatch, capsys):
    for name in ("tables_wu.json", "tables_weights.json", "journal.jsonl", "results.parquet"):
        arguments = ["--out", str(tmp_path), "--json", str(tmp_path / name)]
        monkeypatch.setattr("sys.argv", ["simloop", "bench", "papers", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == 2 and f"{name} of --out" in capsys.readouterr().err
        assert list(tmp_path.iterdir()) == []
