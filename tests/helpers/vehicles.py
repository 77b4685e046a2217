"""Plants for the tests: the vehicle on a bare plane, level or tilted."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from simloop.common.data_files import models_dir
from simloop.config import Config
from simloop.physics.plant import Plant


def vehicle_on_plane(pitch_rad: float = 0.0) -> mujoco.MjSpec:
    """The vehicle on an endless plane, to be changed and compiled; +x leads uphill."""
    world, vehicle = mujoco.MjSpec(), mujoco.MjSpec.from_file(str(models_dir() / "tracked_ugv.xml"))
    world.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50, 50, 0.1], contype=2
    )
    world.option.integrator, world.option.cone = vehicle.option.integrator, vehicle.option.cone
    frame = world.worldbody.add_frame()
    frame.attach_body(vehicle.body("base_link"), "", "")
    world.option.gravity = [-9.81 * math.sin(pitch_rad), 0.0, -9.81 * math.cos(pitch_rad)]
    return world


def plant_on_plane(config: Config | None = None, pitch_rad: float = 0.0) -> Plant:
    """The vehicle at rest on an endless plane; gravity is tilted so that +x leads uphill."""
    plant = Plant(vehicle_on_plane(pitch_rad).compile(), config or Config())
    plant.reset(np.zeros(3))
    return plant
