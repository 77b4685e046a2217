"""Estimate a point of nearly constant velocity with a Kalman filter (white-noise acceleration).

The model is that of Bar-Shalom et al. 2001, Sec. 6.3: the acceleration is constant over each step.
"""

from __future__ import annotations

import math

import numpy as np
from filterpy.kalman import KalmanFilter

from simloop.messages import FloatArray


class ConstantVelocity:
    """Kalman filter of the position and velocity of one point; state x, y, vx, vy in map."""

    def __init__(
        self,
        place_m: FloatArray,
        t_ns: int,
        place_std_m: float,
        speed_std_mps: float,
        acceleration_mps2: float,
    ) -> None:
        """Start at a first observation, with zero velocity.

        Args:
            place_m: (2,) observed position in map, m.
            t_ns: Time of the observation, ns.
            place_std_m: Standard deviation of an observed position along one axis, m.
            speed_std_mps: Standard deviation of the first velocity along one axis, m/s.
            acceleration_mps2: Standard deviation of the acceleration along one axis, m/s^2.
        """
        self._t_ns, self._acceleration = t_ns, acceleration_mps2
        self._filter = kf = KalmanFilter(4, 2)
        kf.x = np.concatenate((place_m, np.zeros(2)))
        kf.P = np.diag([place_std_m**2] * 2 + [speed_std_mps**2] * 2)
        kf.H, kf.R = np.eye(2, 4), place_std_m**2 * np.eye(2)

    @property
    def place(self) -> FloatArray:
        """(2,) position in map at the last predicted time, m."""
        return self._filter.x[:2]

    @property
    def velocity(self) -> FloatArray:
        """(2,) velocity in map, m/s."""
        return self._filter.x[2:]

    @property
    def std_m(self) -> float:
        """Standard deviation of the position along one axis, m."""
        return math.sqrt(0.5 * float(self._filter.P[0, 0] + self._filter.P[1, 1]))

    def place_at(self, t_ns: int) -> FloatArray:
        """Extrapolate the position to another time at constant velocity.

        The state does not change.

        Args:
            t_ns: The time, ns.

        Returns:
            (2,) in map, m.
        """
        return self.place + 1e-9 * (t_ns - self._t_ns) * self.velocity

    def predict(self, t_ns: int) -> None:
        """Predict the state to a later time.

        Args:
            t_ns: The time, ns, not before the last one.
        """
        dt = 1e-9 * (t_ns - self._t_ns)
        self._t_ns = t_ns
        motion = np.eye(4)
        motion[0, 2] = motion[1, 3] = dt
        gain = np.concatenate((0.5 * dt**2 * np.eye(2), dt * np.eye(2)))
        self._filter.predict(F=motion, Q=self._acceleration**2 * gain @ gain.T)

    def update(self, place_m: FloatArray) -> None:
        """Correct the state with an observation at the last predicted time.

        Args:
            place_m: (2,) observed position in map, m.
        """
        self._filter.update(place_m)
