"""Prepare what a plant needs from its model and configuration before the first step."""

from __future__ import annotations

import copy

import mujoco

from simloop.config import Config
from simloop.physics.track_model import BodyArrays, TrackParameters, track_parameters
from simloop.physics.vehicle_geoms import road_wheels, sprocket_radius

_GRAVITY_MPS2 = 9.81


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
