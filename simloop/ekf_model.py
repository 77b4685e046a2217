"""The filter's models of a skid-steered, tracked robot, and one whole period of it, compiled.

State, in this order: x, y, yaw of base_link in map; forward speed v; yaw rate w; gyro bias b;
gauge ratio k, the slip term. A track that turns must slip sideways, which makes the robot
turn as if its gauge were wider: k B = y_l - y_r, the distance between the tracks' instantaneous
centres of rotation (Martinez & Mandow 2005), so k = 1 / chi. It is estimated online.

    predict   v' = a_x (accelerometer), w' = b' = k' = noise, x' = v cos yaw, y' = v sin yaw
    wheels    v_left = v - k B w / 2,  v_right = v + k B w / 2;  gyro = w + b
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.se2 import wrap_angle

X, Y, YAW, SPEED, RATE, BIAS, GAUGE = range(7)
SLIPPING_VAR = 100.0  # (m/s)^2, of belts that slip: all but ignored


@njit(cache=True)
def motion(x: FloatArray, accel: float, dt: float) -> FloatArray:
    """The state (7,) one period dt, s, later under forward acceleration ``accel``, m/s^2."""
    out = x.copy()
    speed, yaw = x[SPEED] + 0.5 * accel * dt, x[YAW] + 0.5 * x[RATE] * dt
    out[X] += speed * math.cos(yaw) * dt
    out[Y] += speed * math.sin(yaw) * dt
    out[YAW] = wrap_angle(x[YAW] + x[RATE] * dt)
    out[SPEED] += accel * dt
    return out


@njit(cache=True)
def motion_jacobian(x: FloatArray, accel: float, dt: float) -> FloatArray:
    """(7, 7) d motion / d x."""
    jacobian = np.eye(7)
    speed, yaw = x[SPEED] + 0.5 * accel * dt, x[YAW] + 0.5 * x[RATE] * dt
    cos, sin = math.cos(yaw) * dt, math.sin(yaw) * dt
    jacobian[X, YAW], jacobian[Y, YAW] = -speed * sin, speed * cos
    jacobian[X, SPEED], jacobian[Y, SPEED] = cos, sin
    jacobian[X, RATE], jacobian[Y, RATE] = -0.5 * dt * speed * sin, 0.5 * dt * speed * cos
    jacobian[YAW, RATE] = dt
    return jacobian


@njit(cache=True)
def motion_noise(x: FloatArray, dt: float, walk: FloatArray) -> FloatArray:
    """(7, 7) process noise of one period. walk: (5,) densities of speed, yaw rate, sideways, b, k.

    A track slips sideways only as the robot turns, so that noise scales with the yaw rate.
    """
    noise = np.zeros((7, 7))
    cos, sin = math.cos(x[YAW]), math.sin(x[YAW])
    along = walk[0] ** 2 * dt**3 / 3.0
    aside = (walk[2] * x[RATE]) ** 2 * dt
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
    noise[GAUGE, GAUGE] = walk[4] ** 2 * dt
    return noise


@njit(cache=True)
def wheels_and_gyro(x: FloatArray, gauge: float) -> FloatArray:
    """(3,) expected left and right belt speed, m/s, and gyro reading, rad/s."""
    half = 0.5 * gauge * x[GAUGE] * x[RATE]
    return np.array([x[SPEED] - half, x[SPEED] + half, x[RATE] + x[BIAS]])


@njit(cache=True)
def wheels_and_gyro_jacobian(x: FloatArray, gauge: float) -> FloatArray:
    """(3, 7) d wheels_and_gyro / d x."""
    jacobian = np.zeros((3, 7))
    half = 0.5 * gauge
    jacobian[0, SPEED], jacobian[1, SPEED] = 1.0, 1.0
    jacobian[0, RATE], jacobian[1, RATE] = -half * x[GAUGE], half * x[GAUGE]
    jacobian[0, GAUGE], jacobian[1, GAUGE] = -half * x[RATE], half * x[RATE]
    jacobian[2, RATE], jacobian[2, BIAS] = 1.0, 1.0
    return jacobian


@njit(cache=True)
def squared_mahalanobis(residual: FloatArray, covariance: FloatArray) -> float:
    """r^T S^-1 r of an innovation (n,) with covariance (n, n)."""
    return float(np.dot(residual, np.linalg.solve(covariance, residual)))


# Plain loops: for matrices as small as these BLAS costs more in calls and buffers than in sums,
# and in the loop, where it finds its code out of the cache each time, several times as much.


@njit(cache=True)
def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, m) a b of a (n, k) and b (k, m)."""
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            factor = a[i, k]
            if factor != 0.0:
                for j in range(b.shape[1]):
                    out[i, j] += factor * b[k, j]
    return out


