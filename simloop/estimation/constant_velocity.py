"""A Kalman filter for a point that mostly keeps its velocity: its acceleration is white noise.

Bar-Shalom et al. 2001, Sec. 6.3: the acceleration is constant over each step.
"""

from __future__ import annotations

import math

import numpy as np
from filterpy.kalman import KalmanFilter

from simloop.messages import FloatArray


class ConstantVelocity:
    """State x, y, vx, vy in map. place_m: (2,) where it was seen at ``t_ns``, at rest for all that
    is known; place_std_m of a sighting, speed_std_mps of the velocity at first, acceleration_mps2:
    standard deviations, one axis."""

    def __init__(
        self,
        place_m: FloatArray,
        t_ns: int,
        place_std_m: float,
        speed_std_mps: float,
        acceleration_mps2: float,
    ) -> None:
        self._t_ns, self._acceleration = t_ns, acceleration_mps2
        self._filter = kf = KalmanFilter(4, 2)
        kf.x = np.concatenate((place_m, np.zeros(2)))
        kf.P = np.diag([place_std_m**2] * 2 + [speed_std_mps**2] * 2)
        kf.H, kf.R = np.eye(2, 4), place_std_m**2 * np.eye(2)

    @property
    def place(self) -> FloatArray:
        """(2,) m, in map, at the instant that it was last brought to."""
        return self._filter.x[:2]

    @property
    def velocity(self) -> FloatArray:
        """(2,) m/s, in map."""
        return self._filter.x[2:]

    @property
    def std_m(self) -> float:
        """Of its place, one axis."""
        return math.sqrt(0.5 * float(self._filter.P[0, 0] + self._filter.P[1, 1]))

    def place_at(self, t_ns: int) -> FloatArray:
        """(2,) m, where it is at another instant if it goes on as it goes."""
        return self.place + 1e-9 * (t_ns - self._t_ns) * self.velocity

    def predict(self, t_ns: int) -> None:
        """Bring it to an instant."""
        dt = 1e-9 * (t_ns - self._t_ns)
        self._t_ns = t_ns
        motion = np.eye(4)
        motion[0, 2] = motion[1, 3] = dt
        gain = np.concatenate((0.5 * dt**2 * np.eye(2), dt * np.eye(2)))
        self._filter.predict(F=motion, Q=self._acceleration**2 * gain @ gain.T)

    def update(self, place_m: FloatArray) -> None:
        """It has been seen, at the instant that it was brought to, at ``place_m`` (2,)."""
        self._filter.update(place_m)
