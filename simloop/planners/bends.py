"""Changing how many waypoints a polyline has: adding free ones, dropping useless, splitting bends."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from simloop.messages import FloatArray
from simloop.planners.objective import Problem
from simloop.planners.routes import MAX_POINTS, is_clear


@njit(cache=True)
def copy_path(source: FloatArray, m: int, target: FloatArray) -> None:
    """target[:m] = source[:m], without a temporary."""
    for i in range(m):
        target[i, 0] = source[i, 0]
        target[i, 1] = source[i, 1]


@njit(cache=True)
def insert_point(path: FloatArray, m: int, at: int, x: float, y: float) -> int:
    """Put (x, y) before index ``at``; the new count."""
    for k in range(m, at, -1):
        path[k, 0] = path[k - 1, 0]
        path[k, 1] = path[k - 1, 1]
    path[at, 0] = x
    path[at, 1] = y
    return m + 1


@njit(cache=True)
def pad_points(path: FloatArray, m: int, wanted: int) -> int:
    """Halve the longest segment until there are ``wanted`` points; the shape stays. New count."""
    while m < min(wanted, MAX_POINTS):
        longest, at = -1.0, 1
        for i in range(1, m):
            length = math.hypot(path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1])
            if length > longest:
                longest, at = length, i
        x = 0.5 * (path[at, 0] + path[at - 1, 0])
        y = 0.5 * (path[at, 1] + path[at - 1, 1])
        m = insert_point(path, m, at, x, y)
    return m


@njit(cache=True)
def _turn_at(path: FloatArray, i: int) -> float:
    ux = path[i, 0] - path[i - 1, 0]
    uy = path[i, 1] - path[i - 1, 1]
    vx = path[i + 1, 0] - path[i, 0]
    vy = path[i + 1, 1] - path[i, 1]
    return abs(math.atan2(ux * vy - uy * vx, ux * vx + uy * vy))


@njit(cache=True)
def split_bends(p: Problem, path: FloatArray, m: int, least_turn: float, stack: FloatArray) -> int:
    """Cut each corner that turns by more than ``least_turn`` as deep as the clearance allows.

    The cut is isosceles: about a round obstacle it halves the turn evenly, and a polygon of even
    turns about a circle is the shortest. New count.
    """
    a = np.empty(2)
    b = np.empty(2)
    i = 1
    while i < m - 1 and m < MAX_POINTS:
        if _turn_at(path, i) < least_turn:
            i += 1
            continue
        before = math.hypot(path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1])
        after = math.hypot(path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1])
        low, high = 0.0, 0.45 * min(before, after)
        ux = (path[i - 1, 0] - path[i, 0]) / before
        uy = (path[i - 1, 1] - path[i, 1]) / before
        vx = (path[i + 1, 0] - path[i, 0]) / after
        vy = (path[i + 1, 1] - path[i, 1]) / after
        for _ in range(10):
            cut = 0.5 * (low + high)
            a[0], a[1] = path[i, 0] + cut * ux, path[i, 1] + cut * uy
            b[0], b[1] = path[i, 0] + cut * vx, path[i, 1] + cut * vy
            if is_clear(p, a, b, stack):
                low = cut
            else:
                high = cut
        if low > 1e-3:
            x, y = path[i, 0], path[i, 1]
            path[i, 0], path[i, 1] = x + low * ux, y + low * uy
            m = insert_point(path, m, i + 1, x + low * vx, y + low * vy)
            i += 1
        i += 1
    return m
