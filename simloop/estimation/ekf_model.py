"""The filter's models of a skid-steered, tracked robot, and one whole period of it, compiled.

State, in this order: x, y, yaw of base_link in map; forward speed v; yaw rate w; gyro bias b; and
the tracks' instantaneous centres of rotation (Martinez & Mandow 2005), estimated online as
Pentzer, Brennan & Reichard (2014) do. A track that turns must slip sideways: the robot turns as if
its gauge were k = 1 / chi times as wide, about a point that need not lie in its middle:

    y_l, y_r = c +- k B / 2     of the left and the right track's centre; k gauge ratio, c offset
    x_v                         of the vehicle's own centre: v_y = -x_v w

k and c are seen by the wheels against gyro and LiDAR, x_v by the LiDAR alone, all of them only
while the robot turns. What they change with is the ground, so their walk is one over the way that
the belts have come, not over time: who stands forgets nothing.

    predict   v' = a_x (accelerometer), w' = b' = k' = c' = x_v' = noise,
              x' = v cos yaw + x_v w sin yaw, y' = v sin yaw - x_v w cos yaw
    gyro      w + b
    wheels    v_left = v - y_l w,  v_right = v - y_r w
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.geometry.se2 import wrap_angle
from simloop.geometry.small_matrices import dot, pair_mahalanobis, sandwich, times
from simloop.messages import FloatArray

X, Y, YAW, SPEED, RATE, BIAS, GAUGE, OFFSET, ICR_X = range(9)
STATES = 9
SLIPPING_VAR = 100.0  # (m/s)^2, of belts that slip: all but ignored
_BELTS_M = 0.2  # m of belt a radian on the spot

# A period's inputs, one row: what went in, and which of the wheels was refused.
INPUTS = 11
ACCEL, DT, LEFT, RIGHT, GYRO, LEFT_VAR, RIGHT_VAR = range(7)
GYRO_VAR, SHOVE_VAR, NO_LEFT, NO_RIGHT = range(7, INPUTS)


@njit(cache=True)
def motion(x: FloatArray, accel: float, dt: float) -> FloatArray:
    """The state (9,) one period dt, s, later under forward acceleration ``accel``, m/s^2."""
    out = x.copy()
    speed, yaw = x[SPEED] + 0.5 * accel * dt, x[YAW] + 0.5 * x[RATE] * dt
    aside = -x[ICR_X] * x[RATE]
    cos, sin = math.cos(yaw), math.sin(yaw)
    out[X] += (speed * cos - aside * sin) * dt
    out[Y] += (speed * sin + aside * cos) * dt
    out[YAW] = wrap_angle(x[YAW] + x[RATE] * dt)
    out[SPEED] += accel * dt
    return out


@njit(cache=True)
def motion_jacobian(x: FloatArray, accel: float, dt: float) -> FloatArray:
    """(9, 9) d motion / d x."""
    jacobian = np.eye(STATES)
    speed, yaw = x[SPEED] + 0.5 * accel * dt, x[YAW] + 0.5 * x[RATE] * dt
    aside = -x[ICR_X] * x[RATE]
    cos, sin = math.cos(yaw) * dt, math.sin(yaw) * dt
    by_yaw_x, by_yaw_y = -speed * sin - aside * cos, speed * cos - aside * sin
    jacobian[X, YAW], jacobian[Y, YAW] = by_yaw_x, by_yaw_y
    jacobian[X, SPEED], jacobian[Y, SPEED] = cos, sin
    jacobian[X, RATE] = 0.5 * dt * by_yaw_x + x[ICR_X] * sin
    jacobian[Y, RATE] = 0.5 * dt * by_yaw_y - x[ICR_X] * cos
    jacobian[X, ICR_X], jacobian[Y, ICR_X] = x[RATE] * sin, -x[RATE] * cos
    jacobian[YAW, RATE] = dt
    return jacobian


@njit(cache=True)
def motion_noise(x: FloatArray, dt: float, walk: FloatArray, shove_var: float) -> FloatArray:
    """(9, 9) process noise of one period.

    walk: (7,) densities of speed, yaw rate, sideways, b, k, c, x_v, the last three per root metre
    of belt. A track slips sideways only as the robot turns, so that noise scales with the yaw rate;
    shove_var: m^2 a second of a body that something pushes, any way.
    """
    noise = np.zeros((STATES, STATES))
    cos, sin = math.cos(x[YAW]), math.sin(x[YAW])
    along = walk[0] ** 2 * dt**3 / 3.0 + shove_var * dt
    aside = (walk[2] * x[RATE]) ** 2 * dt + shove_var * dt
    noise[X, X] = along * cos * cos + aside * sin * sin
    noise[Y, Y] = along * sin * sin + aside * cos * cos
    noise[X, Y] = noise[Y, X] = (along - aside) * sin * cos
    # White noise in acceleration, integrated over the period: without these cross terms a gyro
    # reading at the period's end would correct the rate but not the yaw that it has brought.
    noise[X, SPEED] = noise[SPEED, X] = walk[0] ** 2 * dt**2 / 2.0 * cos
    noise[Y, SPEED] = noise[SPEED, Y] = walk[0] ** 2 * dt**2 / 2.0 * sin
    noise[SPEED, SPEED] = walk[0] ** 2 * dt
    noise[YAW, YAW] = walk[1] ** 2 * dt**3 / 3.0
    noise[YAW, RATE] = noise[RATE, YAW] = walk[1] ** 2 * dt**2 / 2.0
    noise[RATE, RATE] = walk[1] ** 2 * dt
    noise[BIAS, BIAS] = walk[3] ** 2 * dt
    way = (abs(x[SPEED]) + _BELTS_M * abs(x[RATE])) * dt
    for i in range(3):
        noise[GAUGE + i, GAUGE + i] = walk[4 + i] ** 2 * way
    return noise


@njit(cache=True)
def wheel_speed(x: FloatArray, gauge: float, side: float) -> float:
    """m/s expected of a belt; side: +1 left, -1 right."""
    return x[SPEED] - (x[OFFSET] + side * 0.5 * gauge * x[GAUGE]) * x[RATE]


@njit(cache=True)
def wheel_jacobian(x: FloatArray, gauge: float, side: float) -> FloatArray:
    """(9,) d wheel_speed / d x."""
    row = np.zeros(STATES)
    row[SPEED] = 1.0
    row[RATE] = -(x[OFFSET] + side * 0.5 * gauge * x[GAUGE])
    row[GAUGE], row[OFFSET] = -side * 0.5 * gauge * x[RATE], -x[RATE]
    return row


@njit(cache=True)
def gyro_jacobian() -> FloatArray:
    """(9,) of a gyro's reading, w + b, by x."""
    row = np.zeros(STATES)
    row[RATE] = row[BIAS] = 1.0
    return row


