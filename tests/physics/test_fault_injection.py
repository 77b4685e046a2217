"""What a fault does to the readings while it lasts, and what they are when it is over."""

from __future__ import annotations

import numpy as np

from simloop.messages import EncoderReading, ImuReading
from simloop.physics.faults import Fault, Faults


def faults(*given):
    return Faults([Fault(**one) for one in given], np.random.default_rng(0))


def counts_heard(it, times, right_rate=200):
    """(left, right) counts at times, s, of belts that turn evenly."""
    readings = [
        it.encoders(EncoderReading(round(1e9 * t), round(100 * t), round(right_rate * t)))
        for t in times
    ]
    return [(reading.left_counts, reading.right_counts) for reading in readings]


def test_an_encoder_that_was_stuck_counts_on_from_where_it_stood():
    """Its counter missed the pulses: it does not jump to where the belt truly is."""
    it = faults({"kind": "encoder_stuck", "at_s": 1.0, "for_s": 1.0, "side": "right"})
    heard = counts_heard(it, (0.5, 1.0, 1.5, 1.99, 2.0, 2.5))
    assert [right for _, right in heard] == [100, 200, 200, 200, 202, 302]
    assert [left for left, _ in heard] == [50, 100, 150, 199, 200, 250]


def test_an_encoder_may_stick_again_and_both_may():
    it = faults(
        {"kind": "encoder_stuck", "at_s": 1.0, "for_s": 1.0, "side": "left"},
        {"kind": "encoder_stuck", "at_s": 3.0, "for_s": 1.0, "side": "left"},
        {"kind": "encoder_stuck", "at_s": 3.0, "for_s": 1.0, "side": "right"},
    )
    heard = counts_heard(it, (0.0, 1.0, 1.99, 2.0, 3.0, 3.99, 4.0))
    assert [left for left, _ in heard] == [0, 100, 100, 101, 201, 201, 202]
    assert [right for _, right in heard] == [0, 200, 398, 400, 600, 600, 602]


def test_an_encoder_that_is_stuck_while_nothing_comes_has_missed_those_pulses_too():
    it = faults(
        {"kind": "encoders_silent", "at_s": 1.0, "for_s": 1.0},
        {"kind": "encoder_stuck", "at_s": 1.0, "for_s": 0.5, "side": "left"},
    )
    heard = counts_heard(it, (0.5, 1.0, 1.49, 1.5, 2.0))
    assert heard == [(50, 100), (50, 100), (50, 100), (50, 100), (151, 400)]


def test_what_is_silent_from_the_start_repeats_its_first_reading():
    it = faults({"kind": "encoders_silent", "at_s": 0.0}, {"kind": "imu_silent", "at_s": 0.0})
    first = EncoderReading(0, 1, 2)
    assert it.encoders(first) is first
    assert it.encoders(EncoderReading(10_000_000, 3, 4)) is first
    still = ImuReading(0, np.zeros(3), np.zeros(3))
    assert it.imu(still) is still
    assert it.imu(ImuReading(10_000_000, np.ones(3), np.ones(3))) is still
