"""Read Gazebo worlds and models (SDF) as layouts.

Only the collision shapes of models count. They stand where Gazebo puts them on loading: by the
poses of model, link and collision, or by the saved state. The floor is flat here, so a shape counts
if it reaches the heights of the robot over the ground. What cannot be told is refused, by the
model's name. What is left out or assumed is told in the layout's notes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from simloop.common.errors import InputError
from simloop.common.limits import ARENA_SIDE_M, SHAPES, check_limit
from simloop.worlds.gazebo.heights import Placed, ground_height, placed, standing
from simloop.worlds.gazebo.model_files import ModelFiles
from simloop.worlds.gazebo.models import WorldReader
from simloop.worlds.gazebo.notes import Notes
from simloop.worlds.gazebo.obstacles import obstacles_of
from simloop.worlds.gazebo.outlines import Outlines
from simloop.worlds.gazebo.shapes import Ground, ShapeReader
from simloop.worlds.layout import Bounds, Layout
from simloop.worlds.obstacles import Obstacle

_ROOM_M = 2.0  # free floor around all obstacles
_END_M = 1.0  # free floor around start and goal
_APRON_M = 10.0  # floor beyond all obstacles, at most, under a slab or a roof that is larger


def read_sdf(
    file: Path,
    bounds: Bounds | None = None,
    model_path: Sequence[str | Path] = (),
    ends_m: Sequence[Sequence[float]] = (),
) -> Layout:
    """Read a world from an SDF file.

    Args:
        file: the SDF file, with a world or one model.
        bounds: x_min, y_min, x_max, y_max of the floor, m; None: 2 m around all obstacles, 1 m
            around the ends in there, and all that lies or hangs near the obstacles.
        model_path: folders of the models that the file includes and of meshes.
        ends_m: x, y of the robot's start, which tells what it stands on, and of its goal in map, m.

    Returns:
        The bounds, the obstacles, and what was left out or assumed.

    Raises:
        InputError: the file is not SDF, or has unsupported content. The text has one line.
    """
    notes, files = Notes(), ModelFiles(file, [Path(folder) for folder in model_path])
    shapes = ShapeReader(files)
    things: list[Placed] = []
    planes: list[Ground] = []
    for collision in WorldReader(file, files, notes).collisions():
        for body in shapes.bodies(collision):
            if isinstance(body, Ground):
                planes.append(body)
            else:
                things.append(placed(collision, body))
                check_limit(len(things), SHAPES, f"{file}: shapes")
    ground = ground_height(things, planes, ends_m[0] if ends_m else None, notes)
    obstacles: list[Obstacle] = []
    outlines = Outlines()
    for one in standing(things, ground, notes):
        made = obstacles_of(one, ground, outlines)
        if not made:
            notes.add("what has no part at the robot's heights is left out", one.collision.model)
        obstacles += made
        check_limit(len(obstacles), SHAPES, f"{file}: shapes")
    if bounds is None:
        bounds = _bounds(file, obstacles, things, ends_m)
    for low, high in ((bounds[0], bounds[2]), (bounds[1], bounds[3])):
        check_limit(high - low, ARENA_SIDE_M, f"{file}: side of the world (see bounds_m)", "m")
    return Layout(bounds, tuple(obstacles), notes=notes.lines(file.name))


def _bounds(
    file: Path,
    obstacles: Sequence[Obstacle],
    things: Sequence[Placed],
    ends_m: Sequence[Sequence[float]],
) -> Bounds:
    """Choose the bounds: a rim around all obstacles, and the floor or roof near them."""
    outlines = [s for one in obstacles for s in one.sections()]
    if not outlines:
        raise InputError(f"{file}: the world has no obstacles; give bounds_m")
    low = np.min([s.vertices_m.min(axis=0) - s.radius_m for s in outlines], axis=0)
    high = np.max([s.vertices_m.max(axis=0) + s.radius_m for s in outlines], axis=0)
    low_all = np.min([one.low[:2] for one in things], axis=0)
    high_all = np.max([one.high[:2] for one in things], axis=0)
    low = np.minimum(low - _ROOM_M, np.maximum(low_all, low - _APRON_M))
    high = np.maximum(high + _ROOM_M, np.minimum(high_all, high + _APRON_M))
    for end in np.array([end[:2] for end in ends_m]).reshape(-1, 2):
        if np.all((end >= low) & (end <= high)):  # others are reported as outside
            low, high = np.minimum(low, end - _END_M), np.maximum(high, end + _END_M)
    return (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
