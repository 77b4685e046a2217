"""Watching a run: which files it writes, what ends up in them, and what happens on an error."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.recordings import read, scalars

from simloop.loop import Simulation
from simloop.messages import Plan
from simloop.recording.outputs import Outputs
from simloop.recording.watch import watch
from simloop.scenario.build import build_world
from simloop.scenario.load import load

SHORT = load("experiment", ["time_limit_s=1.5"], seed=2)


def test_everything_that_was_asked_for_is_written(tmp_path: Path) -> None:
    world, plans = build_world(SHORT), []
    outputs = Outputs(tmp_path / "run.rrd", tmp_path / "pictures", tmp_path / "result.json")
    with watch(SHORT, world, outputs) as watched:
        listeners = [*watched.listeners, lambda m: plans.append(m) if type(m) is Plan else None]
        result = Simulation(SHORT, listeners, world=world).run()
        table = watched.plan_figures()["plans"]
    assert result.metrics["state_hash"] == Simulation(SHORT).run().metrics["state_hash"]
    assert (tmp_path / "pictures" / "contact_sheet.png").exists()
    assert [row["cost"] for row in table] == [plan.cost for plan in plans]
    found = read(outputs.recording)
    times, _ = scalars(found["/plots/speed/true"])
    assert times[-1] == 1_500_000_000
    _, exact = scalars(found["/plots/plan_cost_exact"])
    assert exact[:, 0] == pytest.approx([row["exact_cost"] for row in table])
    assert not outputs.result.exists()  # the caller writes it


def test_nothing_is_watched_if_nothing_was_asked_for(tmp_path: Path) -> None:
    with watch(SHORT, build_world(SHORT), Outputs()) as watched:
        assert watched.listeners == []
        assert watched.plan_figures() == {}
    assert list(tmp_path.iterdir()) == []


def test_leaving_twice_finishes_once(tmp_path: Path) -> None:
    world = build_world(SHORT)
    with watch(SHORT, world, Outputs(recording=tmp_path / "run.rrd")) as watched:
        Simulation(SHORT, watched.listeners, world=world).run()
        watched.finish()
        size = (tmp_path / "run.rrd").stat().st_size
    assert (tmp_path / "run.rrd").stat().st_size == size


def test_an_error_closes_the_recording_and_draws_nothing(tmp_path: Path) -> None:
    world = build_world(SHORT)
    outputs = Outputs(recording=tmp_path / "run.rrd", snapshots=tmp_path / "pictures")

    def stop(sim_time_s: float, to_go_m: float) -> bool:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), watch(SHORT, world, outputs) as watched:
        Simulation(SHORT, watched.listeners, world=world).run(stop)
    times, _ = scalars(read(outputs.recording)["/plots/speed/true"])
    assert times[-1] == 200_000_000
    assert not outputs.snapshots.exists()


def test_a_recording_that_cannot_be_opened_is_refused(tmp_path: Path) -> None:
    outputs = Outputs(recording=tmp_path / "no-such" / "run.rrd")
    with pytest.raises(OSError, match="no-such"), watch(SHORT, build_world(SHORT), outputs):
        raise AssertionError("the body must not run")
