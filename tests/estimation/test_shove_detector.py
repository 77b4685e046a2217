"""The shove detector: a push is noticed, a bump of one reading is not."""

from __future__ import annotations

from simloop.estimation.shove_detector import ShoveDetector

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
