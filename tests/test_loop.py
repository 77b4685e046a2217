"""The closed loop as a whole: it arrives, twice alike, and its referee is just."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy.stats import chi2

from simloop.geometry.se2 import wrap_angle
from simloop.loop import Simulation
from simloop.messages import Estimate, Event, LidarScan, Plan, PoseFix, SmoothPath, TrackCommand
from simloop.scenario.load import load
from simloop.truth import Truth


class Tape:
    """Keeps every message."""

    def __init__(self):
        self.messages = []

    def offer(self, message):
        self.messages.append(message)

    def of(self, kind):
        return [m for m in self.messages if isinstance(m, kind)]


def run(name="experiment", seed=0, *overrides, recorder=None, listeners=()):
    return Simulation(load(name, overrides, seed=seed), recorder, listeners).run()


@pytest.fixture(scope="module")
def taped():
    tape = Tape()
    return run(seed=3, listeners=[tape.offer]), tape


def test_the_robot_crosses_the_papers_room(taped):
    result, tape = taped
    figures = result.metrics
    assert result.reached, figures
    assert figures["contact_count"] == 0
    assert figures["sim_time_s"] <= 40.0
    assert figures["path_length_m"] <= 1.25 * figures["shortest_path_m"]
    assert figures["ate_rmse_m"] <= 0.03
    assert figures["yaw_rmse_rad"] <= np.deg2rad(1.0)
    assert abs(tape.of(Truth)[-1].velocity_body[0]) < 0.01


def test_every_stage_speaks_at_its_own_rate(taped):
    result, tape = taped
    seconds = result.metrics["sim_time_s"]
    assert len(tape.of(TrackCommand)) == round(seconds * 100)
    assert len(tape.of(LidarScan)) == len(tape.of(PoseFix)) == int(seconds * 10 + 1e-9)
    frames = [p for p in tape.of(Plan) if p.reason == "frame"]
    assert len(frames) >= int(seconds / 1.83) - 1
    assert all(p.t_ns % 1_830_000_000 == 0 for p in frames)
    assert len(tape.of(SmoothPath)) == len(tape.of(Plan))


def test_the_world_is_discovered_and_replanned(taped):
    _, tape = taped
    plans = tape.of(Plan)
    assert len(plans) >= 5
    assert plans[0].reason == "first"
    lengths = {len(p.waypoints_m) for p in plans}
    assert lengths != {2}


def test_the_same_seed_gives_the_same_bits_recorded_or_not(taped):
    tape = Tape()
    again = run(seed=3, recorder=tape)
    assert again.metrics["state_hash"] == taped[0].metrics["state_hash"]
    assert run(seed=4).metrics["state_hash"] != again.metrics["state_hash"]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bits_in_two_processes():
    code = (
        "from simloop.loop import Simulation; from simloop.scenario.scenario import load;"
        "print(Simulation(load('experiment', seed=3)).run().metrics['state_hash'])"
    )
    hashes = {
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    }
    assert len(hashes) == 1


def test_a_run_can_be_stopped_and_is_not_run_twice():
    simulation = Simulation(load("open"))
    result = simulation.run(lambda sim_time_s, to_go_m: sim_time_s < 0.5)
    assert result.outcome == "interrupted" and result.metrics["sim_time_s"] == pytest.approx(0.6)
    with pytest.raises(RuntimeError, match="runs once"):
        simulation.run()


def test_out_of_time_is_a_timeout():
    result = run("experiment", 0, "time_limit_s=1.0")
    assert result.outcome == "timeout"
    assert result.metrics["sim_time_s"] == pytest.approx(1.0)


def test_planning_time_is_charged_to_simulated_time():
    tape = Tape()
    run(
        "experiment",
        0,
        "time_limit_s=4.0",
        "planner.latency_s=0.5",
        listeners=[tape.offer],
    )
    plan, path = tape.of(Plan)[0], tape.of(SmoothPath)[0]
    first_motion = next(t.t_ns for t in tape.of(Truth) if t.velocity_body[0] > 0.01)
    assert path.t_ns == plan.t_ns
    assert first_motion > plan.t_ns + 450_000_000


def test_a_blind_robot_is_stopped_by_the_referee_or_stops_itself(monkeypatch):
    """With a planner that always goes straight the monitor holds the robot before the obstacle."""
    from simloop.navigation import gap_choice

    class Straight:
        name = "straight"

        def plan(self, task, rng):
            points = np.array([task.start[:2], task.goal])
            length = float(np.hypot(*(points[1] - points[0])))
            return Plan(
                task.world.t_ns, points, length, length, 0.0, False, 1, 0, self.name, task.reason,
                safe_distance_m=task.safe_distance_m,
            )  # fmt: skip

    monkeypatch.setattr(gap_choice, "make_planner", lambda *_: Straight())
    tape = Tape()
    result = run("experiment", 0, "time_limit_s=20.0", listeners=[tape.offer])
    assert result.outcome in ("timeout", "stuck")
    assert result.metrics["contact_count"] == 0
    assert any("stuck" in e.text for e in tape.of(Event))
    assert any(c.mode == "held" for c in tape.of(TrackCommand))


def nees_by_instant(name, seeds):
    """(runs, instants) of x, y, yaw at 10 Hz, cut to the shortest run's length."""
    runs = []
    for seed in seeds:
        truths, values = {}, []

        def hear(message, truths=truths, values=values):
            if isinstance(message, Truth):
                truths[message.t_ns] = message.pose_xyyaw
            elif isinstance(message, Estimate) and message.t_ns % 100_000_000 == 0:
                error = message.pose - truths[message.t_ns]
                error[2] = wrap_angle(error[2])
                values.append(error @ np.linalg.solve(message.covariance[:3, :3], error))

        run(name, seed, listeners=[hear])
        runs.append(values)
    shortest = min(map(len, runs))
    return np.array([values[:shortest] for values in runs])


def test_the_robot_knows_how_well_it_knows_its_pose():
    """A handful of seeds against gross errors; the slow test below holds the band itself."""
    nees = nees_by_instant("experiment", range(1000, 1006))
    assert 1.2 < nees.mean() < 5.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["experiment", "clutter", "corridor", "trap"])
def test_nees_over_fifty_seeds(name):
    """Never overconfident as a whole; cautious by less than the band's lower half again."""
    nees = nees_by_instant(name, range(1000, 1050))
    low, high = chi2.ppf([0.025, 0.975], 3 * len(nees)) / len(nees)
    assert 0.75 * low < nees.mean() < high
