"""Whether the LiDAR sees: scans of rooms, of open ground, and of sensors that lose their beams."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.rooms import Room, box
from hypothesis import given
from hypothesis import strategies as st

from simloop.estimation.sight import (
    Sight,
    SightMonitor,
    firm_beams,
    range_noise,
    silent_beams,
)

ROOM = Room(*box(-2, -1.5, 2.5, 1.5), *box(1.0, 0.6, 1.5, 1.5))
FULL = np.full(360, 2.0)


def with_lost(share, rng, beams=360):
    ranges = np.full(beams, 2.0)
    ranges[rng.random(beams) < share] = np.inf
    return ranges


@given(st.lists(st.booleans(), min_size=3, max_size=60))
def test_silent_and_firm_beams_as_counted_one_by_one(answered):
    ranges, n = np.where(answered, 1.0, np.inf), len(answered)
    silent = [not any(answered[(i + k) % n] for k in (-1, 0, 1)) for i in range(n)]
    firm = sum(answered[i] and (answered[i - 1] or answered[(i + 1) % n]) for i in range(n))
    assert silent_beams(ranges).tolist() == silent
    assert firm_beams(ranges) == firm


@pytest.mark.parametrize("noise_m", [0.01, 0.03, 0.1])
@pytest.mark.parametrize("beams", [36, 60, 90, 120, 170, 360])
def test_the_noise_is_measured_in_a_room_with_edges(noise_m, beams):
    rng, monitor = np.random.default_rng(1), SightMonitor(False)
    clean = ROOM.ranges((0.1, -0.2, 0.3), beams=beams)
    found = []
    for _ in range(40):
        monitor.measure_noise(clean + noise_m * rng.standard_normal(beams))
        found.append(monitor.noise_m)
    # Where beams are far apart, more of them have neighbours beyond a corner.
    assert 0.75 < np.median(found) / noise_m < (1.25 if beams > 90 else 1.6)
    assert (noise_m > 0.05) == (found[2] > 0.05)  # known after three scans


@pytest.mark.parametrize("beams", [36, 90, 170, 360])
def test_walls_without_noise_show_none_however_far_apart_the_beams_are(beams):
    assert range_noise([ROOM.ranges((0.4, -0.3, 1.0), beams=beams)]) < 1e-9


def test_without_three_beams_in_a_row_the_noise_is_unknown():
    lone = np.full(90, np.inf)
    lone[::3] = 2.0
    assert math.isnan(range_noise([np.full(360, np.inf)])) and math.isnan(range_noise([lone]))


def test_a_sensor_that_has_never_measured_anything_is_unproven_unless_the_ground_is_open():
    nothing = np.full(360, np.inf)
    blind, told = SightMonitor(False), SightMonitor(True)
    for _ in range(5):
        assert blind.judge(nothing, 0, 0) is Sight.UNPROVEN and not blind.silence_is_free
        assert told.judge(nothing, 0, 0) is Sight.CLEAR and told.silence_is_free
    assert blind.judge(FULL, 0, 0) is Sight.CLEAR
    assert blind.judge(nothing, 0, 0) is Sight.CLEAR  # proven, and nothing is known to stand there


@pytest.mark.parametrize("share", [0.9, 0.95, 0.98, 1.0])
def test_a_sensor_that_loses_nearly_all_beams_from_the_start_proves_nothing(share):
    rng = np.random.default_rng(2)
    monitor = SightMonitor(False)
    assert {monitor.judge(with_lost(share, rng), 0, 0) for _ in range(50)} == {Sight.UNPROVEN}


def test_two_scans_make_a_sensor_blind_and_two_make_it_see_again():
    monitor = SightMonitor(False)
    nothing = np.full(360, np.inf)
    seen, lost = (FULL, 0, 0), (nothing, 300, 360)
    scans = [seen, lost, lost, (nothing, 0, 360), seen, seen]
    verdicts = [monitor.judge(*scan) for scan in scans]
    blind = Sight.BLIND
    assert verdicts == [Sight.CLEAR, Sight.CLEAR, blind, blind, blind, Sight.CLEAR]


def test_the_first_silent_scan_already_frees_nothing():
    monitor = SightMonitor(False)
    monitor.judge(FULL, 0, 0)
    monitor.judge(np.full(360, np.inf), 300, 360)
    assert not monitor.silence_is_free


def test_strewn_silence_slows_down_and_silence_side_by_side_does_not():
    rng = np.random.default_rng(3)
    strewn = with_lost(0.6, rng)
    missing = int(silent_beams(strewn).sum())
    monitor = SightMonitor(False)
    assert monitor.judge(strewn, missing, missing) is Sight.THIN and not monitor.silence_is_free
    aside = FULL.copy()
    aside[:100] = np.inf
    missing = int(silent_beams(aside).sum())
    monitor = SightMonitor(False)
    assert monitor.judge(aside, missing, missing) is Sight.CLEAR and monitor.silence_is_free


def test_a_few_posts_prove_the_sensor_and_strays_do_not():
    posts = np.full(360, np.inf)
    posts[[10, 11, 12, 13, 200, 201, 202, 203]] = 2.0
    strays = with_lost(0.95, np.random.default_rng(5))
    for scan, sight in ((posts, Sight.CLEAR), (strays, Sight.UNPROVEN)):
        monitor = SightMonitor(False)
        assert monitor.judge(scan, 0, 0) is Sight.UNPROVEN
        assert [monitor.judge(scan, 0, 0) for _ in range(4)][-1] is sight


def test_a_third_of_the_beams_lost_is_nothing_to_speak_of():
    rng, monitor = np.random.default_rng(4), SightMonitor(False)
    for _ in range(100):
        scan = with_lost(0.3, rng)
        missing = int(silent_beams(scan).sum())
        assert monitor.judge(scan, missing, missing) is Sight.CLEAR


def test_the_noise_is_the_plain_quantile_of_the_distances_from_the_walls():
    rng = np.random.default_rng(6)
    scans = [with_lost(lost, rng, 120) + rng.normal(0.0, 0.02, 120) for lost in (0.0, 0.3)]
    off = []
    for scan in scans:
        for a, b, c in zip(np.roll(scan, 1), scan, np.roll(scan, -1), strict=True):
            if np.isfinite([a, b, c]).all():
                step = 2.0 * math.cos(math.radians(3.0))
                slopes = step * c**2 / (a + c) ** 2, step * a**2 / (a + c) ** 2
                off.append(abs(b - step / (1.0 / a + 1.0 / c)) / math.hypot(1.0, *slopes))
    assert range_noise(scans) == pytest.approx(np.quantile(off, 0.2) / 0.2533, rel=1e-9)
