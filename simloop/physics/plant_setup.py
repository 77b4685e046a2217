"""Prepare what a plant needs from its model and configuration, and check its state."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco
import numpy as np

from simloop.common.errors import printable
from simloop.config import Config
from simloop.messages import FloatArray
from simloop.physics.track_model import BodyArrays, TrackParameters, track_parameters
from simloop.physics.vehicle_geoms import road_wheels, sprocket_radius

_GRAVITY_MPS2 = 9.81
_FASTEST = 100.0  # m/s or rad/s; a vehicle that is faster has been thrown out of something
_FASTEST_LOOSE = 1000.0


def own_copy(model: mujoco.MjModel, config: Config) -> mujoco.MjModel:
    """Copy a model, and set the configuration's time step and rotor inertia in the copy.

    One world may serve several plants, and each step writes the joints' friction into its model.

    Args:
        model: an arena with the vehicle; not changed.
        config: the settings.

    Returns:
        The copy.
    """
    model = copy.copy(model)
    model.opt.timestep = config.rates.physics_s
    dofs = [model.joint(f"sprocket_{side}_joint").dofadr[0] for side in ("left", "right")]
    model.dof_armature[dofs] = config.motor.rotor_inertia_kgm2
    return model


def track_constants(model: mujoco.MjModel, config: Config) -> TrackParameters:
    """Collect the track kernels' constants: sizes and weight from the model, the rest from config.

    Args:
        model: an arena with the vehicle.
        config: the settings.

    Returns:
        The constants.
    """
    # Each road wheel carries as much belt as there is between two wheels.
    x = model.geom_pos[road_wheels(model), 0]
    a_side = len(x) // 2
    return track_parameters(
        config.tracks,
        config.motor,
        sprocket_radius(model),
        config.rates.physics_s,
        0.5 * float(x[0] - x[a_side - 1]) / (a_side - 1),
        _GRAVITY_MPS2 * float(model.body_subtreemass[model.body("base_link").id]),
    )


def body_arrays(model: mujoco.MjModel, data: mujoco.MjData, dof: int) -> BodyArrays:
    """Make the kernels' views into MuJoCo's state.

    Args:
        model: an arena with the vehicle.
        data: its state.
        dof: the vehicle's first degree of freedom. Other bodies may come before it.

    Returns:
        The views. They are valid as long as the model and its state.
    """
    base = model.body("base_link").id
    return BodyArrays(
        data.xpos[base],
        data.xmat[base],
        data.qvel[dof:],
        data.xipos,
        data.cvel,
        data.subtree_com,
        data.xfrc_applied,
        model.body_rootid,
        model.body_weldid != 0,
        data.qfrc_applied[dof:],
        data.qfrc_constraint[dof:],
        model.dof_frictionloss[dof:],
        base,
    )


def instability(data: mujoco.MjData, vehicle: FloatArray, heard: Sequence[str]) -> str:
    """Tell whether the physics has broken down since the state was reset.

    MuJoCo warns, and then goes on: it resets a state with huge numbers, and leaves out contacts
    for which it has no memory. Neither is a run of this robot in this world.

    Args:
        data: the state.
        vehicle: (8,) the vehicle's velocities, m/s and rad/s.
        heard: MuJoCo's warnings of the last steps.

    Returns:
        The reason in one line; empty if all is well.
    """
    if heard:
        return f"MuJoCo warns: {printable(heard[0], 300)}"
    if not all(-_FASTEST < one < _FASTEST for one in vehicle.tolist()):  # also for NaN
        return f"the vehicle moves with more than {_FASTEST:g} m/s or rad/s"
    if not np.abs(data.qvel).max() < _FASTEST_LOOSE:
        return f"a loose body moves with more than {_FASTEST_LOOSE:g} m/s or rad/s"
    return ""