# Plain loops: for matrices as small as these BLAS costs more in calls and buffers than in sums,
# and in the loop, where it finds its code out of the cache each time, several times as much.


@njit(cache=True)
def with_pose_error(covariance: FloatArray, error: FloatArray) -> FloatArray:
    """covariance (9, 9) with an independent error of the pose, (3, 3), on top; a new array."""
    out = covariance.copy()
    for i in range(3):
        for j in range(3):
            out[i, j] += error[i, j]
    return out


@njit(cache=True)
def correct_scalar(
    x: FloatArray, p: FloatArray, row: FloatArray, residual: float, variance: float
) -> None:
    """Correct x (9,) and p (9, 9), in place, with one figure whose Jacobian is ``row`` (9,).

    Joseph's form, (I - K h) P (I - K h)^T + K R K^T, a row at a time.
    """
    ph = times(p, row)
    gain = ph / (dot(row, ph) + variance)
    n = x.shape[0]
    for i in range(n):
        x[i] += gain[i] * residual
        for j in range(n):
            p[i, j] -= gain[i] * ph[j]
        left = dot(row, p[i])
        for j in range(n):
            p[i, j] += (variance * gain[i] - left) * gain[j]


@njit(cache=True)
def gate_wheels(
    x: FloatArray, p: FloatArray, inputs: FloatArray, gauge: float, gates: FloatArray
) -> None:
    """Mark in a period's inputs which belts do not go with the belief: they slip, or are stuck.

    gates: (3,) squared Mahalanobis distances that one and two belts may have, and (m/s)^2 by which
    one reading alone errs more than several that follow one another. Where both together
    are too far off, the worse is left out; the other too, unless it goes well with the belief by
    itself: tracks that start with a jerk both slip, and half of that told would be a wrong speed.
    """
    left, right = wheel_jacobian(x, gauge, 1.0), wheel_jacobian(x, gauge, -1.0)
    by_left, by_right = times(p, left), times(p, right)
    a = dot(left, by_left) + inputs[LEFT_VAR] + gates[2]
    c = dot(right, by_right) + inputs[RIGHT_VAR] + gates[2]
    r = inputs[LEFT] - wheel_speed(x, gauge, 1.0)
    s = inputs[RIGHT] - wheel_speed(x, gauge, -1.0)
    inputs[NO_LEFT] = inputs[NO_RIGHT] = 0.0
    if pair_mahalanobis(r, s, a, dot(left, by_right), c) <= gates[1]:
        return
    worse_left = r * r / a > s * s / c
    if worse_left or r * r / a > gates[0]:
        inputs[NO_LEFT] = 1.0
    if not worse_left or s * s / c > gates[0]:
        inputs[NO_RIGHT] = 1.0


