"""From a scenario to the layout of its world: all that is read from files or drawn from the seed.

Nothing is compiled here. The layout depends on the scenario, on the files it names and on the
vehicle's model, never on what the robot believes of itself (``config.vehicle``).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from simloop.common.data_files import models_dir
from simloop.scenario.scenario import Scenario
from simloop.worlds.arena import assemble, bounds_of_spec
from simloop.worlds.body import Body
from simloop.worlds.cross_section import sections_of_spec
from simloop.worlds.floor_plan import rasterise
from simloop.worlds.gazebo_world import read_sdf
from simloop.worlds.generators.clutter import draw_clutter, hide_from_lidar
from simloop.worlds.generators.generator import draw_world
from simloop.worlds.layout import Layout
from simloop.worlds.map_server_world import read_map_world
from simloop.worlds.mjcf_obstacles import add_obstacles
from simloop.worlds.movers.random_crowd import draw_crowd
from simloop.worlds.obstacles import Obstacle
from simloop.worlds.vehicle_body import body_of

# One random stream for each thing that is drawn: none shifts another, nor what the stages of a run
# draw from the seed.
_WORLD_STREAM = 0x3D
_CLUTTER_STREAM = 0xC1
_CROWD_STREAM = 0xC2
_HEIGHT_STREAM = 0xC3


def describe(scenario: Scenario) -> Layout:
    """All that stands and moves in a scenario's world.

    The arena is read, not compiled, to learn where clutter and movers can be placed.

    Args:
        scenario: its seed, world, obstacles, clutter, terrain, loose things and movers.

    Returns:
        The layout; equal scenarios give equal layouts.

    Raises:
        ValueError: where a file cannot be used, or no world, clutter or crowd was found that fits.
    """
    layout = _without_draws(scenario)
    if scenario.clutter is None and scenario.crowd is None:
        return layout
    world = assemble(layout, scenario.config.tracks.friction)
    if scenario.clutter is not None:
        clutter = _clutter(scenario, world)
        # The crowd must keep clear of the clutter too.
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
    """What the scenario says itself, and its generated world; not yet clutter and crowd."""
    world = _arena(scenario)
    return replace(
        world,
        obstacles=(*world.obstacles, *scenario.obstacles),
        terrain=scenario.terrain,
        loose=scenario.loose,
        movers=scenario.movers,
    )


def _arena(scenario: Scenario) -> Layout:
    """The world by itself: generated, read from another's file, or an MJCF arena."""
    path = Path(scenario.arena)
    if scenario.generator is not None:
        rng = np.random.default_rng([scenario.seed, _WORLD_STREAM])
        body = _vehicle()
        return draw_world(scenario.generator, rng, scenario.start, scenario.goal, body)
    if path.suffix == ".yaml":
        return read_map_world(path)
    if path.suffix in (".world", ".sdf"):
        return read_sdf(path, scenario.bounds_m)
    return Layout(scenario.bounds_m, arena=scenario.arena)


def _vehicle() -> Body:
    return body_of(mujoco.MjSpec.from_file(str(models_dir() / "tracked_ugv.xml")))


def _clutter(scenario: Scenario, world: mujoco.MjSpec) -> list[Obstacle]:
    """Obstacles drawn among what stands in the assembled world; some out of the LiDAR's sight."""
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
        scenario.config.planner.safe_distance_m,
        # The bounds stand for the walls.
        [section for section in standing if not section.name.startswith("wall")],
    )
    rng = np.random.default_rng([scenario.seed, _HEIGHT_STREAM])
    return hide_from_lidar(rng, drawn, scenario.clutter.unseen, body.lidar_height_m)
