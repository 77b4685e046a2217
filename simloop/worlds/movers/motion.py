"""How movers go on from one control period to the next, in one compiled step for all of them.

Source of the social force: Helbing & Molnar 1995, with the figures of Helbing et al. 2000 scaled to
walkers who keep to half a metre a second.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray

PATH, CONSTANT, WALK, PEDESTRIAN = range(4)
_RELAX_S = 0.5  # in which a pedestrian comes to the velocity that it wants
_PUSH_MPS2 = 2.0  # of the social force at contact
_FALL_M = 0.25  # over which it falls to 1/e
_FELT_M = 2.0
_THERE_M = 0.3
_TIRED_S = 15.0  # after which another place is wanted


class Herd(NamedTuple):
    """All movers: kind (n,), see above; place, velocity, aim (n, 2); pace, radius, turn, aimed_s
    (n,): speed wanted, m/s, m, rad per root of a second, s since the aim was taken."""

    kind: NDArray[np.int64]
    place: FloatArray
    velocity: FloatArray
    aim: FloatArray
    pace: FloatArray
    radius: FloatArray
    turn: FloatArray
    aimed_s: FloatArray


class Floor(NamedTuple):
    """What stands: distance (rows, cols) float32 to it at the cells' centres, [iy, ix], the first
    cell's corner at x, y; bounds (4,)."""

    distance: NDArray[np.float32]
    x: float
    y: float
    cell: float
    bounds: FloatArray


class Outline(NamedTuple):
    """The robot's rectangle, with which movers collide: pose in map, half its length and width.

    depth: how far into it a mover is that has touched the robot, whose front between the tracks
    lies some centimetres behind the rectangle's."""

    x: float
    y: float
    yaw: float
    half_length: float
    half_width: float
    depth: float = 0.0


@njit(cache=True)
def room_at(floor: Floor, x: float, y: float) -> tuple[float, float, float]:
    """Distance to what stands or to the bounds, m, and the unit vector (x, y) away from it."""
    rows, cols = floor.distance.shape
    u = min(max((x - floor.x) / floor.cell - 0.5, 0.0), cols - 1.001)
    v = min(max((y - floor.y) / floor.cell - 0.5, 0.0), rows - 1.001)
    i, j = int(u), int(v)
    a, b = u - i, v - j
    i1, j1 = min(i + 1, cols - 1), min(j + 1, rows - 1)
    d00, d01 = floor.distance[j, i], floor.distance[j, i1]
    d10, d11 = floor.distance[j1, i], floor.distance[j1, i1]
    room = (d00 * (1.0 - a) + d01 * a) * (1.0 - b) + (d10 * (1.0 - a) + d11 * a) * b
    gx = (d01 - d00) * (1.0 - b) + (d11 - d10) * b
    gy = (d10 - d00) * (1.0 - a) + (d11 - d01) * a
    left, low, right, high = floor.bounds
    for side, ax, ay in (
        (x - left, 1.0, 0.0),
        (y - low, 0.0, 1.0),
        (right - x, -1.0, 0.0),
        (high - y, 0.0, -1.0),
    ):
        if not room <= side:  # nor if it is inf or NaN, where nothing stands
            room, gx, gy = side, ax, ay
    size = math.hypot(gx, gy)
    if not size > 1e-9:
        return room, 0.0, 0.0
    return room, gx / size, gy / size


@njit(cache=True)
def gap_to_outline(robot: Outline, x: float, y: float) -> tuple[float, float, float]:
    """Distance from the robot's outline to a point, < 0 inside, and the unit vector to it."""
    cos, sin = math.cos(robot.yaw), math.sin(robot.yaw)
    along = cos * (x - robot.x) + sin * (y - robot.y)
    aside = cos * (y - robot.y) - sin * (x - robot.x)
    dx, dy = abs(along) - robot.half_length, abs(aside) - robot.half_width
    if dx > 0.0 and dy > 0.0:
        gap = math.hypot(dx, dy)
        nx, ny = dx / gap, dy / gap
    elif dx > dy:
        gap, nx, ny = dx, 1.0, 0.0
    else:
        gap, nx, ny = dy, 0.0, 1.0
    nx, ny = math.copysign(nx, along), math.copysign(ny, aside)
    return gap, cos * nx - sin * ny, sin * nx + cos * ny


@njit(cache=True)
def _throw_back(velocity: FloatArray, nx: float, ny: float) -> None:
    """Turn a velocity (2,) round that leads against a surface with the normal (nx, ny)."""
    into = velocity[0] * nx + velocity[1] * ny
    if into < 0.0:
        velocity[0] -= 2.0 * into * nx
        velocity[1] -= 2.0 * into * ny


