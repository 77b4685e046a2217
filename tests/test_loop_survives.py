"""Runs at the limits of the settings, and with faults that leave the robot nothing to see.

None may end in an exception, and the robot's belief stays a number. What the robot makes of it is
tested elsewhere.
"""

from __future__ import annotations

import numpy as np
import pytest
from helpers.shared_cases import shared_case

from simloop.benchmarks.faults import MOST_UNSAID_S
from simloop.common.errors import InputError
from simloop.loop import Simulation
from simloop.messages import Estimate, Event, MoverTracks
from simloop.scenario.build import build_world
from simloop.scenario.load import load

ALL_LOST = "faults=[{kind='beams_dropped', at_s=3.0, share=1.0, for_s=0.0}]"


def _run(scenario, seconds, *overrides):
    """Run a scenario; return the result, the last belief and whether anything was followed."""
    last, followed = [], []

    def hear(message):
        if isinstance(message, Estimate):
            assert np.isfinite(message.state).all() and np.isfinite(message.covariance).all()
            last[:] = [message]
        elif isinstance(message, MoverTracks):
            followed.append(message.t_ns)

    given = load(str(scenario), [f"time_limit_s={seconds}", *overrides], seed=0)
    return Simulation(given, [hear]).run(), last[0], followed


def _written(folder, text):
    path = folder / "given.toml"
    path.write_text("start = [0.0, 0.0, 0.0]\ngoal = [6.0, 0.0]\n" + text)
    return path


def test_a_run_goes_on_when_a_scan_is_empty_while_a_mover_is_followed():
    result, _, followed = _run("hall", 5.0, ALL_LOST)
    assert any(t_ns < 3e9 for t_ns in followed)
    assert result.metrics["sim_time_s"] > 3.2


def test_a_robot_is_kidnapped_after_scans_without_a_hit_have_made_its_map_grow(tmp_path):
    """The search of the whole map needs distances of the map's present extent."""
    boxes = "".join(
        f"[[obstacles]]\nshape = 'box'\nposition_m = [{x}, {y}]\nsize_m = [0.3, 0.4]\n"
        for x, y in ((-0.2, 1.1), (0.9, -1.0), (-0.9, 0.8), (1.2, 0.9))
    )
    fault = "[[faults]]\nkind = 'kidnapped'\nat_s = 12.0\nto = [0.1, 0.1, 1.0]\n"
    bounds = "bounds_m = [-3.0, -4.0, 20.0, 4.0]\n"
    path = _written(tmp_path, bounds + boxes + fault)
    events = []

    def hear(message):
        if isinstance(message, Event):
            events.append(message.text)

    given = load(str(path), ["time_limit_s=14.0", "lidar.range_max_m=2.5", "goal=[15.0,0.0]"])
    assert Simulation(given, [hear]).run().metrics["sim_time_s"] == pytest.approx(14.0)
    assert any("lost" in text for text in events)


@pytest.mark.parametrize(
    "override",
    [
        "lidar.rays=8",  # fewer beams than control periods in a turn
        "rates.lidar_s=4.0",
        "imu.gyro_bias_radps=10.0",
        "imu.accel_bias_mps2=10.0",
        "slam.grain_m=1e-4",
        "smoother.extra_room_m=1e-9",
        "ekf.gyro_bias_std=10.0",
        "slam.hit_log_odds=100.0",
    ],
)
def test_a_setting_at_its_limit_is_survived(override):
    result, _, _ = _run("experiment", 2.5, override, "camera.enabled=true")
    assert result.metrics["sim_time_s"] > 1.0


@pytest.mark.parametrize(
    "override",
    [
        "slam.grain_m=1e-300",
        "slam.match_std_xy_m=1e6",
        "ekf.gauge_ratio=0.01",
        "imu.gyro_noise_radps_rthz=1e-300",
    ],
)
def test_a_number_too_small_to_calculate_with_is_refused_by_name(override):
    with pytest.raises(InputError, match=override.partition("=")[0]):
        load("experiment", [override])


def test_more_bodies_than_mujoco_reserves_memory_for(tmp_path):
    places = [(2.0 + 0.5 * (k // 50), 0.5 * (k % 50) - 20.0) for k in range(2200)]
    mover = "[[movers]]\nmotion = 'walk'\nposition_m = [{}, {}]\n"
    movers = "".join(mover.format(*place) for place in places)
    path = _written(tmp_path, "bounds_m = [-3.0, -30.0, 40.0, 30.0]\n" + movers)
    assert build_world(load(str(path), [])).model.nmocap == 2200
    many = _written(tmp_path, mover.format(3.0, 0.0) * 4001)
    with pytest.raises(InputError, match=r"movers: 4001 .* at most 4000"):
        load(str(many), [])


def test_shared_a_mover_and_nothing_else():
    path = shared_case("25-movers-and-empty-scans") / "mover_and_nothing_else.toml"
    result, _, _ = _run(path, 30.0)
    assert result.metrics["sim_time_s"] > 5.0


@pytest.mark.slow
def test_shared_kidnapped_after_growth():
    events = []
    path = shared_case("24-kidnapped-after-growth") / "kidnapped.toml"
    result = Simulation(load(str(path), []), [events.append]).run()
    texts = [e.text for e in events if isinstance(e, Event) and 20e9 <= e.t_ns < 21e9]
    assert any("localisation lost" in text for text in texts), "it says so within a second"
    assert result.metrics["contact_count"] == 0
    assert result.metrics["health"]["unsaid_s"] <= MOST_UNSAID_S
    if result.outcome.value == "reached":
        assert result.metrics["distance_to_go_m"] < 0.5, "it must not arrive where it is not"
    else:
        assert result.outcome.value == "lost"
        assert any("stopping" in e.text for e in events if isinstance(e, Event))
