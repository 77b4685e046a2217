"""The localiser by itself: one period after the other, in a room of straight walls."""

from __future__ import annotations

import math

import numpy as np
from helpers.rooms import Room, box

from simloop.common.profiler import Profiler
from simloop.config import Config
from simloop.localiser import Localiser
from simloop.messages import (
    EncoderReading,
    Event,
    Frames,
    HealthReason,
    ImuReading,
    LidarScan,
    PoseFix,
    Readings,
)

PERIOD_NS, SCAN_NS = 10_000_000, 100_000_000
# No two of its corners look alike.
ROOM = Room(*box(-2, -1.5, 2.5, 1.5), *box(1.0, 0.6, 1.5, 1.5), *box(-2, -1.5, -1.4, -0.7))
ELSEWHERE = np.array([0.6, -0.5, 1.9])
GRAVITY = np.array([0.0, 0.0, 9.81])


def localiser(pose=(0.0, 0.0, 0.0)):
    return Localiser(Config(), np.array(pose), np.zeros(3), Profiler())


def run(own, periods, pose=(0.0, 0.0, 0.0), first=1, ignore=None):
    """A robot at rest at a pose: yields each period's number, what was located, and the belief."""
    rng = np.random.default_rng(first)
    for i in range(first, first + periods):
        t_ns = i * PERIOD_NS
        imu = ImuReading(t_ns, np.zeros(3), GRAVITY.copy())
        scan = ROOM.scan(np.array(pose), rng, t_ns) if t_ns % SCAN_NS == 0 else None
        own.predict(Readings(EncoderReading(t_ns, 0, 0), imu, scan), driven=False)
        located = None if scan is None else own.match(scan, ignore)
        if located is not None:
            own.enter(located, None)
        yield i, located, own.conclude()


def test_before_the_first_period_it_has_not_given_up():
    assert not localiser().gave_up


def test_every_period_has_frames_and_every_matched_scan_a_fix():
    own = localiser()
    for i, located, _ in run(own, 40):
        kinds = [type(m) for m in own.messages]
        assert kinds.count(Frames) == 1
        assert kinds.count(PoseFix) == (i % 10 == 0) == (located is not None)


def test_a_scan_that_was_entered_stands_in_the_map_and_the_next_one_fits():
    own = localiser()
    located = [found for _, found, _ in run(own, 50) if found is not None]
    assert not located[0].fix.ok and own.mapped
    for found in located[1:]:
        assert found.fix.ok and found.taken and found.informative and not found.relocalised
        assert math.hypot(*found.pose[:2]) < 0.01
        assert len(found.points_m) == 360


def test_masked_points_stay_out_of_the_map():
    own = localiser()
    t_ns = SCAN_NS
    imu = ImuReading(t_ns, np.zeros(3), GRAVITY.copy())
    scan = ROOM.scan(np.zeros(3), None, t_ns)
    own.predict(Readings(EncoderReading(t_ns, 0, 0), imu, scan), driven=False)
    located = own.match(scan, None)
    surfaces = own.enter(located, located.points_m[:, 0] > 0.0)
    assert len(surfaces) > 20
    assert surfaces[:, 0].max() < 0.05


def test_a_scan_that_is_not_newer_than_the_last_one_is_not_matched():
    own = localiser()
    for _ in run(own, 30):
        pass
    again = ROOM.scan(np.zeros(3), None, 2 * SCAN_NS)
    assert own.match(again, None) is None


def test_a_scan_of_before_the_filters_memory_is_not_matched():
    own = localiser()
    for i in range(1, 200):
        t_ns = i * PERIOD_NS
        imu = ImuReading(t_ns, np.zeros(3), GRAVITY.copy())
        own.predict(Readings(EncoderReading(t_ns, 0, 0), imu), driven=False)
        own.conclude()
    assert own.match(ROOM.scan(np.zeros(3), None, SCAN_NS), None) is None


def test_points_on_ignored_discs_are_not_held_against_the_map():
    own = localiser()
    all_of_it = np.array([[0.0, 0.0, 10.0]])
    located = [found for _, found, _ in run(own, 40, ignore=all_of_it) if found is not None]
    assert not any(found.informative or found.taken for found in located)


