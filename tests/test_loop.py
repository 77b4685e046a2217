"""The closed loop as a whole: it arrives, it is reproducible, and each stage has its own rate."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy.stats import chi2

from simloop.geometry.se2 import wrap_angle
from simloop.loop import Simulation
from simloop.messages import (
    EncoderReading,
    Estimate,
    Event,
    ImuReading,
    LidarScan,
    Plan,
    PoseFix,
    SmoothPath,
    TrackCommand,
)
from simloop.scenario.load import load
from simloop.simulation.random_streams import RandomStreams
from simloop.truth import TrackTruth, Truth


class Tape:
    """Keeps every message, and the simulated time at which it came."""

    def __init__(self):
        self.messages, self.heard_ns = [], []
        self.now_ns = 0

    def offer(self, message):
        if isinstance(message, Truth):
            self.now_ns = message.t_ns
        self.messages.append(message)
        self.heard_ns.append(self.now_ns)

    def of(self, kind):
        return [m for m in self.messages if isinstance(m, kind)]

    def times_ns(self, kind):
        return [t for m, t in zip(self.messages, self.heard_ns, strict=True) if isinstance(m, kind)]


def run(name="experiment", seed=0, *overrides, listeners=()):
    return Simulation(load(name, overrides, seed=seed), listeners).run()


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


def test_each_stage_has_its_own_rate(taped):
    result, tape = taped
    seconds = result.metrics["sim_time_s"]
    assert len(tape.of(TrackCommand)) == round(seconds * 100)
    assert len(tape.of(LidarScan)) == len(tape.of(PoseFix)) == int(seconds * 10 + 1e-9)
    frames = [p for p in tape.of(Plan) if p.reason == "frame"]
    assert len(frames) >= int(seconds / 1.83) - 1
    assert all(p.t_ns % 1_830_000_000 == 0 for p in frames)
    assert len(tape.of(SmoothPath)) == len(tape.of(Plan))


def test_the_robot_discovers_the_room_and_replans(taped):
    _, tape = taped
    plans = tape.of(Plan)
    assert len(plans) >= 5
    assert plans[0].reason == "first"
    lengths = {len(p.waypoints_m) for p in plans}
    assert lengths != {2}


def test_the_same_seed_gives_the_same_bits_with_and_without_listeners(taped):
    tape = Tape()
    again = run(seed=3, listeners=[tape.offer])
    assert again.metrics["state_hash"] == taped[0].metrics["state_hash"]
    assert run(seed=4).metrics["state_hash"] != again.metrics["state_hash"]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bits_in_two_processes():
    code = (
        "from simloop.loop import Simulation; from simloop.scenario.load import load;"
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
    with pytest.raises(RuntimeError, match="runs only once"):
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


@pytest.mark.parametrize(
    ("latency", "seconds"),
    [
        ("fixed", 0.0),
        ("fixed", 0.5),
        ("fixed", 0.004),  # rounds down to no period of 10 ms
        ("fixed", 0.006),  # rounds up to one
        ("per_evaluation", 2e-5),
        ("per_evaluation", 1e-9),
    ],
)
def test_a_plan_is_followed_after_the_time_that_planning_takes(latency, seconds):
    tape = Tape()
    settings = [f"planner.latency='{latency}'", f"planner.latency_s={seconds}", "time_limit_s=1.0"]
    run("open", 0, *settings, listeners=[tape.offer])
    plan = tape.of(Plan)[0]
    times = 1 if latency == "fixed" else plan.evaluations
    delay_ns = tape.times_ns(SmoothPath)[0] - tape.times_ns(Plan)[0]
    assert delay_ns == round(seconds * times * 1e9 / 10_000_000) * 10_000_000


def test_listeners_hear_each_period_in_order(taped):
    """The truth opens a period, the command closes it, and the robot's own messages follow."""
    _, tape = taped
    kinds = [type(m) for m in tape.messages]
    assert kinds[0] is Truth
    starts = [i for i, kind in enumerate(kinds) if kind is Truth][1:]
    for start, end in zip(starts, [*starts[1:], len(kinds)], strict=True):
        period = kinds[start:end]
        assert period[:3] == [Truth, EncoderReading, ImuReading]
        assert period.count(TrackCommand) == period.count(Estimate) == 1
        assert period.index(TrackCommand) < period.index(Estimate)
        assert (LidarScan in period) == (TrackTruth in period)


def test_no_sensor_draws_from_anothers_random_numbers():
    """What one sensor draws must not depend on how often, or whether, another one draws."""

    def values(kind, value, *overrides):
        tape = Tape()
        run("open", 5, "time_limit_s=0.1", *overrides, listeners=[tape.offer])
        return np.array([value(m) for m in tape.of(kind)])

    gyro = [
        values(ImuReading, lambda reading: reading.gyro_radps, *overrides)
        for overrides in ((), ("lidar.rays=90", "lidar.dropout=0.5"))
    ]
    np.testing.assert_array_equal(*gyro)
    ranges = [
        values(LidarScan, lambda scan: scan.ranges_m, *overrides)
        for overrides in ((), ("imu.gyro_noise_radps_rthz=0", "imu.gyro_bias_radps=0"))
    ]
    np.testing.assert_array_equal(*ranges)


def test_random_streams_are_independent_and_follow_the_seed():
    streams = RandomStreams.from_seed(3)
    keys = [stream.bit_generator.seed_seq.spawn_key for stream in streams]
    assert keys == [(number,) for number in range(7)]
    draws = [stream.random() for stream in streams]
    assert len(set(draws)) == 7
    assert [stream.random() for stream in RandomStreams.from_seed(3)] == draws
    assert [stream.random() for stream in RandomStreams.from_seed(4)] != draws


def test_a_robot_with_a_blind_planner_stops_before_the_obstacle(monkeypatch):
    """With a planner that always goes straight, the collision monitor holds the robot."""
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


def test_the_filter_is_consistent():
    """A few seeds against gross errors; the slow test below checks the exact band."""
    nees = nees_by_instant("experiment", range(1000, 1006))
    assert 1.2 < nees.mean() < 5.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["experiment", "clutter", "corridor", "trap"])
def test_nees_over_fifty_seeds(name):
    """The filter is not overconfident, and at most a quarter below the 95 % band."""
    nees = nees_by_instant(name, range(1000, 1050))
    low, high = chi2.ppf([0.025, 0.975], 3 * len(nees)) / len(nees)
    assert 0.75 * low < nees.mean() < high
