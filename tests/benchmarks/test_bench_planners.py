"""The comparison of planners: the judge, the statistics, the runs and the report page."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from helpers.scene_clearance import scene_clearance
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from simloop.benchmarks.planners import bench
from simloop.benchmarks.planners.jobs import make_jobs, run_jobs
from simloop.benchmarks.planners.judge import clearance, judge, measure, optimum
from simloop.benchmarks.planners.paper_scenes import paper_scene
from simloop.benchmarks.planners.scenes import scene, true_clearance
from simloop.benchmarks.planners.tasks import load_scene, with_best_known
from simloop.benchmarks.planners.trials import settings as trial_settings
from simloop.benchmarks.planners.trials import try_once
from simloop.cli.main import app, main
from simloop.common.errors import InputError
from simloop.config import PlannerConfig
from simloop.evaluation import statistics

S1 = scene("S1")[0]


def random_path(one, seed, points=6):
    """A path from start to goal through random points of the scene."""
    rng = np.random.default_rng(seed)
    low, high = one.world.bounds_m[:2], one.world.bounds_m[2:]
    inner = low + rng.uniform(size=(points, 2)) * (high - low)
    return np.vstack([one.start[:2], inner, one.goal])


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_judges_clearance_equals_that_of_dense_samples(seed):
    path = random_path(S1, seed)
    assert clearance(S1, path) == pytest.approx(true_clearance(S1, path, 1e-3), abs=1e-3)


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_judges_clearance_among_polygons_equals_that_of_samples(seed):
    one = paper_scene("wu180")
    path = random_path(one, seed, points=3)
    truth = scene_clearance(one, path, 0.05)
    found = clearance(one, path)
    assert (found <= 0.0) == (truth <= 0.0) or abs(found - truth) < 0.05
    if truth > 0.0:
        assert found == pytest.approx(truth, abs=0.05)


def test_among_boxes_the_judges_clearance_is_exact_up_to_twice_the_safe_distance():
    one = scene("S4a")[0]
    for seed in range(5):
        path = random_path(one, seed)
        truth = true_clearance(one, path, 1e-3)
        assert clearance(one, path) == pytest.approx(min(truth, 2.0 * one.safe_m), abs=1e-9)


def test_an_unsafe_or_unfinished_path_never_wins():
    straight = np.array([S1.start[:2], S1.goal])
    cut = judge(S1, straight)
    assert not cut.safe and cut.reached and not cut.success
    assert cut.cost < 4.4250 < cut.score
    short = judge(S1, np.array([S1.start[:2], S1.start[:2] + 0.1]))
    assert short.safe and not short.reached and short.score > 100.0


def test_holms_correction_on_a_known_case():
    assert statistics.holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert statistics.holm([0.5, 0.9]) == pytest.approx([1.0, 1.0])


def test_wilcoxon_finds_a_shift_and_no_shift():
    rng = np.random.default_rng(1)
    lead = rng.normal(size=60)
    better = statistics.compare(lead, {"worse": lead + 0.5, "same": lead + rng.normal(size=60)})
    assert better["worse"].p_holm < 1e-6 and better["worse"].lead_wins == 60
    assert better["worse"].difference == pytest.approx(0.5)
    assert better["same"].p_holm > 0.05
    assert statistics.wilcoxon(lead, lead) == 1.0
    other = rng.normal(0.2, size=60)
    expected = stats.wilcoxon(other - lead, method="approx").pvalue
    assert statistics.wilcoxon(lead, other) == pytest.approx(expected)


def test_without_a_difference_p_is_uniform_enough():
    rng = np.random.default_rng(1000)
    p = [statistics.wilcoxon(*rng.normal(size=(2, 25))) for _ in range(400)]
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.09


def test_convergence_and_ecdf_of_a_known_history():
    history = np.array([[10.0, 2.0], [100.0, 1.05], [1000.0, 1.0]])
    grid = np.array([5.0, 10.0, 99.0, 100.0, 1000.0])
    gap = statistics.convergence([history], [1.0], grid)
    assert gap == pytest.approx([np.inf, 100.0, 100.0, 5.0, 0.0])
    share = statistics.ecdf([history], [1.0], grid, targets=(0.1, 0.01))
    assert share == pytest.approx([0.0, 0.0, 0.0, 0.5, 1.0])


@pytest.mark.parametrize("name", ["ga", "tlbo_elitist", "tlbo"])
def test_a_trial_keeps_its_budget_and_is_reproducible(name):
    config = trial_settings(name, S1, 4000, 100)
    first, again = (try_once(name, S1, 3, config, history=True) for _ in range(2))
    assert first.verdict.success and first.evaluations <= 4000
    assert np.array_equal(first.path_m, again.path_m)
    assert (np.diff(first.history[:, 1]) <= 0.0).all()
    assert len(first.history) >= (2 if name == "tlbo_elitist" else 3)
    assert first.history[-1, 1] == pytest.approx(first.verdict.score, rel=1e-6)


def test_rules_of_one_coding_begin_with_the_same_population():
    trials = [
        try_once(name, S1, 5, replace(trial_settings(name, S1, 1000, 100), max_evaluations=1000))
        for name in ("ga", "de", "avoa")
    ]
    firsts = {tuple(trial.history[0]) for trial in trials}
    assert len(firsts) == 1


def test_the_plans_of_a_scene_are_shared_by_its_instances():
    tasks = load_scene("S2")[:4] + load_scene("S4a")
    jobs = make_jobs(tasks, ["ga", "astar", "exact"], seeds=10, budget=500, learners=100)
    count = {(job.planner, tasks[job.task].scene): len(job.seeds) for job in jobs}
    assert count == {("ga", "S2"): 3, ("astar", "S2"): 1, ("exact", "S2"): 1,
                     ("ga", "S4a"): 10, ("astar", "S4a"): 1}  # fmt: skip


@pytest.mark.slow
def test_several_processes_give_the_same_as_one():
    tasks = load_scene("S1")
    jobs = make_jobs(tasks, ["de", "astar"], seeds=2, budget=400, learners=100)
    alone = dict(run_jobs(jobs, tasks, workers=1))
    pooled = dict(run_jobs(jobs, tasks, workers=2))
    assert alone.keys() == pooled.keys()
    for job in jobs:
        for a, b in zip(alone[job], pooled[job], strict=True):
            assert np.array_equal(a.path_m, b.path_m) and a.verdict == b.verdict


def test_without_a_known_optimum_the_best_safe_path_is_used():
    task = replace(load_scene("S1")[0], best=None, exact=False)
    trials = [try_once("astar", S1, 0, trial_settings("astar", S1, 500, 100))]
    (known,) = with_best_known([task], trials)
    assert known.best == trials[0].verdict.cost and not known.exact


def test_the_figures_of_a_small_comparison():
    request = bench.Request(
        ("S1", "moving_goal"), ("tlbo", "ga", "avoa_online"), 1000, 6, workers=1
    )
    result = bench.run(request)
    found = bench.figures(result)
    json.dumps(found, allow_nan=False)
    s1 = found["scenes"]["S1"]
    assert set(s1) == {"tlbo", "ga", "avoa_online"}
    assert set(found["scenes"]["moving_goal"]) == {"avoa_online"}
    keys = {"ms_p50", "ms_p99", "evaluations", "gap_p50", "gap_p95", "safe", "success", "std"}
    assert all(keys <= set(at) for at in s1.values())
    assert s1["tlbo"]["gap_p50"] < s1["ga"]["gap_p50"]
    assert found["comparison"]["S1"]["ga"]["lead_wins"] == 6
    assert not found["interrupted"]


@pytest.mark.parametrize(
    "name", ["S1", pytest.param("S2", marks=pytest.mark.slow), "S3", "S4a", "S4b"]
)
@pytest.mark.parametrize("precise", [False, True])
def test_the_lead_planners_own_figures_are_complete(name, precise):
    todo = [(one, optimum(one)) for one in scene(name)]
    at = measure(todo, PlannerConfig(name="tlbo", precise=precise), 1)
    keys = {"ms_p50", "ms_p99", "gap_p50", "gap_p95", "safe", "std", "evaluations", "plans"}
    assert set(at) == keys and all(np.isfinite(value) for value in at.values())
    assert 0.0 < at["ms_p50"] <= at["ms_p99"] and at["safe"] == 1.0
    assert at["plans"] == len(todo)


def test_an_interrupt_keeps_what_is_done(monkeypatch):
    real = bench.run_jobs

    def cut(jobs, tasks, *, workers, stop):
        for number, done in enumerate(real(jobs, tasks, workers=1)):
            if number == 1:
                raise KeyboardInterrupt
            yield done

    monkeypatch.setattr(bench, "run_jobs", cut)
    result = bench.run(bench.Request(("S1",), ("astar", "theta_star", "exact"), 500, 1, workers=1))
    assert result.interrupted
    assert result.planners("S1") == ["astar"]
    assert bench.figures(result)["scenes"]["S1"]["astar"]["ms_p50"] is None


@pytest.mark.parametrize("workers", [1, 2])
def test_a_stop_keeps_what_is_done(workers):
    asked = []

    def stop():
        asked.append(None)
        return len(asked) > 2

    request = bench.Request(("S1",), ("astar", "theta_star", "tlbo"), 500, 500, workers=workers)
    result = bench.run(request, stop=stop)
    assert result.interrupted and not result.trials_of("S1", "tlbo")


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        (bench.Request(scenes=("S11",)), "did you mean 'S1'?"),
        (bench.Request(planners=("tblo",)), "did you mean 'tlbo'?"),
        (bench.Request(budget=50), "must be more than 200"),
    ],
)
def test_a_wrong_request_is_refused_in_one_line(request_, message):
    with pytest.raises(InputError) as error:
        request_.check()
    assert message in str(error.value) and "\n" not in str(error.value)


def test_wrong_input_ends_with_exit_code_two(monkeypatch, capsys, tmp_path):
    bad = tmp_path / "bad.map"
    bad.write_text("nonsense")
    monkeypatch.setattr("sys.argv", ["simloop", "bench", "planners", "--scenes", str(bad)])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert "line 1: expected 'type'" in capsys.readouterr().err.replace("\n", " ")
    assert app is not None


def test_a_planner_that_cannot_plan_in_a_scene_is_said(monkeypatch, capsys, tmp_path):
    (tmp_path / "room.map").write_text("type octile\nheight 4\nwidth 4\nmap\n" + "....\n" * 4)
    room, out = tmp_path / "room.map", tmp_path / "x.json"
    for planners, code in (("exact", 2), ("exact,astar", 0)):
        words = ["--scenes", room, "--planners", planners, "--seeds", "1", "--workers", "1"]
        words = ["simloop", "bench", "planners", *map(str, words), "--json", str(out)]
        monkeypatch.setattr("sys.argv", words)
        with pytest.raises(SystemExit) as end:
            main()
        said = capsys.readouterr().err
        assert end.value.code == code, said
        assert "room.map: not for worlds of this kind, so left out: exact\n" in said
        assert out.exists() == (code == 0)
    assert list(json.loads(out.read_text())["scenes"]["room.map"]) == ["astar"]


def test_the_page_holds_figures_pictures_and_the_papers_tables(tmp_path, monkeypatch):
    pytest.importorskip("jinja2")
    pytest.importorskip("matplotlib")
    from simloop.benchmarks.planners import page, paper_tables, weights

    table = paper_tables.PaperTable("Title", "Source", ("a", "b"), (("printed", 1.5),))
    table.ours.append(("ours", 2.5))
    table.note(True, "alike <here>")
    monkeypatch.setattr(page, "measure_tables", lambda workers: [table])
    monkeypatch.setattr(page, "study", lambda one: weights.study(one, "theta_star", 14))
    request = bench.Request(
        ("S1", "S4a"), ("tlbo", "ga", "astar"), 1000, 2, history=True, workers=1
    )
    result = bench.run(request)
    file = page.write(tmp_path / "report", result, bench.figures(result))
    text = file.read_text()
    assert text.count("<svg") >= 5 and text.count("<img") == 2
    assert "alike &lt;here&gt;" in text and "2.500" in text
    assert 'id="S4a"' in text and "http" not in text.replace("http://www.w3.org", "").replace(
        "http://purl.org", "").replace("http://creativecommons.org", "").replace(
        "https://matplotlib.org", "")  # fmt: skip
