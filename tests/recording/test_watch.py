"""Watching a run: which files it writes, what ends up in them, and what happens on an error."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from helpers.recordings import line_names, read, scalars

from simloop.common.data_files import models_dir
from simloop.loop import Simulation
from simloop.messages import Plan
from simloop.physics.plant import Plant
from simloop.recording.outputs import Outputs
from simloop.recording.scene_shapes import scene_of
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

    outputs.recording.write_text("of an earlier run")
    with pytest.raises(ZeroDivisionError) as caught, watch(SHORT, world, outputs) as watched:
        Simulation(SHORT, watched.listeners, world=world).run(stop)
    assert outputs.recording.read_text() == "of an earlier run"
    (kept,) = tmp_path.glob("run.partial-*.rrd")
    assert str(kept) in caught.value.__notes__[0]
    times, _ = scalars(read(kept)["/plots/speed/true"])
    assert times[-1] == 200_000_000
    assert not outputs.snapshots.exists()


def test_a_recording_that_cannot_be_opened_is_refused(tmp_path: Path) -> None:
    outputs = Outputs(recording=tmp_path / "no-such" / "run.rrd")
    with pytest.raises(OSError, match="no-such"), watch(SHORT, build_world(SHORT), outputs):
        raise AssertionError("the body must not run")


def vehicle_with_road_wheels(count: int) -> mujoco.MjModel:
    """The vehicle on a plane with fewer road wheels on each side."""
    spec = mujoco.MjSpec.from_file(str(models_dir() / "tracked_ugv.xml"))
    for side in ("left", "right"):
        number = count
        while (geom := spec.geom(f"road_{side}_{number}")) is not None:
            spec.delete(geom)
            number += 1
    spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50, 50, 0.1], contype=2
    )
    return spec.compile()


@pytest.mark.parametrize("wheels", [4, 6])
def test_each_road_wheel_of_the_model_has_a_named_line(tmp_path: Path, wheels: int) -> None:
    scenario = load("open")
    world = replace(build_world(scenario), model=vehicle_with_road_wheels(wheels))
    assert scene_of(scenario, world).road_wheels == wheels
    plant = Plant(world.model, scenario.config)
    plant.reset(np.zeros(3))
    with watch(scenario, world, Outputs(recording=tmp_path / "run.rrd")) as watched:
        for listener in watched.listeners:
            listener(plant.track_truth())
    tables = read(tmp_path / "run.rrd")["/plots/tracks/wheel_load"]
    expected = [f"{side} {i}" for side in ("left", "right") for i in range(wheels)]
    assert line_names(tables) == expected
    _, loads = scalars(tables)
    assert loads.shape == (1, 2 * wheels)
