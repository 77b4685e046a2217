"""Whole runs with a LiDAR that does not see, sees little, or measures badly: nothing in silence."""

from __future__ import annotations

import pytest

from simloop.benchmarks.faults import MOST_UNSAID_S
from simloop.loop import Simulation
from simloop.scenario.load import load

DROPPED = "faults=[{{kind='beams_dropped', at_s={}, share={}}}]"
GLASS = "faults=[{kind='glass', at_s=0.0, min_m=[-100.0, -100.0], max_m=[100.0, 100.0]}]"
RUNS = [
    ("experiment", 0, "lidar.dropout=1.0"),
    ("clutter", 0, DROPPED.format(0.0, 1.0)),
    ("clutter", 1, DROPPED.format(2.0, 0.98)),
    ("maze", 0, DROPPED.format(5.0, 1.0)),
    ("hall", 0, DROPPED.format(3.0, 0.95)),
    ("clutter", 3, GLASS),
    ("hall", 1, "lidar.range_max_m=1.0"),
    ("experiment", 0, "lidar.noise_m=0.1"),
    ("experiment", 0, "lidar.range_max_m=0.5"),
    ("hall", 1, "lidar.range_max_m=3.0"),
    ("hall", 2, "lidar.range_max_m=1.5"),
    ("gaps", 2, "lidar.range_max_m=1.0"),
    ("barn", 0, "lidar.range_max_m=1.0"),
    ("open", 0, "faults=[{kind='pushed', at_s=4.0, for_s=0.5, shift_m=0.6}]"),
]


def drive(name, seed, *settings):
    return Simulation(load(name, list(settings), seed=seed)).run()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed", "setting"), RUNS)
def test_it_touches_nothing_and_never_is_wrong_in_silence(name, seed, setting):
    result = drive(name, seed, setting)
    assert result.metrics["contact_count"] == 0
    assert result.outcome in ("reached", "lost", "stuck", "timeout")
    assert result.metrics["health"]["unsaid_s"] <= MOST_UNSAID_S


# The first seconds of some: each touched something by then when it took silence for free space.
@pytest.mark.parametrize(
    ("name", "seed", "setting", "seconds"),
    [
        ("experiment", 0, "lidar.dropout=1.0", 3.2),
        ("clutter", 0, DROPPED.format(0.0, 1.0), 2.8),
        ("clutter", 3, GLASS, 4.2),
    ],
)
def test_the_first_seconds_without_an_echo(name, seed, setting, seconds):
    result = drive(name, seed, setting, f"time_limit_s={seconds}")
    assert result.metrics["contact_count"] == 0
    assert result.metrics["health"]["unsaid_s"] <= MOST_UNSAID_S
    assert result.metrics["health"]["ok_s"] < 0.5 * result.metrics["sim_time_s"]
    assert result.outcome != "reached" and result.metrics["distance_to_go_m"] > 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seed", "friction"),
    [("barn", 2, 0.07), ("barn", 7, 0.05), ("barn", 7, 0.08), ("gaps", 2, 0.05)],
)
def test_it_turns_slowly_where_it_has_slid(name, seed, friction):
    result = drive(name, seed, f"tracks.friction={friction}")
    assert result.metrics["contact_count"] == 0
    assert "slides on the ground" in result.metrics["health"]["reasons_s"]


def test_told_that_the_ground_is_open_it_sets_out_and_untold_it_does_not():
    arrives = drive("open", 0, "goal=[0.5, 0.0]")
    assert arrives.reached
    stays = drive("open", 0, "goal=[0.5, 0.0]", "monitor.open_ground=false", "time_limit_s=1.0")
    assert stays.metrics["health"]["reasons_s"]["nothing has ever come back"] > 0.8
    assert stays.metrics["distance_to_go_m"] > 0.49
