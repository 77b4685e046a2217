"""Make the layout of a scenario's world: read its files and draw its random parts.

Nothing is compiled here. The layout depends on the scenario, on the files it names and on the
vehicle's model. It never depends on what the robot believes about itself (``config.vehicle``).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from simloop.common.data_files import models_dir
from simloop.common.limits import SHAPES, check_limit
from simloop.scenario.scenario import GAZEBO_FILES, MAP_FILES, Scenario
from simloop.worlds.arena import assemble, bounds_of_spec
from simloop.worlds.body import Body
from simloop.worlds.cross_section import sections_of_spec
from simloop.worlds.floor_plan import check_floor, rasterise
from simloop.worlds.gazebo_world import read_sdf
from simloop.worlds.generators.clutter import draw_clutter, hide_from_lidar
from simloop.worlds.generators.generator import draw_world
from simloop.worlds.layout import Layout
from simloop.worlds.map_server_world import read_map_world
from simloop.worlds.mjcf_obstacles import add_obstacles
from simloop.worlds.movers.random_crowd import draw_crowd
from simloop.worlds.obstacles import Obstacle
from simloop.worlds.vehicle_body import body_of

# Each random part has its own random stream. So no part shifts the draws of another part, or those
# of the stages of a run.
_WORLD_STREAM = 0x3D
_CLUTTER_STREAM = 0xC1
_CROWD_STREAM = 0xC2
_HEIGHT_STREAM = 0xC3


def describe(scenario: Scenario) -> Layout:
    """Make the layout of a scenario's world.

    The arena is read but not compiled, to find places for clutter and movers.

    Args:
        scenario: the scenario.

    Returns:
        The layout. Equal scenarios give equal layouts.

    Raises:
        ValueError: a file cannot be used, or no fitting world, clutter or crowd was found.
    """
    layout = _without_draws(scenario)
    if scenario.clutter is None and scenario.crowd is None:
        return layout
    world = assemble(layout, scenario.config.tracks.friction)
    if scenario.clutter is not None:
        clutter = _clutter(scenario, world)
        # The crowd must also keep a distance from the clutter.
        add_obstacles(world, clutter, first=len(layout.obstacles) + 1)
        layout = replace(layout, obstacles=(*layout.obstacles, *clutter))
    if scenario.crowd is not None:
        standing = sections_of_spec(world, loose=False)
        floor = rasterise(standing, bounds_of_spec(world), resolution_m=1.0)
        rng = np.random.default_rng([scenario.seed, _CROWD_STREAM])
        movers = draw_crowd(scenario.crowd, floor, scenario.start, rng)
        layout = replace(layout, movers=(*layout.movers, *movers))
    return layout


def _without_draws(scenario: Scenario) -> Layout:
    """Make the layout without clutter and crowd: the given parts and the generated world."""
    world = _arena(scenario)
    if world.bounds_m is not None:
        check_floor(world.bounds_m)
    check_limit(len(world.obstacles) + len(scenario.obstacles), SHAPES, "obstacles of the world")
    return replace(
        world,
        obstacles=(*world.obstacles, *scenario.obstacles),
        terrain=scenario.terrain,
        loose=scenario.loose,
        movers=scenario.movers,
    )


def _arena(scenario: Scenario) -> Layout:
    """Make the world alone: generated, read from another format's file, or an MJCF arena."""
    path = Path(scenario.arena)
    if scenario.generator is not None:
        rng = np.random.default_rng([scenario.seed, _WORLD_STREAM])
        body = _vehicle()
        return draw_world(scenario.generator, rng, scenario.start, scenario.goal, body)
    if path.suffix in MAP_FILES:
        return read_map_world(path)
    if path.suffix in GAZEBO_FILES:
        return read_sdf(
            path, scenario.bounds_m, scenario.model_path, (scenario.start, scenario.goal)
        )
    return Layout(scenario.bounds_m, arena=scenario.arena)


def _vehicle() -> Body:
    return body_of(mujoco.MjSpec.from_file(str(models_dir() / "tracked_ugv.xml")))


def _clutter(scenario: Scenario, world: mujoco.MjSpec) -> list[Obstacle]:
    """Draw obstacles between those of the assembled world, some hidden from the LiDAR."""
    assert scenario.clutter is not None
    body = body_of(world)
    standing = sections_of_spec(world, loose=True)
    drawn = draw_clutter(
        np.random.default_rng([scenario.seed, _CLUTTER_STREAM]),
        scenario.start,
        scenario.goal,
        bounds_of_spec(world),
        body,
        scenario.clutter.count,
        scenario.clutter.clearance_m,
        # The bounds represent the walls.
        [section for section in standing if not section.name.startswith("wall")],
    )
    rng = np.random.default_rng([scenario.seed, _HEIGHT_STREAM])
    return hide_from_lidar(rng, drawn, scenario.clutter.unseen, body.lidar_height_m)
