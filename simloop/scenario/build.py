"""Build the compiled world of a scenario, and check it before anything is written or run."""

from __future__ import annotations

import numpy as np

from simloop.common.errors import InputError
from simloop.messages import FloatArray
from simloop.physics.track_model import friction_map
from simloop.scenario.describe import describe
from simloop.scenario.scenario import Scenario
from simloop.worlds.arena import assemble, bounds_of_spec, overlaps
from simloop.worlds.body import Body
from simloop.worlds.floor_plan import FloorPlan, is_passable
from simloop.worlds.layout import Layout
from simloop.worlds.outline_gap import least_clearance
from simloop.worlds.world import World, compile_world

__all__ = ["World", "build_world", "check_ends", "nearest"]

_LEAST_HALF_WIDTH = 0.45
"""Share of the robot's width. A passage narrower than 90 % of the robot counts as closed."""


def build_world(scenario: Scenario) -> World:
    """Build the world of a scenario, with one compilation, and check that it can be driven.

    Args:
        scenario: the scenario to run.

    Returns:
        The world.

    Raises:
        InputError: the world cannot be built, or start or goal cannot be used. The text has one
            line.
    """
    where, tracks = f"scenario '{scenario.name}'", scenario.config.tracks
    try:
        world = compile_world(describe(scenario), scenario.config)
        friction_map(tracks.zones, tracks.friction_image)
    except ValueError as error:
        # A start or goal outside the arena is the more likely cause, and easier to correct.
        _check_bounds(scenario, where)
        raise InputError(f"{where}: {error}") from None
    check_ends(scenario, world.floor, world.body, where)
    try:
        pairs = overlaps(world.model, scenario.start)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    for first, second in pairs:
        raise InputError(f"{where}: {first} and {second} overlap at the start")
    return world


def check_ends(scenario: Scenario, floor: FloorPlan, body: Body, where: str) -> None:
    """Reject a start or goal that is outside the arena, too near to an obstacle, or walled off.

    Args:
        scenario: start, goal, and whether the goal may be closed off.
        floor: the floor plan.
        body: the robot's true outline.
        where: start of the error text.

    Raises:
        InputError: start or goal cannot be used. The text has one line, with key and reason.
    """
    radius = body.footprint_radius_m
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
    if least_clearance(floor, np.array([scenario.start]), body) <= 0.0:
        raise InputError(f"{where}: start: the robot's outline touches {nearest(floor, start)[1]}")
    if scenario.may_be_closed_off:
        return
    if not is_passable(floor, start, goal, _LEAST_HALF_WIDTH * body.width_m):
        raise InputError(
            f"{where}: goal ({goal[0]:g}, {goal[1]:g}) is walled off from the start; to run it "
            "nevertheless set may_be_closed_off = true"
        )


def nearest(floor: FloorPlan, point: FloatArray) -> tuple[float, str]:
    """Find the obstacle nearest to a point.

    Args:
        floor: the floor plan.
        point: (2,) x, y in map, m.

    Returns:
        The signed distance, m, negative inside, and the name; inf and "nothing" on a free floor.
    """
    return floor.nearest(point)


def _check_bounds(scenario: Scenario, where: str) -> None:
    """Raise InputError for ends outside the arena, if its bounds are known without its world."""
    sized = scenario.generator or scenario
    try:
        bounds = (
            np.array(sized.bounds_m)
            if sized.bounds_m
            else bounds_of_spec(assemble(Layout(arena=scenario.arena)))
        )
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
