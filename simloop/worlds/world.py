"""The compiled world: the model, the true floor plan and the robot's true outline."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from simloop.config import Config
from simloop.worlds.arena import assemble_with_notes, compile_spec
from simloop.worlds.body import Body
from simloop.worlds.cross_section import floor_plan
from simloop.worlds.floor_plan import FloorPlan
from simloop.worlds.layout import Layout
from simloop.worlds.movers.settings import Mover
from simloop.worlds.vehicle_body import body_of


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """Ground truth for the plant, the evaluation and the drawings. The robot never sees it.

    Attributes:
        model: the compiled model of the arena, the vehicle and the whole layout.
        floor: the true floor plan.
        body: the robot's true outline.
        movers: the movers, in the order of the model's mocap bodies.
        notes: what was left out or assumed when the world was read, each in a line.
    """

    model: mujoco.MjModel
    floor: FloorPlan
    body: Body
    movers: tuple[Mover, ...] = ()
    notes: tuple[str, ...] = ()


def compile_world(layout: Layout, config: Config) -> World:
    """Build a described world, with one compilation.

    Args:
        layout: the description of the world.
        config: the physics step, the payload, and the friction of the tracks.

    Returns:
        The world.

    Raises:
        ValueError: the world cannot be built.
    """
    spec, notes = assemble_with_notes(layout, config.tracks.friction)
    body = body_of(spec)
    model = compile_spec(spec, config.rates.physics_s, config.payload)
    return World(model, floor_plan(model), body, layout.movers, (*layout.notes, *notes))