@njit(cache=True)
def predict_and_correct(
    x: FloatArray,
    covariance: FloatArray,
    inputs: FloatArray,
    walk: FloatArray,
    gauge: float,
    gates: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """State (9,) and covariance (9, 9) one period later, corrected with gyro and wheels.

    The equations of filterpy's ``predict`` and of its ``update``, first with the gyro, then with
    each belt that passes its gate; one figure at a time, so that nothing need be inverted. inputs:
    (11,) of the period, in which the gates note what they refused. What has not come has a
    variance that is all but infinite.
    """
    dt, accel = inputs[DT], inputs[ACCEL]
    p = sandwich(motion_jacobian(x, accel, dt), covariance)
    p += motion_noise(x, dt, walk, inputs[SHOVE_VAR])
    x = motion(x, accel, dt)
    correct_scalar(x, p, gyro_jacobian(), inputs[GYRO] - x[RATE] - x[BIAS], inputs[GYRO_VAR])
    gate_wheels(x, p, inputs, gauge, gates)
    for belt in range(2):
        side = 1.0 - 2.0 * belt
        variance = SLIPPING_VAR if inputs[NO_LEFT + belt] else inputs[LEFT_VAR + belt]
        residual = inputs[LEFT + belt] - wheel_speed(x, gauge, side)
        correct_scalar(x, p, wheel_jacobian(x, gauge, side), residual, variance)
    x[YAW] = wrap_angle(x[YAW])
    for i in range(STATES):
        for j in range(i):
            p[i, j] = p[j, i] = 0.5 * (p[i, j] + p[j, i])
    return x, p


@njit(cache=True)
def replay(
    states: FloatArray,
    covariances: FloatArray,
    inputs: FloatArray,
    first: int,
    count: int,
    walk: FloatArray,
    gauge: float,
    gates: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Run ``count`` periods on from row ``first`` of the rings (n, 9), (n, 9, 9), (n, 11).

    The beliefs in the rows after it are written anew; the last one is returned, as new arrays.
    """
    x, p, n = states[first].copy(), covariances[first].copy(), states.shape[0]
    for step in range(1, count + 1):
        row = (first + step) % n
        x, p = predict_and_correct(x, p, inputs[row], walk, gauge, gates)
        states[row], covariances[row] = x, p
    return x, p
