"""Move all movers over one control period, in one compiled step.

Source of the social force: Helbing & Molnar 1995, with the figures of Helbing et al. 2000, scaled
to pedestrians who walk at 0.5 m/s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray

PATH, CONSTANT, WALK, PEDESTRIAN = range(4)
_RELAX_S = 0.5  # time constant with which a pedestrian reaches its desired velocity
_PUSH_MPS2 = 2.0  # social force per mass at contact
_PUSH_DECAY_M = 0.25  # distance over which the force falls to 1/e
_PUSH_RANGE_M = 2.0  # distance beyond which there is no force
_ARRIVED_M = 0.3  # distance from its aim at which a pedestrian has arrived
_NEW_AIM_S = 15.0  # time after which a pedestrian that has not arrived takes another aim


class MoverStates(NamedTuple):
    """The states of all movers, in arrays that ``advance`` changes in place.

    Attributes:
        kind: (n,) PATH, CONSTANT, WALK or PEDESTRIAN.
        place: (n, 2) x, y in map, m.
        velocity: (n, 2) in map, m/s.
        aim: (n, 2) place to which a pedestrian walks, in map, m.
        pace: (n,) desired and greatest speed of a pedestrian, m/s.
        radius: (n,) radius of the mover, m.
        turn: (n,) standard deviation of a walk's heading, rad per square root of a second.
        aimed_s: (n,) time since the aim was taken, s.
    """

    kind: NDArray[np.int64]
    place: FloatArray
    velocity: FloatArray
    aim: FloatArray
    pace: FloatArray
    radius: FloatArray
    turn: FloatArray
    aimed_s: FloatArray


class FloorField(NamedTuple):
    """Distances to the obstacles, on a raster.

    Attributes:
        distance: (rows, cols) float32, [iy, ix], at the centres of the cells, m.
        x: x of the lower left corner of the first cell in map, m.
        y: y of the same corner, m.
        cell: size of a cell, m.
        bounds: (4,) x_min, y_min, x_max, y_max of the free floor in map, m.
    """

    distance: NDArray[np.float32]
    x: float
    y: float
    cell: float
    bounds: FloatArray


class RobotOutline(NamedTuple):
    """The robot's true rectangle at its true pose, with which movers collide.

    Attributes:
        x: x of base_link in map, m.
        y: y of base_link in map, m.
        yaw: yaw of base_link in map, rad.
        half_length: half the length, m.
        half_width: half the width, m.
        depth: depth in the rectangle at which a mover touches the robot, m. Between the tracks, the
            robot's front is some centimetres behind the rectangle's front.
    """

    x: float
    y: float
    yaw: float
    half_length: float
    half_width: float
    depth: float = 0.0


@njit(cache=True)
def clearance_at(floor: FloorField, x: float, y: float) -> tuple[float, float, float]:
    """Compute the distance to the nearest obstacle or bound, and the direction away from it.

    Args:
        floor: the raster of distances. Between cells they are interpolated.
        x: in map, m.
        y: in map, m.

    Returns:
        Distance, m, and the unit vector x, y away from the nearest; 0, 0 if there is none.
    """
    # Interpolate the distance bilinearly. Its gradient points away from the nearest obstacle.
    rows, cols = floor.distance.shape
    # A NaN fails the comparison, so that no index is made of it.
    u, v = (x - floor.x) / floor.cell - 0.5, (y - floor.y) / floor.cell - 0.5
    u = min(u, max(cols - 1.001, 0.0)) if u > 0.0 else 0.0
    v = min(v, max(rows - 1.001, 0.0)) if v > 0.0 else 0.0
    i, j = int(u), int(v)
    a, b = u - i, v - j
    i1, j1 = min(i + 1, cols - 1), min(j + 1, rows - 1)
    d00, d01 = floor.distance[j, i], floor.distance[j, i1]
    d10, d11 = floor.distance[j1, i], floor.distance[j1, i1]
    room = (d00 * (1.0 - a) + d01 * a) * (1.0 - b) + (d10 * (1.0 - a) + d11 * a) * b
    gx = (d01 - d00) * (1.0 - b) + (d11 - d10) * b
    gy = (d10 - d00) * (1.0 - a) + (d11 - d01) * a
    # The bounds act like walls.
    left, low, right, high = floor.bounds
    for side, ax, ay in (
        (x - left, 1.0, 0.0),
        (y - low, 0.0, 1.0),
        (right - x, -1.0, 0.0),
        (high - y, 0.0, -1.0),
    ):
        if not room <= side:  # also true for inf and NaN, where there is no obstacle
            room, gx, gy = side, ax, ay
    size = math.hypot(gx, gy)
    if not size > 1e-9:
        return room, 0.0, 0.0
    return room, gx / size, gy / size


@njit(cache=True)
def gap_to_outline(robot: RobotOutline, x: float, y: float) -> tuple[float, float, float]:
    """Compute the distance from the robot's rectangle to a point, and the direction to the point.

    Args:
        robot: the rectangle at its pose.
        x: x of the point in map, m.
        y: y of the point in map, m.

    Returns:
        Distance, m, negative inside, and the outward unit vector x, y in map.
    """
    # Transform the point to the robot's frame, mirrored into the first quadrant.
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
    # Mirror back to the point's own quadrant, and rotate to map.
    nx, ny = math.copysign(nx, along), math.copysign(ny, aside)
    return gap, cos * nx - sin * ny, sin * nx + cos * ny


@njit(cache=True)
def _reflect(velocity: FloatArray, nx: float, ny: float) -> None:
    """Reflect a velocity (2,) that points into a surface with the normal (nx, ny)."""
    into = velocity[0] * nx + velocity[1] * ny
    if into < 0.0:
        velocity[0] -= 2.0 * into * nx
        velocity[1] -= 2.0 * into * ny


@njit(cache=True)
def _push(force: FloatArray, gap: float, nx: float, ny: float) -> None:
    """Add the social force of something at a distance ``gap`` to ``force`` (2,), m/s^2."""
    if gap < _PUSH_RANGE_M:
        size = _PUSH_MPS2 * math.exp(-max(gap, -_PUSH_DECAY_M) / _PUSH_DECAY_M)
        force[0] += size * nx
        force[1] += size * ny


@njit(cache=True)
def _steer_pedestrian(
    movers: MoverStates,
    i: int,
    floor: FloorField,
    robot: RobotOutline,
    force: FloatArray,
    dt: float,
) -> None:
    """Update a pedestrian's velocity with the social force. force: (2,), overwritten."""
    place, velocity = movers.place[i], movers.velocity[i]
    # The aim attracts the pedestrian.
    dx, dy = movers.aim[i, 0] - place[0], movers.aim[i, 1] - place[1]
    far = max(math.hypot(dx, dy), 1e-6)
    force[0] = (movers.pace[i] * dx / far - velocity[0]) / _RELAX_S
    force[1] = (movers.pace[i] * dy / far - velocity[1]) / _RELAX_S
    # Other movers, the robot and the obstacles repel it.
    for k in range(movers.kind.shape[0]):
        if k != i:
            ox, oy = place[0] - movers.place[k, 0], place[1] - movers.place[k, 1]
            apart = max(math.hypot(ox, oy), 1e-6)
            _push(force, apart - movers.radius[i] - movers.radius[k], ox / apart, oy / apart)
    gap, nx, ny = gap_to_outline(robot, place[0], place[1])
    _push(force, gap - movers.radius[i], nx, ny)
    room, nx, ny = clearance_at(floor, place[0], place[1])
    _push(force, room - movers.radius[i], nx, ny)
    velocity += dt * force
    speed = math.hypot(velocity[0], velocity[1])
    if speed > movers.pace[i]:
        velocity *= movers.pace[i] / speed


