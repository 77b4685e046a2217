"""A run whose physics breaks down ends, with the reason, and without a file of MuJoCo's."""

from __future__ import annotations

import os

import numpy as np

from simloop.evaluation.referee import Outcome
from simloop.loop import Simulation
from simloop.scenario.load import load


def test_a_run_whose_physics_breaks_down_ends_as_unstable(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    simulation = Simulation(load("open", ["time_limit_s=1.0"]))
    move = simulation._environment.step

    def break_down(plant, truth):
        move(plant, truth)
        if plant.t_ns == 100_000_000:
            plant.data.qvel[4] = np.nan

    monkeypatch.setattr(simulation._environment, "step", break_down)
    result = simulation.run()
    assert result.outcome is Outcome.UNSTABLE
    assert not result.reached
    assert result.unstable.startswith("MuJoCo warns: Nan, Inf or huge value in QVEL")
    assert result.metrics["outcome"] == "unstable"
    assert result.metrics["sim_time_s"] <= 0.11
    assert os.listdir(tmp_path) == []
