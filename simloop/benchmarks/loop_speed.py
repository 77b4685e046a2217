"""Speed of the closed loop: relative to real time, relative to its physics alone, and by stage.

Each figure is the best of a few repeats in one process, because other work on the machine can only
slow it down. The robot never uses these figures in a decision.
"""

from __future__ import annotations

import gc
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console

from simloop.common.profiler import Profiler
from simloop.common.terminal import print_table
from simloop.evaluation.provenance import machine, versions
from simloop.loop import Simulation, warm_up
from simloop.messages import FloatArray, TrackCommand
from simloop.physics.plant import Plant
from simloop.recording.watch import recorder_for
from simloop.scenario.build import World, build_world
from simloop.scenario.scenario import Scenario
from simloop.sensors import Lidar
from simloop.truth import Published

_SCANS = 200

Report = Callable[[str, int], None]


def run(
    scenario: Scenario,
    repeats: int = 3,
    report: Report = lambda name, count: None,
    world: World | None = None,
) -> dict[str, Any]:
    """Measure the closed loop on a scenario.

    Args:
        scenario: The scenario to run.
        repeats: Number of repeats of each measurement; the best counts.
        report: Function that is called with the name and the number of each kernel before it is
            compiled, see `simloop.loop.warm_up`.
        world: The scenario's world; None to build it.

    Returns:
        What ``simloop bench loop --json`` writes; `_FIGURES` explains the main figures.
    """
    world = world if world is not None else build_world(scenario)
    warm_up(scenario, world, report)
    loops = [_closed_loop(scenario, world) for _ in range(max(1, repeats))]
    fastest = min(loops, key=lambda one: one["wall_s"])
    sim_s, loop_s = fastest["sim_s"], fastest["wall_s"]
    plant_s = min(_plant_alone(scenario, world, fastest["voltages"]) for _ in range(repeats))
    recording_s = min(_recorded(scenario, world) for _ in range(repeats))
    substeps = len(fastest["voltages"]) * Plant(world.model, scenario.config).substeps
    return {
        "scenario": scenario.name,
        "seed": scenario.seed,
        "outcome": fastest["outcome"],
        "sim_time_s": sim_s,
        "wall_time_s": loop_s,
        "real_time_factor": sim_s / loop_s,
        "real_time_factor_recording": sim_s / recording_s,
        "plant_only_ratio": loop_s / plant_s,
        "step_us": plant_s / substeps * 1e6,
        "lidar_scan_us": _scan_us(scenario, world),
        "stages": fastest["stages"],
        "machine": machine(),
        "versions": versions(),
    }


_FIGURES = (
    ("real_time_factor", "{:.1f} x", "closed loop, nothing recorded"),
    ("real_time_factor_recording", "{:.1f} x", "closed loop, recorded to a file"),
    (
        "plant_only_ratio",
        "{:.2f} x",
        "wall time of the closed loop over that of the plant alone, same voltages",
    ),
    ("step_us", "{:.1f} us", "one physics step, tracks included"),
    ("lidar_scan_us", "{:.0f} us", "one turn of the LiDAR"),
)


def print_figures(console: Console, figures: dict[str, Any]) -> None:
    """Print two tables: the loop as a whole, then its stages by their share of the time.

    Args:
        console: Console to print to.
        figures: The figures from `run`.
    """
    name = f"{figures['scenario']}, seed {figures['seed']}, on {figures['machine']['cpu']}"
    rows = [[key, form.format(figures[key]), what] for key, form, what in _FIGURES]
    print_table(console, name, ["figure", "value", "of"], rows)
    stages = sorted(figures["stages"].items(), key=lambda item: -item[1]["share"])
    rows = [
        [stage, f"{at['mean_ms']:.3f}", f"{at['worst_ms']:.3f}", f"{at['share']:.1%}",
         f"{at['calls']:.0f}"]
        for stage, at in stages
    ]  # fmt: skip
    print_table(console, "", ["stage", "mean ms", "worst ms", "share", "calls"], rows)


def _closed_loop(scenario: Scenario, world: World) -> dict[str, Any]:
    """Run once without recording; logging the voltages by reference costs almost nothing."""
    profiler, log = Profiler(), _VoltageLog()
    simulation = Simulation(scenario, listeners=[log], profiler=profiler, world=world)
    gc.collect()
    began = perf_counter()
    result = simulation.run()
    # The figures after the run (shortest path and so on) are not part of the loop.
    wall_s = min(perf_counter() - began, result.metrics["wall_time_s"])
    return {
        "outcome": result.outcome,
        "sim_s": result.metrics["sim_time_s"],
        "wall_s": wall_s,
        "stages": profiler.summary(wall_s),
        "voltages": log.voltages,
    }


class _VoltageLog:
    """A listener that stores the voltages (2,), V, of every control period, in order."""

    def __init__(self) -> None:
        self.voltages: list[FloatArray] = []

    def __call__(self, message: Published) -> None:
        if isinstance(message, TrackCommand):
            self.voltages.append(message.voltage_v)


def _plant_alone(scenario: Scenario, world: World, voltages: list[FloatArray]) -> float:
    """Measure the wall time, s, of the plant alone with the loop's voltages (so the same path)."""
    plant = Plant(world.model, scenario.config)
    plant.reset(np.array(scenario.start))
    gc.collect()
    # A command takes effect one control period later, as in the loop.
    began, before = perf_counter(), np.zeros(2)
    for voltage in voltages:
        plant.step(before)
        before = voltage
    return perf_counter() - began


def _recorded(scenario: Scenario, world: World) -> float:
    """Measure the wall time, s, of the loop with a recording to a file, closing it included."""
    with tempfile.TemporaryDirectory() as directory:
        recorder = recorder_for(Path(directory) / "bench.rrd", scenario, world)
        simulation = Simulation(scenario, [recorder.offer], world=world)
        gc.collect()
        began = perf_counter()
        result = simulation.run()
        run_s = result.metrics["wall_time_s"]
        # The run's own metrics (shortest path etc.) are not counted, with or without recording.
        closing = perf_counter()
        recorder.close()
        return min(run_s, closing - began) + perf_counter() - closing


def _scan_us(scenario: Scenario, world: World) -> float:
    """Measure the median time of one LiDAR turn, us: all sweeps within one scan period."""
    config = scenario.config
    plant = Plant(world.model, config)
    before = plant.reset(np.array(scenario.start))
    rng = np.random.default_rng(0)
    lidar = Lidar(config.lidar, config.rates.lidar_s, plant.base_from_laser, rng)
    ticks = round(config.rates.lidar_s / config.rates.control_s)
    turns = []
    for _ in range(_SCANS):
        spent = 0.0
        for _ in range(ticks):
            truth = plant.step(np.zeros(2))
            began = perf_counter()
            lidar.sweep(before, truth, plant)
            spent += perf_counter() - began
            before = truth
        turns.append(spent)
    return float(np.median(turns)) * 1e6