@njit(cache=True)
def sandwich(a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, n) a b a^T of a (n, k) and b (k, k)."""
    return product(product(a, b), a.T)


@njit(cache=True)
def with_pose_error(covariance: FloatArray, error: FloatArray) -> FloatArray:
    """covariance (7, 7) with an independent error of the pose, (3, 3), on top; a new array."""
    out = covariance.copy()
    for i in range(3):
        for j in range(3):
            out[i, j] += error[i, j]
    return out


@njit(cache=True)
def inverse_3(a: FloatArray) -> FloatArray:
    """The inverse of a symmetric, positive definite a (3, 3), by its cofactors."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            k, m, n, o = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            out[j, i] = a[k, n] * a[m, o] - a[k, o] * a[m, n]
    return out / (a[0, 0] * out[0, 0] + a[0, 1] * out[1, 0] + a[0, 2] * out[2, 0])


@njit(cache=True)
def pair_mahalanobis(residual: FloatArray, spread: FloatArray, variance: float) -> float:
    """Squared Mahalanobis distance of residual[:2], of covariance spread[:2, :2] + variance I."""
    a, b, c = spread[0, 0] + variance, spread[0, 1], spread[1, 1] + variance
    r, s = residual[0], residual[1]
    return float((c * r * r - 2.0 * b * r * s + a * s * s) / (a * c - b * b))


@njit(cache=True)
def predict_and_correct(
    x: FloatArray,
    covariance: FloatArray,
    walk: FloatArray,
    accel: float,
    dt: float,
    left: float,
    right: float,
    gyro: float,
    wheel_var: float,
    gyro_var: float,
    gauge: float,
    gate: float,
) -> tuple[FloatArray, FloatArray]:
    """State (7,) and covariance (7, 7) one period later, corrected with wheels and gyro.

    The equations of filterpy's ``predict`` and ``update`` (Joseph's form), the covariance made
    symmetric in the end. left, right: belt speeds, m/s, of variance wheel_var, which are all but
    ignored where their squared Mahalanobis distance is above ``gate``: then the belts slip.
    """
    transition = motion_jacobian(x, accel, dt)
    p = sandwich(transition, covariance) + motion_noise(x, dt, walk)
    x = motion(x, accel, dt)
    z = np.array([left, right, gyro])
    noise = np.diag(np.array([wheel_var, wheel_var, gyro_var]))
    h = wheels_and_gyro_jacobian(x, gauge)
    residual = z - wheels_and_gyro(x, gauge)
    spread = sandwich(h, p)
    if pair_mahalanobis(residual, spread, wheel_var) > gate:
        noise[0, 0] = noise[1, 1] = SLIPPING_VAR
    gain = product(product(p, h.T), inverse_3(spread + noise))
    x = x + product(gain, residual.reshape(3, 1))[:, 0]
    x[YAW] = wrap_angle(x[YAW])
    p = sandwich(np.eye(7) - product(gain, h), p) + sandwich(gain, noise)
    return x, 0.5 * (p + p.T)
