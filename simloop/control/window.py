"""The acceleration window: what one control period may change of a velocity."""

from __future__ import annotations

from numba import njit

from simloop.messages import FloatArray

_SLACK = 1e-12


@njit(cache=True)
def step_towards(
    last: FloatArray, speed: float, rate: float, window: FloatArray
) -> tuple[float, float]:
    """Go from the last velocity towards another one as far as one period allows.

    Args:
        last: (2,) velocity of the last period, m/s and rad/s.
        speed: Wanted speed, m/s.
        rate: Wanted yaw rate, rad/s.
        window: (4,) largest change of speed in a period when speeding up and when slowing down,
            m/s, largest change of the yaw rate and largest yaw rate, rad/s.

    Returns:
        Speed, m/s, and yaw rate, rad/s.
    """
    rate = min(max(rate, -window[3]), window[3])
    most = window[0] if abs(speed) > abs(last[0]) else window[1]
    # Through zero only by way of zero: the two halves have different limits.
    if speed * last[0] < 0.0:
        speed, most = 0.0, window[1]
    forward = last[0] + min(max(speed - last[0], -most), most)
    turning = last[1] + min(max(rate - last[1], -window[2]), window[2])
    return forward, turning


@njit(cache=True)
def step_straight(
    last: FloatArray, speed: float, rate: float, window: FloatArray
) -> tuple[float, float]:
    """Go towards another velocity with both components in step, so that an arc is kept.

    From rest the robot then moves on the arc that was examined. With each component as fast as it
    may change, it would turn on the spot first.

    Args:
        last: (2,) velocity of the last period, m/s and rad/s.
        speed: Wanted speed, m/s.
        rate: Wanted yaw rate, rad/s.
        window: (4,) as in `step_towards`.

    Returns:
        Speed, m/s, and yaw rate, rad/s.
    """
    forward, turning = step_towards(last, speed, rate, window)
    part = 1.0
    if speed != last[0]:
        part = min(part, (forward - last[0]) / (speed - last[0]))
    if rate != last[1]:
        part = min(part, (turning - last[1]) / (rate - last[1]))
    part = max(part, 0.0)
    return last[0] + part * (speed - last[0]), last[1] + part * (rate - last[1])


@njit(cache=True)
def brake_along(last: FloatArray, window: FloatArray) -> tuple[float, float]:
    """Brake along the arc of the last velocity as hard as one period allows.

    Args:
        last: (2,) velocity of the last period, m/s and rad/s.
        window: (4,) as in `step_towards`.

    Returns:
        Speed, m/s, and yaw rate, rad/s: a part of the last ones.
    """
    part = 1.0
    if last[0] != 0.0:
        part = min(part, window[1] / abs(last[0]))
    if last[1] != 0.0:
        part = min(part, window[2] / abs(last[1]))
    return last[0] * (1.0 - part), last[1] * (1.0 - part)


@njit(cache=True)
def is_reachable(last: FloatArray, speed: float, rate: float, window: FloatArray) -> bool:
    """Say whether one period can bring the robot from the last velocity to another one.

    Args:
        last: (2,) velocity of the last period, m/s and rad/s.
        speed: Speed, m/s.
        rate: Yaw rate, rad/s.
        window: (4,) as in `step_towards`.

    Returns:
        True if both changes are within the window.
    """
    if speed * last[0] < 0.0:
        return False
    most = window[0] if abs(speed) > abs(last[0]) else window[1]
    return abs(speed - last[0]) <= most + _SLACK and abs(rate - last[1]) <= window[2] + _SLACK
