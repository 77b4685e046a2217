"""Take an IMU's readings only within its measuring range; beyond it they say nothing.

A reading beyond the range is treated as missing, as if the IMU were silent: the filter would
otherwise follow it, because a gyro has no other sensor of its rate to contradict it.
"""

from __future__ import annotations

import numpy as np

from simloop.messages import ImuReading

GYRO_RADPS = 35.0
"""Largest rate that the MPU-9250 measures, 2000 degrees/s, in rad/s."""

ACCEL_MPS2 = 157.0
"""Largest acceleration that the MPU-9250 measures, 16 g, in m/s^2."""


class ImuRange:
    """The last reading within the measuring range."""

    def __init__(self) -> None:
        self._last = ImuReading(-1, np.zeros(3), np.zeros(3))

    def believed(self, reading: ImuReading) -> ImuReading:
        """Replace a reading that cannot be right.

        Args:
            reading: What the IMU says.

        Returns:
            The reading, or the last one that was within the range; its stamp is old.
        """
        # A NaN fails these comparisons.
        if all(-GYRO_RADPS <= one <= GYRO_RADPS for one in reading.gyro_radps.tolist()) and all(
            -ACCEL_MPS2 <= one <= ACCEL_MPS2 for one in reading.accel_mps2.tolist()
        ):
            self._last = reading
        return self._last
