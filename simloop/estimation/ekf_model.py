"""Define the filter's models of a skid-steered, tracked robot, and its control period (compiled).

The state (9,) is, in this order:

    x, y, yaw    base_link in map, m and rad
    v            forward speed, m/s
    w            yaw rate, rad/s
    b            gyro bias, rad/s
    k, c, x_v    the tracks' instantaneous centres of rotation: gauge ratio, offset, m, and
                 longitudinal place, m (Martinez & Mandow 2005)

A tracked robot can only turn if its tracks slip sideways. It turns as if its gauge B were k times
as wide. The centre of the turn need not lie in the robot's middle:

    y_l, y_r = c +- k B / 2     lateral place of the left and the right track's centre of rotation
    v_y = -x_v w                lateral speed, with the vehicle's own centre x_v to the front

The centres are estimated online as by Pentzer, Brennan & Reichard (2014). k and c are observable
from the wheels together with gyro and LiDAR, x_v from the LiDAR alone, and all of them only while
the robot turns. They change with the ground. So their process noise grows with the distance that
the belts move and not with time: while the robot stands, it does not grow.

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
LEAST_GAUGE, MOST_GAUGE = 0.2, 10.0
"""Bounds of the gauge ratio k: far outside the 1 to 2 for which the drive makes good."""

SLIPPING_VAR = 100.0  # variance of a slipping belt's speed, (m/s)^2: it is nearly ignored
_BELTS_M = 0.2  # distance that a belt moves per radian of a turn on the spot, m/rad

# Columns of a period's inputs: readings, their variances, and whether each belt was refused.
INPUTS = 11
ACCEL, DT, LEFT, RIGHT, GYRO, LEFT_VAR, RIGHT_VAR = range(7)
GYRO_VAR, SHOVE_VAR, NO_LEFT, NO_RIGHT = range(7, INPUTS)


@njit(cache=True)
def motion(x: FloatArray, accel: float, dt: float) -> FloatArray:
    """Predict the state over one period, with the heading in the middle of the period.

    Args:
        x: (9,) state.
        accel: Forward acceleration, m/s^2.
        dt: The period, s.

    Returns:
        (9,) state at the end of the period.
    """
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
    """Compute the derivative of ``motion`` with respect to the state.

    Args:
        x: (9,) state.
        accel: Forward acceleration, m/s^2.
        dt: The period, s.

    Returns:
        (9, 9).
    """
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
    """Compute the process noise of one period.

    Args:
        x: (9,) state.
        dt: The period, s.
        walk: (7,) densities of the random walks: speed, m/s^1.5; yaw rate, rad/s^1.5; lateral
            slip, m per square root of a second and per rad/s of yaw rate (tracks slip sideways
            only in turns); b, rad/s^1.5; k, c, x_v per square root of a metre of belt motion.
        shove_var: Position noise of a robot that is pushed, m^2/s along each axis.

    Returns:
        (9, 9) covariance.
    """
    noise = np.zeros((STATES, STATES))
    cos, sin = math.cos(x[YAW]), math.sin(x[YAW])
    along = walk[0] ** 2 * dt**3 / 3.0 + shove_var * dt
    aside = (walk[2] * x[RATE]) ** 2 * dt + shove_var * dt
    noise[X, X] = along * cos * cos + aside * sin * sin
    noise[Y, Y] = along * sin * sin + aside * cos * cos
    noise[X, Y] = noise[Y, X] = (along - aside) * sin * cos
    # White noise in acceleration, integrated over the period. Without these cross terms, a gyro
    # reading at the end of the period would correct the rate but not the yaw.
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
    """Compute the expected speed of a belt.

    Args:
        x: (9,) state.
        gauge: Nominal distance of the tracks, m.
        side: +1 left, -1 right.

    Returns:
        Speed of the belt, m/s.
    """
    return x[SPEED] - (x[OFFSET] + side * 0.5 * gauge * x[GAUGE]) * x[RATE]


@njit(cache=True)
def wheel_jacobian(x: FloatArray, gauge: float, side: float) -> FloatArray:
    """Compute the derivative of ``wheel_speed`` with respect to the state.

    Args:
        x: (9,) state.
        gauge: Nominal distance of the tracks, m.
        side: +1 left, -1 right.

    Returns:
        (9,).
    """
    row = np.zeros(STATES)
    row[SPEED] = 1.0
    row[RATE] = -(x[OFFSET] + side * 0.5 * gauge * x[GAUGE])
    row[GAUGE], row[OFFSET] = -side * 0.5 * gauge * x[RATE], -x[RATE]
    return row


@njit(cache=True)
def gyro_jacobian() -> FloatArray:
    """Return the derivative of a gyro's reading, w + b, with respect to the state.

    Returns:
        (9,).
    """
    row = np.zeros(STATES)
    row[RATE] = row[BIAS] = 1.0
    return row


# The kernels use plain loops. For matrices this small, a call of BLAS costs more than the sums. In
# the control loop it costs several times more, because its code is no longer in the cache.


@njit(cache=True)
def with_pose_error(covariance: FloatArray, error: FloatArray) -> FloatArray:
    """Add an independent error of the pose to a covariance.

    Args:
        covariance: (9, 9) of the state.
        error: (3, 3) covariance of the error in x, y, yaw.

    Returns:
        (9, 9), a new array.
    """
    out = covariance.copy()
    for i in range(3):
        for j in range(3):
            out[i, j] += error[i, j]
    return out


@njit(cache=True)
def correct_scalar(
    x: FloatArray, p: FloatArray, row: FloatArray, residual: float, variance: float
) -> None:
    """Correct a belief with one scalar measurement, in place.

    The covariance is updated in Joseph's form, (I - K h) P (I - K h)^T + K R K^T, row by row.

    Args:
        x: (9,) state, changed in place.
        p: (9, 9) covariance, changed in place.
        row: (9,) Jacobian h of the measurement.
        residual: Measured value minus expected value.
        variance: Variance of the measurement.
    """
    ph = times(p, row)
    total = dot(row, ph) + variance
    if not total > 0.0:
        return  # belief and measurement both claim to be exact: there is nothing to weigh
    gain = ph / total
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
    """Mark the belts that contradict the belief, because they slip or are stuck.

    If both belts together are too far off, the worse one is refused. The other one is refused too
    unless it fits the belief well by itself: tracks that start with a jerk both slip, and one of
    them alone would give a wrong speed.

    Args:
        x: (9,) predicted state.
        p: (9, 9) covariance of the predicted state.
        inputs: (11,) the period's inputs; ``NO_LEFT`` and ``NO_RIGHT`` are written.
        gauge: Nominal distance of the tracks, m.
        gates: (3,) largest squared Mahalanobis distance of one belt alone, the same of both
            together, and the additional variance, (m/s)^2, of a single count compared with the
            mean of several.
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
    """Predict a belief over one period and correct it with gyro and wheels.

    The equations are those of filterpy's ``predict`` and ``update``, first with the gyro, then with
    each belt that passes its gate. Measurements are used one scalar at a time, so no matrix is
    inverted.

    Args:
        x: (9,) state.
        covariance: (9, 9) covariance of the state.
        inputs: (11,) the period's inputs; the gates mark in it which belts they refused. A missing
            reading has a nearly infinite variance.
        walk: (7,) see ``motion_noise``.
        gauge: Nominal distance of the tracks, m.
        gates: (3,) see ``gate_wheels``.

    Returns:
        State (9,) and covariance (9, 9) at the end of the period, as new arrays.
    """
    dt, accel = inputs[DT], inputs[ACCEL]
    p = sandwich(motion_jacobian(x, accel, dt), covariance)
    p += motion_noise(x, dt, walk, inputs[SHOVE_VAR])
    x = motion(x, accel, dt)
    # The gyro comes first: when the yaw rate is known, the gate of the belts is sharper.
    correct_scalar(x, p, gyro_jacobian(), inputs[GYRO] - x[RATE] - x[BIAS], inputs[GYRO_VAR])
    gate_wheels(x, p, inputs, gauge, gates)
    for belt in range(2):
        side = 1.0 - 2.0 * belt
        # A refused belt still corrects, but with a negligible gain: the arithmetic is the same.
        variance = SLIPPING_VAR if inputs[NO_LEFT + belt] else inputs[LEFT_VAR + belt]
        residual = inputs[LEFT + belt] - wheel_speed(x, gauge, side)
        correct_scalar(x, p, wheel_jacobian(x, gauge, side), residual, variance)
    x[YAW] = wrap_angle(x[YAW])
    # Readings that contradict each other can drive the centres of rotation to where no vehicle has
    # them; with a gauge of 0 the belts would say nothing any more.
    x[GAUGE] = min(max(x[GAUGE], LEAST_GAUGE), MOST_GAUGE)
    # Rounding slowly makes the covariance asymmetric, so it is made symmetric again.
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
    """Filter a part of a ring buffer again, and overwrite the beliefs in it.

    Args:
        states: (n, 9) ring buffer of states.
        covariances: (n, 9, 9) ring buffer of covariances.
        inputs: (n, 11) ring buffer of inputs.
        first: Row of the belief to start from.
        count: Number of periods after it.
        walk: (7,) see ``motion_noise``.
        gauge: Nominal distance of the tracks, m.
        gates: (3,) see ``gate_wheels``.

    Returns:
        The last state (9,) and covariance (9, 9).
    """
    x, p, n = states[first].copy(), covariances[first].copy(), states.shape[0]
    for step in range(1, count + 1):
        row = (first + step) % n
        x, p = predict_and_correct(x, p, inputs[row], walk, gauge, gates)
        states[row], covariances[row] = x, p
    return x, p