@njit(cache=True)
def _push(force: FloatArray, gap: float, nx: float, ny: float) -> None:
    if gap < _FELT_M:
        size = _PUSH_MPS2 * math.exp(-max(gap, -_FALL_M) / _FALL_M)
        force[0] += size * nx
        force[1] += size * ny


@njit(cache=True)
def _walk_on(
    herd: Herd, i: int, floor: Floor, robot: Outline, force: FloatArray, dt: float
) -> None:
    """A pedestrian's velocity after ``dt``: drawn to its aim, pushed by what is near."""
    place, velocity = herd.place[i], herd.velocity[i]
    dx, dy = herd.aim[i, 0] - place[0], herd.aim[i, 1] - place[1]
    far = max(math.hypot(dx, dy), 1e-6)
    force[0] = (herd.pace[i] * dx / far - velocity[0]) / _RELAX_S
    force[1] = (herd.pace[i] * dy / far - velocity[1]) / _RELAX_S
    for k in range(herd.kind.shape[0]):
        if k != i:
            ox, oy = place[0] - herd.place[k, 0], place[1] - herd.place[k, 1]
            apart = max(math.hypot(ox, oy), 1e-6)
            _push(force, apart - herd.radius[i] - herd.radius[k], ox / apart, oy / apart)
    gap, nx, ny = gap_to_outline(robot, place[0], place[1])
    _push(force, gap - herd.radius[i], nx, ny)
    room, nx, ny = room_at(floor, place[0], place[1])
    _push(force, room - herd.radius[i], nx, ny)
    velocity += dt * force
    speed = math.hypot(velocity[0], velocity[1])
    if speed > herd.pace[i]:
        velocity *= herd.pace[i] / speed


@njit(cache=True)
def _collide(herd: Herd, i: int, floor: Floor, robot: Outline) -> None:
    """Throw a mover back from what it touches: what stands, one another, the robot."""
    place, velocity, radius = herd.place[i], herd.velocity[i], herd.radius[i]
    room, nx, ny = room_at(floor, place[0], place[1])
    if room < radius:
        _throw_back(velocity, nx, ny)
        place[0] += (radius - room) * nx
        place[1] += (radius - room) * ny
    for k in range(herd.kind.shape[0]):
        ox, oy = place[0] - herd.place[k, 0], place[1] - herd.place[k, 1]
        apart = math.hypot(ox, oy)
        if k != i and 1e-9 < apart < radius + herd.radius[k]:
            _throw_back(velocity, ox / apart, oy / apart)
    gap, nx, ny = gap_to_outline(robot, place[0], place[1])
    if gap < radius - robot.depth:  # they have touched, and the referee has seen it
        _throw_back(velocity, nx, ny)


@njit(cache=True)
def advance(
    herd: Herd, floor: Floor, robot: Outline, normal: FloatArray, uniform: FloatArray, dt: float
) -> None:
    """Take all but those on paths ``dt`` s further, in place.

    normal: (n,) standard normal draws, uniform: (n, 2) draws from [0, 1), new ones each time.
    """
    force = np.zeros(2)
    for i in range(herd.kind.shape[0]):
        if herd.kind[i] == PATH:
            continue
        place, velocity = herd.place[i], herd.velocity[i]
        if herd.kind[i] == WALK:
            turn = herd.turn[i] * math.sqrt(dt) * normal[i]
            cos, sin = math.cos(turn), math.sin(turn)
            vx, vy = velocity[0], velocity[1]
            velocity[0], velocity[1] = cos * vx - sin * vy, sin * vx + cos * vy
        elif herd.kind[i] == PEDESTRIAN:
            herd.aimed_s[i] += dt
            there = math.hypot(herd.aim[i, 0] - place[0], herd.aim[i, 1] - place[1]) < _THERE_M
            if there or herd.aimed_s[i] > _TIRED_S:
                x = floor.bounds[0] + uniform[i, 0] * (floor.bounds[2] - floor.bounds[0])
                y = floor.bounds[1] + uniform[i, 1] * (floor.bounds[3] - floor.bounds[1])
                if room_at(floor, x, y)[0] > herd.radius[i] + _THERE_M:
                    herd.aim[i, 0], herd.aim[i, 1], herd.aimed_s[i] = x, y, 0.0
            _walk_on(herd, i, floor, robot, force, dt)
        place += dt * velocity
        _collide(herd, i, floor, robot)
