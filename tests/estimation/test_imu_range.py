"""Readings beyond the IMU's measuring range count as missing."""

from __future__ import annotations

import numpy as np
import pytest

from simloop.estimation.imu_range import ACCEL_MPS2, GYRO_RADPS, ImuRange
from simloop.messages import ImuReading


def _reading(t_ns, rate=0.1, accel=1.0):
    return ImuReading(t_ns, np.array([0.0, 0.0, rate]), np.array([accel, 0.0, 9.81]))


@pytest.mark.parametrize("wrong", [{"rate": -GYRO_RADPS - 1.0}, {"accel": ACCEL_MPS2 + 1.0},
                                   {"rate": np.nan}, {"accel": np.inf}])  # fmt: skip
def test_a_reading_beyond_the_range_is_replaced_by_the_last_one_within(wrong):
    within = ImuRange()
    assert within.believed(_reading(0, **wrong)).t_ns < 0
    good = _reading(1)
    assert within.believed(good) is good
    assert within.believed(_reading(2, **wrong)) is good
    better = _reading(3, rate=GYRO_RADPS)
    assert within.believed(better) is better
