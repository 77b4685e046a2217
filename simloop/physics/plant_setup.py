"""What a plant makes of its model and configuration before the first step."""

from __future__ import annotations

import copy

import mujoco

from simloop.config import Config
from simloop.physics.track_model import BodyArrays, TrackParameters, track_parameters
from simloop.physics.vehicle_geoms import road_wheels, sprocket_radius

_GRAVITY_MPS2 = 9.81


def own_copy(model: mujoco.MjModel, config: Config) -> mujoco.MjModel:
    """Copy a model, with the configuration's time step and rotors.

    One world may serve several plants, and each step writes the joints' friction into the model.

    Args:
        model: an arena with the vehicle; it stays as it is.
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
    """Collect the track kernels' constants: measures and weight of the model, the rest as set.

    Args:
        model: an arena with the vehicle.
        config: the settings.

    Returns:
        The constants.
    """
    # Each road wheel stands for as much belt as there is between two of them.
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
        dof: the vehicle's first degree of freedom; other bodies may come before it.

    Returns:
        The views, which stay valid as long as the model and its state.
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
