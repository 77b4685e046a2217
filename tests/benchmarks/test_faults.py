"""Fault injection: the effect of faults on the readings, and the robot's reaction to them."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.vehicles import plant_on_plane

from simloop.benchmarks import faults as bench_faults
from simloop.common.errors import InputError
from simloop.messages import EncoderReading, ImuReading, LidarScan
from simloop.physics.faults import Fault, Faults, Glass
from simloop.scenario.load import load


def faults(*given):
    return Faults([Fault(**one) for one in given], np.random.default_rng(0))


def scan(t_ns, ranges=(1.0, 2.0, 3.0, 4.0)):
    angles = np.linspace(0.0, 3.0, len(ranges))
    return LidarScan(t_ns, angles, np.array(ranges), np.zeros(len(ranges), np.int64), 0.1, 6.0)


def test_a_fault_acts_only_in_its_time():
    fault = Fault(kind="lidar_silent", at_s=1.0, for_s=0.5)
    assert [fault.on(round(t * 1e9)) for t in (0.99, 1.0, 1.49, 1.5)] == [False, True, True, False]
    for_good = Fault(kind="lidar_silent", at_s=1.0)
    assert for_good.on(10**12) and not for_good.on(0)


def test_a_stuck_encoder_repeats_its_last_count_and_the_other_is_unaffected():
    it = faults({"kind": "encoder_stuck", "at_s": 1.0, "side": "right"})
    heard = [
        it.encoders(EncoderReading(round(t * 1e9), round(100 * t), round(200 * t)))
        for t in (0.5, 1.0, 2.0)
    ]
    assert [(r.left_counts, r.right_counts) for r in heard] == [(50, 100), (100, 200), (200, 200)]


def test_a_silent_sensor_repeats_its_last_reading_with_the_old_stamp():
    it = faults({"kind": "imu_silent", "at_s": 1.0}, {"kind": "encoders_silent", "at_s": 1.0})
    first = it.imu(ImuReading(0, np.zeros(3), np.ones(3)))
    assert it.imu(ImuReading(2_000_000_000, np.ones(3), np.ones(3))) is first
    count = it.encoders(EncoderReading(0, 1, 2))
    assert it.encoders(EncoderReading(2_000_000_000, 5, 6)) is count


def test_a_gyros_bias_jumps_by_the_given_amount():
    it = faults({"kind": "gyro_jump", "at_s": 1.0, "bias_radps": 0.2})
    before = it.imu(ImuReading(0, np.zeros(3), np.zeros(3)))
    after = it.imu(ImuReading(1_000_000_000, np.zeros(3), np.zeros(3)))
    assert (before.gyro_radps[2], after.gyro_radps[2]) == (0.0, 0.2)


def test_beams_are_dropped_and_scans_are_late_or_missing():
    dropped = faults({"kind": "beams_dropped", "at_s": 0.0, "share": 0.3})
    heard = dropped.scan(scan(0, np.full(5000, 2.0)), 0)
    assert np.isinf(heard.ranges_m).mean() == pytest.approx(0.3, abs=0.03)
    late = faults({"kind": "lidar_late", "at_s": 0.0, "delay_s": 0.2})
    sent = scan(0)
    assert late.scan(sent, 0) is None and late.scan(None, 100_000_000) is None
    assert late.scan(None, 200_000_000) is sent
    silent = faults({"kind": "lidar_silent", "at_s": 0.0, "for_s": 1.0})
    assert silent.scan(scan(0), 0) is None and silent.scan(scan(1), 1_000_000_000) is not None


def test_beams_pass_through_glass_to_the_wall_behind():
    class Walls:
        def cast(self, origins, directions, cutoff_m):
            wall = np.where(origins[:, 0] < 1.0, 1.0, 3.0) - origins[:, 0]
            return np.where(wall <= cutoff_m, wall, -1.0)

    pane = Fault(kind="glass", at_s=0.0, min_m=(0.9, -1.0), max_m=(1.1, 0.5))
    origins = np.array([[0.0, 0.0, 0.2], [0.0, 0.8, 0.2]])
    ahead = np.tile([1.0, 0.0, 0.0], (2, 1))
    assert Glass(Walls(), [pane]).cast(origins, ahead, 6.0) == pytest.approx([3.0, 1.0])
    assert Glass(Walls(), [pane]).cast(origins, ahead, 2.0) == pytest.approx([-1.0, 1.0])


def test_nothing_comes_back_from_glass_behind_glass_behind_glass():
    class Panes:
        def cast(self, origins, directions, cutoff_m):
            return np.floor(origins[:, 0] + 1.0) - origins[:, 0]  # one in each metre

    every = Fault(kind="glass", at_s=0.0, min_m=(-9.0, -9.0), max_m=(9.0, 9.0))
    four = Fault(kind="glass", at_s=0.0, min_m=(0.5, -9.0), max_m=(4.5, 9.0))
    ray = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]])
    assert Glass(Panes(), [every]).cast(*ray, 12.0).tolist() == [-1.0]
    assert Glass(Panes(), [four]).cast(*ray, 12.0) == pytest.approx([5.0])


def test_a_lidar_becomes_noisy_or_short_sighted_without_saying_so():
    sent = scan(0, np.full(5000, 2.0))
    heard = faults({"kind": "lidar_noise", "at_s": 0.0, "noise_m": 0.1}).scan(sent, 0)
    assert np.std(heard.ranges_m) == pytest.approx(0.1, rel=0.05)
    short = faults({"kind": "lidar_short", "at_s": 1.0, "range_m": 2.5})
    assert short.scan(scan(0), 0).ranges_m.tolist() == [1.0, 2.0, 3.0, 4.0]
    heard = short.scan(scan(10**9), 10**9)
    assert heard.ranges_m.tolist() == [1.0, 2.0, np.inf, np.inf] and heard.range_max_m == 6.0


def test_the_plant_slips_on_one_side_can_be_pushed_and_moved():
    plant = plant_on_plane()
    pulls = []
    for _ in range(30):
        plant.ice((0.01, None))  # it goes along with the track
        plant.step(np.array([12.0, 12.0]))
        pulls.append(plant.tracks.track_force.copy())
    most = np.max(pulls, axis=0)
    assert most[0] <= 0.01 * 98.1 and most[1] > 5.0
    plant.ice((None, None))
    it = faults({"kind": "pushed", "at_s": 0.0, "for_s": 0.5, "shift_m": 0.3})
    plant.reset(np.zeros(3))
    truth = plant.truth(np.zeros(3))
    for _ in range(60):
        it.act(plant, truth)
        truth = plant.step(np.zeros(2))
    assert truth.position_m[1] == pytest.approx(0.3, abs=0.05)
    plant.put_down(np.array([1.0, 2.0, 0.5]))
    truth = plant.step(np.zeros(2))
    assert truth.pose_xyyaw == pytest.approx([1.0, 2.0, 0.5], abs=0.01)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{kind="glas", at_s=1.0}', "kind"),
        ('{kind="ice", at_s=1.0}', "side, friction"),
        ('{kind="ice", at_s=-1.0, side="left", friction=0.1}', "at_s"),
        ('{kind="pushed", at_s=1.0, shift_m=0.1}', "for_s"),
        ('{kind="imu_silent", at_s=1.0, share=0.1}', "none but"),
        ('{kind="glass", at_s=1.0, min_m=[1,1], max_m=[0,2]}', "min_m"),
    ],
)
def test_impossible_faults_are_refused_in_one_line(text, message):
    with pytest.raises(InputError, match=message) as caught:
        load("faults", [f"faults=[{text}]"])
    assert "\n" not in str(caught.value)


BLIND = "100 % of beams dropped"
QUICK = [
    BLIND,
    "glass all round",
    "noise x 10",
    "encoder stuck",
    "gyro's bias jumps",
    "LiDAR silent 2 s",
    "kidnapped",
]


@pytest.mark.parametrize("fault", QUICK)
def test_a_fault_is_handled_as_expected(fault):
    trial = bench_faults.run_trial(fault, 1000)
    assert trial.handled, trial


def test_the_robot_reports_what_is_wrong():
    reasons = {
        "encoder stuck": "left belt not heard",
        "LiDAR silent 2 s": "no scans",
        "pushed 0.3 m sideways": "moved by something else",
        "kidnapped": "lost",
        BLIND: "beams do not come back",
        "glass all round": "nothing has ever come back",
    }
    for fault, reason in reasons.items():
        assert bench_faults.run_trial(fault, 1001).health["reasons_s"].get(reason, 0.0) > 0.1


def test_a_trial_with_a_contact_a_wrong_pose_or_a_timeout_is_not_handled():
    good = bench_faults.Trial("none", 0, "reached", 0, {"unsaid_s": 0.0}, 0.0, 1.0)
    assert good.handled
    for change in (
        ("timeout", 0, {"unsaid_s": 0.0}),
        ("reached", 1, {"unsaid_s": 0.0}),
        ("reached", 0, {"unsaid_s": 0.5}),
    ):
        assert not bench_faults.Trial("none", 0, *change, 0.0, 1.0).handled
    blind = bench_faults.Trial("LiDAR silent for good", 0, "lost", 0, {"unsaid_s": 0.0}, 0.0, 1.0)
    assert blind.handled


@pytest.mark.slow
@pytest.mark.parametrize("fault", bench_faults.FAULTS)
def test_every_fault_is_handled_in_twenty_runs(fault):
    assert [t for t in (bench_faults.run_trial(fault, s) for s in range(20)) if not t.handled] == []
