"""The shove detector: a push is noticed, a bump of one reading is not. The slide detector."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simloop.estimation.shove_detector import ShoveDetector, SlideDetector

PERIOD_NS = 10_000_000


def test_rest_and_single_bumps_are_no_push():
    detector = ShoveDetector()
    for i in range(100):
        assert not detector.update(i * PERIOD_NS, 5.0 if i % 10 == 0 else 0.0)
        assert detector.position_noise(i * PERIOD_NS) == 0.0


def test_a_push_either_way_opens_the_position_and_is_over_in_the_end():
    for sign in (1.0, -1.0):
        detector = ShoveDetector()
        pushed = [detector.update(i * PERIOD_NS, 4.0 * sign) for i in range(10)]
        assert pushed == [False, True] + [True] * 8
        last_ns = 9 * PERIOD_NS
        assert detector.position_noise(last_ns + 299_000_000) > 0.0
        assert detector.position_noise(last_ns + 300_000_000) == 0.0


def slid(aside_mps, *, rate=0.0, speed=0.3, driven=None, certain=True, seconds=0.5):
    """A robot that goes on an arc and drifts to its left besides."""
    detector, (x, y, yaw) = SlideDetector(), (0.0, 0.0, 0.4)
    for i in range(round(seconds * 100)):
        x += 0.01 * (speed * math.cos(yaw) - aside_mps * math.sin(yaw))
        y += 0.01 * (speed * math.sin(yaw) + aside_mps * math.cos(yaw))
        yaw += 0.01 * rate
        state = np.array([x, y, yaw, speed if driven is None else driven])
        detector.update((i + 1) * PERIOD_NS, state, certain)
    return detector.slippery(round(seconds * 1e9))


@pytest.mark.parametrize("rate", [0.0, 0.5, -1.5])
def test_an_arc_is_no_slide_and_drifting_off_it_is(rate):
    assert not slid(0.0, rate=rate) and not slid(0.08, rate=rate)
    assert slid(0.18, rate=rate) and slid(-0.18, rate=rate)


def test_belts_that_spin_or_lock_are_a_slide_too():
    assert slid(0.0, driven=0.0) and slid(0.0, speed=0.0, driven=0.3)


def test_nothing_is_concluded_from_a_pose_that_no_fix_holds():
    assert not slid(0.5, certain=False)


def test_the_ground_stays_slippery_for_three_seconds():
    detector = SlideDetector()
    for i in range(40):
        detector.update(i * PERIOD_NS, np.array([0.0, 0.003 * i, 0.0, 0.0]), True)
    last_ns = 39 * PERIOD_NS
    assert detector.slippery(last_ns + 2_999_000_000)
    assert not detector.slippery(last_ns + 3_000_000_000)