@njit(cache=True)
def _collide(movers: MoverStates, i: int, floor: FloorField, robot: RobotOutline) -> None:
    """Reflect a mover from what it touches: obstacles, other movers, the robot."""
    place, velocity, radius = movers.place[i], movers.velocity[i], movers.radius[i]
    # Move it out of an obstacle by the depth to which it has entered.
    room, nx, ny = clearance_at(floor, place[0], place[1])
    if room < radius:
        _reflect(velocity, nx, ny)
        place[0] += (radius - room) * nx
        place[1] += (radius - room) * ny
    for k in range(movers.kind.shape[0]):
        ox, oy = place[0] - movers.place[k, 0], place[1] - movers.place[k, 1]
        apart = math.hypot(ox, oy)
        if k != i and 1e-9 < apart < radius + movers.radius[k]:
            _reflect(velocity, ox / apart, oy / apart)
    # Reflect only at the robot's real surface, so that the referee sees the contact first.
    gap, nx, ny = gap_to_outline(robot, place[0], place[1])
    if gap < radius - robot.depth:
        _reflect(velocity, nx, ny)


@njit(cache=True)
def advance(
    movers: MoverStates,
    floor: FloorField,
    robot: RobotOutline,
    normal: FloatArray,
    uniform: FloatArray,
    dt: float,
) -> None:
    """Move all movers except those on paths by one period, in place.

    Args:
        movers: their states, changed in place.
        floor: distances to the obstacles.
        robot: the robot's rectangle at its present pose.
        normal: (n,) new draws from the standard normal distribution.
        uniform: (n, 2) new draws from [0, 1).
        dt: the period, s.
    """
    force = np.zeros(2)
    for i in range(movers.kind.shape[0]):
        if movers.kind[i] == PATH:
            continue
        place, velocity = movers.place[i], movers.velocity[i]
        if movers.kind[i] == WALK:
            # The heading is a random walk: its spread grows with the root of time.
            turn = movers.turn[i] * math.sqrt(dt) * normal[i]
            cos, sin = math.cos(turn), math.sin(turn)
            vx, vy = velocity[0], velocity[1]
            velocity[0], velocity[1] = cos * vx - sin * vy, sin * vx + cos * vy
        elif movers.kind[i] == PEDESTRIAN:
            movers.aimed_s[i] += dt
            dx, dy = movers.aim[i, 0] - place[0], movers.aim[i, 1] - place[1]
            there = math.hypot(dx, dy) < _ARRIVED_M
            if there or movers.aimed_s[i] > _NEW_AIM_S:
                # Take a new aim if the one drawn is free; else draw again in the next period.
                x = floor.bounds[0] + uniform[i, 0] * (floor.bounds[2] - floor.bounds[0])
                y = floor.bounds[1] + uniform[i, 1] * (floor.bounds[3] - floor.bounds[1])
                if clearance_at(floor, x, y)[0] > movers.radius[i] + _ARRIVED_M:
                    movers.aim[i, 0], movers.aim[i, 1], movers.aimed_s[i] = x, y, 0.0
            _steer_pedestrian(movers, i, floor, robot, force, dt)
        place += dt * velocity
        _collide(movers, i, floor, robot)