def test_a_robot_carried_off_says_that_it_is_lost_and_finds_itself():
    own = localiser()
    for _ in run(own, 100):
        pass
    states, found, poses = [], [], []
    for _, located, estimate in run(own, 200, pose=ELSEWHERE, first=101):
        states.append(own.health.current.state)
        poses.append(estimate.pose)
        if located is not None and located.relocalised:
            found.append(located)
            texts = [m.text for m in own.messages if isinstance(m, Event)]
            assert any("found its pose" in text for text in texts)
    assert "lost" in states and states[-1] != "lost"
    assert len(found) == 1
    np.testing.assert_allclose(found[0].pose, ELSEWHERE, atol=0.02)
    np.testing.assert_allclose(poses[-1], ELSEWHERE, atol=0.02)


def test_without_scans_it_gives_up_in_the_end():
    own = localiser()
    gave_up = []
    for i in range(1, 1200):
        t_ns = i * PERIOD_NS
        imu = ImuReading(t_ns, np.zeros(3), GRAVITY.copy())
        own.predict(Readings(EncoderReading(t_ns, 0, 0), imu), driven=False)
        own.conclude()
        gave_up.append(own.gave_up)
    assert gave_up.index(True) * PERIOD_NS * 1e-9 > 9.9
    assert own.health.current.halts


def test_two_thin_posts_cannot_contradict_the_belief():
    own = localiser()
    for _ in run(own, 50):
        pass
    few = ROOM.scan(np.zeros(3), None, 0)
    for i in range(51, 151):
        t_ns = i * PERIOD_NS
        scan = None
        if t_ns % SCAN_NS == 0:
            ranges = np.full(360, np.inf)
            ranges[:12] = 0.7
            scan = LidarScan(t_ns, few.angles_rad, ranges, few.age_ns, 0.15, 12.0)
        imu = ImuReading(t_ns, np.zeros(3), GRAVITY.copy())
        own.predict(Readings(EncoderReading(t_ns, 0, 0), imu, scan), driven=False)
        if scan is not None:
            located = own.match(scan, None)
            assert not located.informative
            own.enter(located, None)
        own.conclude()
    # The room that it has just measured is silent now, so the LiDAR counts as blind.
    assert HealthReason.BLIND in own.health.current.reasons
    assert HealthReason.MISFIT not in own.health.current.reasons and not own.health.lost


def test_thin_scans_after_two_misfits_end_as_given_up_and_not_in_silence():
    """The robot halts; with nothing to decide by, it must say so, and come to an end."""
    own = localiser()
    for _ in run(own, 100):
        pass
    last = 100
    for i, _, _ in run(own, 100, pose=ELSEWHERE, first=101):
        last = i
        if own.health.current.halts:
            break
    assert not own.health.lost
    empty = ROOM.scan(np.zeros(3), None, 0)
    gave_up_after_s = math.inf
    for i in range(last + 1, last + 1201):
        t_ns = i * PERIOD_NS
        imu = ImuReading(t_ns, np.zeros(3), GRAVITY.copy())
        own.predict(Readings(EncoderReading(t_ns, 0, 0), imu), driven=False)
        if t_ns % SCAN_NS == 0:
            ranges = np.full(360, np.inf)
            scan = LidarScan(t_ns, empty.angles_rad, ranges, empty.age_ns, 0.15, 12.0)
            own.enter(own.match(scan, None), None)
        own.conclude()
        assert own.health.current.halts
        assert "scans do not fit" in own.health.current.reasons
        if own.gave_up:
            gave_up_after_s = (i - last) * PERIOD_NS * 1e-9
            break
    assert 9.0 < gave_up_after_s < 11.0


def test_a_lost_robot_that_sees_little_believes_no_place_far_away():
    own = localiser()
    for _ in run(own, 50):
        pass
    sharp = np.diag([1e-6, 1e-6, 1e-6])
    here, there = (
        PoseFix(50 * PERIOD_NS, np.array(p), sharp, 1.0, True)
        for p in ((0.1, 0.1, 0.1), (1.0, 0.0, 0.0))
    )
    own._rich = True
    assert own._tells_places_apart(here) and own._tells_places_apart(there)
    own._rich = False
    assert own._tells_places_apart(here) and not own._tells_places_apart(there)
    for unheld in (0, 1, 2):
        vague = sharp.copy()
        vague[unheld, unheld] = 1.0
        own._rich = True
        assert not own._tells_places_apart(PoseFix(here.t_ns, here.pose, vague, 1.0, True))
