"""Health: reasons that hold for a while, halts that end, and doubt that ends as lost."""

from __future__ import annotations

import pytest

from simloop.estimation.health import HealthMonitor
from simloop.estimation.sight import Sight
from simloop.messages import (
    HealthReason,
)

SCAN_NS, PERIOD_NS = 100_000_000, 10_000_000
GOOD, MISFITS, THIN = (True, True), (False, True), (False, False)


def fed(*scans, start=1):
    """A monitor after these scans, each reviewed at its own instant."""
    health = HealthMonitor(SCAN_NS)
    for i, (taken, informative) in enumerate(scans, start):
        health.scan(i * SCAN_NS, taken, informative)
        health.review(i * SCAN_NS)
    return health


def test_in_order_there_is_nothing_to_report():
    health = HealthMonitor(SCAN_NS)
    for i in range(1, 10):
        health.scan(i * SCAN_NS, *GOOD)
        assert health.review(i * SCAN_NS) is None
    assert health.current.state == "ok" and not health.current.halts
    assert health.sure_until_ns(9 * SCAN_NS) == 9 * SCAN_NS


def test_a_reason_holds_for_half_a_second_and_is_reported_twice():
    health = fed(GOOD)
    health.note(SCAN_NS, HealthReason.GYRO)
    reports = []
    for t_ns in range(SCAN_NS, 10 * SCAN_NS, PERIOD_NS):
        health.scan(t_ns, *GOOD)
        reports.append((t_ns, health.review(t_ns)))
    reports = [(t_ns, report) for t_ns, report in reports if report is not None]
    assert [report.reasons for _, report in reports] == [(HealthReason.GYRO,), ()]
    assert reports[1][0] - reports[0][0] == 500_000_000


@pytest.mark.parametrize(
    ("scans", "halts", "state"),
    [
        ([MISFITS], False, "degraded"),
        ([MISFITS] * 2, True, "degraded"),
        ([MISFITS] * 3, True, "degraded"),
        ([MISFITS] * 4, True, "lost"),
        ([MISFITS] * 3 + [GOOD], False, "degraded"),
        ([MISFITS, GOOD] * 4, False, "degraded"),
        ([MISFITS, THIN, MISFITS], True, "degraded"),
        ([THIN] * 10, False, "degraded"),
    ],
)
def test_misfits_halt_the_robot_and_lose_it(scans, halts, state):
    health = fed(GOOD, *scans)
    assert health.current.halts == halts
    assert health.current.state == state
    assert health.lost == (state == "lost")


def test_thin_scans_after_misfits_are_said_and_end_as_no_longer_sure():
    """They decide nothing; the halt must not go on in silence."""
    health = fed(GOOD, MISFITS, MISFITS, *[THIN] * 150)
    assert health.current.halts
    assert (
        HealthReason.MISFIT in health.current.reasons
        and HealthReason.NOTHING_SEEN in health.current.reasons
    )
    assert health.sure_until_ns(153 * SCAN_NS) == 3 * SCAN_NS


def test_a_fix_after_thin_scans_ends_the_halt_and_the_doubt():
    health = fed(GOOD, MISFITS, MISFITS, *[THIN] * 20, *[GOOD] * 6)
    assert not health.current.halts and health.current.state == "ok"
    assert health.sure_until_ns(29 * SCAN_NS) == 29 * SCAN_NS


def test_lost_lasts_until_it_is_found():
    health = fed(GOOD, *[MISFITS] * 5)
    assert health.lost and HealthReason.LOST in health.current.reasons
    assert health.sure_until_ns(6 * SCAN_NS) == 5 * SCAN_NS
    health.found()
    for i in range(7, 13):
        health.scan(i * SCAN_NS, *GOOD)
        health.review(i * SCAN_NS)
    assert not health.lost and health.current.state == "ok"
    assert health.sure_until_ns(12 * SCAN_NS) == 12 * SCAN_NS


def test_no_scans_for_three_periods_halt_and_a_scan_ends_it_at_once():
    health = fed(GOOD)
    assert health.review(4 * SCAN_NS) is None
    report = health.review(4 * SCAN_NS + PERIOD_NS)
    assert report.halts and report.reasons == (HealthReason.NO_SCANS,)
    assert health.sure_until_ns(5 * SCAN_NS) == SCAN_NS
    health.scan(5 * SCAN_NS, *GOOD)
    assert not health.review(5 * SCAN_NS).halts


def test_readings_that_stop_are_told_apart():
    health = fed(GOOD)
    t_ns = SCAN_NS + 6 * PERIOD_NS
    health.readings(t_ns, t_ns, SCAN_NS)
    assert health.review(t_ns).reasons == (HealthReason.NO_IMU,)
    health.readings(t_ns + PERIOD_NS, SCAN_NS, SCAN_NS)
    assert set(health.review(t_ns + PERIOD_NS).reasons) == {
        HealthReason.NO_IMU,
        HealthReason.NO_COUNTS,
    }
    assert not health.current.halts


@pytest.mark.parametrize(
    ("side", "reason"), [(0, HealthReason.LEFT_BELT), (1, HealthReason.RIGHT_BELT)]
)
def test_a_belt_is_not_heard_when_it_is_refused_most_of_the_time(side, reason):
    health = fed(GOOD)
    refused = [False, False]
    refused[side] = True
    for i in range(24):
        health.belts(SCAN_NS + i * PERIOD_NS, tuple(refused))
        assert health.belts_heard == (True, True)
    health.belts(SCAN_NS + 24 * PERIOD_NS, tuple(refused))
    assert health.belts_heard == (side != 0, side != 1)
    assert health.review(SCAN_NS + 24 * PERIOD_NS).reasons == (reason,)


@pytest.mark.parametrize(
    ("sight", "reason", "halts"),
    [
        (Sight.BLIND, HealthReason.BLIND, True),
        (Sight.UNPROVEN, HealthReason.NEVER_SEEN, True),
        (Sight.THIN, HealthReason.THIN, False),
    ],
)
def test_a_lidar_that_does_not_see_is_said_as_long_as_it_lasts(sight, reason, halts):
    health = fed(GOOD)
    health.sees(sight)
    for i in range(2, 50):
        health.scan(i * SCAN_NS, *GOOD)
        health.review(i * SCAN_NS)
        assert health.current.reasons == (reason,) and health.current.halts == halts
    assert health.sure_until_ns(49 * SCAN_NS) == (1 if halts else 49) * SCAN_NS
    health.sees(Sight.CLEAR)
    health.scan(50 * SCAN_NS, *GOOD)
    health.review(50 * SCAN_NS)
    assert health.current.state == "ok"
