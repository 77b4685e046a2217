"""From a scenario to its world: the compiled model and the true floor plan, checked before use.

Ground truth: for plant, metrics and drawings. What is wrong with a start or a goal is said here,
before anything is written or run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from simloop.common.errors import InputError
from simloop.messages import FloatArray
from simloop.physics.track_model import friction_map
from simloop.scenario.scenario import Scenario
from simloop.worlds.arena import bounds_of, build, overlaps
from simloop.worlds.cross_section import floor_plan, sections_of
from simloop.worlds.floor_plan import FloorPlan, is_passable
from simloop.worlds.gazebo_world import read_sdf
from simloop.worlds.generators.clutter import draw_clutter, out_of_plane
from simloop.worlds.generators.generator import draw_world
from simloop.worlds.layout import Layout
from simloop.worlds.map_server_world import read_picture
from simloop.worlds.movers.draw import draw_crowd
from simloop.worlds.movers.settings import Mover
from simloop.worlds.obstacles import Obstacle
from simloop.worlds.outline_gap import least_clearance

if TYPE_CHECKING:
    from mujoco import MjModel

_LEAST_HALF_WIDTH = 0.45
"""Of the robot's width: no way that is narrower than nine tenths of it is worth a try."""
_WORLD_STREAM = 0x3D
_CLUTTER_STREAM = 0xC1
_CROWD_STREAM = 0xC2
_HEIGHT_STREAM = 0xC3
"""Marks the draw of the room off from all the generators that the stages get from the seed."""


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """model: the arena with the vehicle and all obstacles, compiled. floor: what truly stands.
    movers: what moves, in the order of the model's mocap bodies."""

    model: MjModel
    floor: FloorPlan
    movers: tuple[Mover, ...] = ()


def build_world(scenario: Scenario) -> World:
    """Build what a scenario describes. Raises InputError where it cannot be, or not be driven."""
    where, tracks = f"scenario '{scenario.name}'", scenario.config.tracks
    try:
        layout = layout_of(scenario)
        obstacles = [*layout.obstacles, *scenario.obstacles] if layout else [*scenario.obstacles]
        model = _build(scenario, obstacles, layout)
        if scenario.clutter is not None:
            drawn = draw_clutter(
                np.random.default_rng([scenario.seed, _CLUTTER_STREAM]),
                scenario.start,
                scenario.goal,
                bounds_of(model),
                scenario.clutter.count,
                scenario.config.vehicle,
                scenario.config.planner.safe_distance_m,
                [s for s in sections_of(model, loose=True) if not s.name.startswith("wall")],
            )
            rng = np.random.default_rng([scenario.seed, _HEIGHT_STREAM])
            obstacles += out_of_plane(rng, drawn, scenario.clutter.unseen)
            model = _build(scenario, obstacles, layout)
        floor = floor_plan(model)
        movers = scenario.movers
        if scenario.crowd is not None:
            rng = np.random.default_rng([scenario.seed, _CROWD_STREAM])
            movers += draw_crowd(scenario.crowd, floor, scenario.start, rng)
        if movers:
            model = _build(scenario, obstacles, layout, movers)
        friction_map(tracks.zones, tracks.friction_image)
    except ValueError as error:
        # The ends are the likelier culprits, and what is wrong with them is easier to act on.
        _check_bounds(scenario, where)
        raise InputError(f"{where}: {error}") from None
    check_ends(scenario, floor, where)
    for first, second in overlaps(model, scenario.start):
        raise InputError(f"{where}: {first} and {second} begin inside one another")
    return World(model, floor, movers)


def layout_of(scenario: Scenario) -> Layout | None:
    """What a generator or another's file says; None where the arena is MJCF and sized by itself.

    Raises ValueError or InputError.
    """
    vehicle, path = scenario.config.vehicle, Path(scenario.arena)
    if scenario.generator is not None:
        rng = np.random.default_rng([scenario.seed, _WORLD_STREAM])
        return draw_world(scenario.generator, rng, scenario.start, scenario.goal, vehicle)
    if path.suffix == ".yaml":
        return read_picture(path)
    if path.suffix in (".world", ".sdf"):
        return read_sdf(path, scenario.bounds_m)
    return None if scenario.bounds_m is None else Layout(scenario.bounds_m, ())


def _build(
    scenario: Scenario,
    obstacles: Sequence[Obstacle],
    layout: Layout | None,
    movers: Sequence[Mover] = (),
) -> MjModel:
    config = scenario.config
    return build(
        "field" if layout else scenario.arena,
        obstacles,
        config.rates.physics_s,
        config.payload,
        scenario.terrain,
        scenario.loose,
        config.tracks.friction,
        layout.bounds_m if layout else None,
        movers,
    )


def check_ends(scenario: Scenario, floor: FloorPlan, where: str) -> None:
    """Refuse a start or goal that is outside the arena, too near to something, or walled off."""
    radius = scenario.config.vehicle.footprint_radius_m
    start, goal = np.array(scenario.start[:2]), np.array(scenario.goal)
    for key, point in (("start", start), ("goal", goal)):
        text = f"{where}: {key} ({point[0]:g}, {point[1]:g})"
        if not floor.contains(point):
            raise InputError(f"{text} is outside the arena: {_bounds_text(floor.bounds_m)}")
        clearance, name = nearest(floor, point)
        if clearance < 0.0:
            raise InputError(f"{text} is inside {name}")
        if clearance < radius:
            raise InputError(
                f"{text} is {clearance:.2f} m from {name}; the robot needs {radius:.2f} m there"
            )
    if least_clearance(floor, np.array([scenario.start]), scenario.config.vehicle) <= 0.0:
        raise InputError(f"{where}: start: the robot's outline touches {nearest(floor, start)[1]}")
    if scenario.may_be_closed_off:
        return
    if not is_passable(floor, start, goal, _LEAST_HALF_WIDTH * scenario.config.vehicle.width_m):
        raise InputError(
            f"{where}: goal ({goal[0]:g}, {goal[1]:g}) is walled off from the start; to run it "
            "nevertheless set may_be_closed_off = true"
        )


def nearest(floor: FloorPlan, point: FloatArray) -> tuple[float, str]:
    """The distance (signed, m) and the name of what stands nearest to a point (2,)."""
    alone = [
        (float(replace(floor, sections=(section,)).clearance_m(point)[0]), section.name)
        for section in floor.sections
    ]
    return min(alone, default=(float("inf"), "nothing"))


def _check_bounds(scenario: Scenario, where: str) -> None:
    """Outside the arena's bounds, as far as they can be known without its floor plan."""
    sized = scenario.generator or scenario
    try:
        bounds = np.array(sized.bounds_m or bounds_of(build(scenario.arena)))
    except ValueError:
        return
    for key, point in (("start", scenario.start), ("goal", scenario.goal)):
        x, y = point[:2]
        if not (bounds[0] <= x <= bounds[2] and bounds[1] <= y <= bounds[3]):
            text = f"{where}: {key} ({x:g}, {y:g}) is outside the arena"
            raise InputError(f"{text}: {_bounds_text(bounds)}")


def _bounds_text(bounds: FloatArray) -> str:
    x_min, y_min, x_max, y_max = bounds
    return f"x {x_min:g} to {x_max:g}, y {y_min:g} to {y_max:g}"
