"""The physics steps of one control period: movers, tracks, MuJoCo's step, and contacts counted."""

from __future__ import annotations

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.physics.engine import Engine, contact_arrays, contacts_of, step_engine
from simloop.physics.track_kernel import apply_tracks
from simloop.physics.track_model import BodyArrays, FrictionMap, Geoms

CONTACTS, HITS, TOUCHING = range(3)  # what `advance` counts
_STILL_MPS = 0.01  # belt speed below which the vehicle counts as standing


@njit(cache=True)
def advance(
    steps: int,
    engine: Engine,
    movers_m: FloatArray,
    way_m: FloatArray,
    geoms: Geoms,
    zones: FrictionMap,
    voltage: FloatArray,
    braked: bool,
    body: BodyArrays,
    block: NDArray[np.void],
    constants: NDArray[np.void],
    counts: NDArray[np.int64],
) -> None:
    """Do physics steps in one compiled call.

    Args:
        steps: How many.
        engine: MuJoCo's addresses, of the same model and state as the other arguments.
        movers_m: (m, 3) positions of MuJoCo's mocap bodies, m; updated.
        way_m: (m, 2) how far they move in each step, m; (0, 2) if none does.
        geoms: The kind of each geom.
        zones: The ground's friction.
        voltage: (2,) motor voltages, left and right, V.
        braked: Whether the holding brakes are on.
        body: Views into MuJoCo's state; the inputs of the steps are written.
        block: (1,) of `STATE_BLOCK`; updated.
        constants: (1,) the `TrackParameters`.
        counts: (3,) contacts so far, hits of the standing vehicle so far, and whether the vehicle
            touches an obstacle, 0 or 1; updated.
    """
    for _ in range(steps):
        _move(movers_m, way_m)
        contacts = contacts_of(engine)
        apply_tracks(contacts, geoms, zones, voltage, braked, body, block, constants)
        step_engine(engine)
        _count(geoms, voltage, body, block, constants, counts)


def advance_plainly(
    steps: int,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    way_m: FloatArray,
    geoms: Geoms,
    zones: FrictionMap,
    voltage: FloatArray,
    braked: bool,
    body: BodyArrays,
    block: NDArray[np.void],
    constants: NDArray[np.void],
    counts: NDArray[np.int64],
) -> None:
    """Do physics steps by way of MuJoCo's bindings: slower, and the oracle of `advance`.

    Args:
        steps: How many.
        model: The model.
        data: Its state.
        way_m: (m, 2) as in `advance`, like all that follow.
        geoms: The kind of each geom.
        zones: The ground's friction.
        voltage: (2,) motor voltages, V.
        braked: Whether the holding brakes are on.
        body: Views into MuJoCo's state.
        block: (1,) of `STATE_BLOCK`.
        constants: (1,) the `TrackParameters`.
        counts: (3,) contacts, hits and whether the vehicle touches an obstacle.
    """
    for _ in range(steps):
        _move(data.mocap_pos, way_m)
        contacts = contact_arrays(data)
        apply_tracks(contacts, geoms, zones, voltage, braked, body, block, constants)
        mujoco.mj_step(model, data)
        _count(geoms, voltage, body, block, constants, counts)


@njit(cache=True)
def _move(movers_m: FloatArray, way_m: FloatArray) -> None:
    """Move each mover by its way (m, 2)."""
    for i in range(way_m.shape[0]):
        movers_m[i, 0] += way_m[i, 0]
        movers_m[i, 1] += way_m[i, 1]


@njit(cache=True)
def _count(
    geoms: Geoms,
    voltage: FloatArray,
    body: BodyArrays,
    block: NDArray[np.void],
    constants: NDArray[np.void],
    counts: NDArray[np.int64],
) -> None:
    """Count a contact that begins, as a hit if the vehicle stands: motors off, belts at rest."""
    touching = block[0].touching[0] > 0
    if touching and counts[TOUCHING] == 0:
        left, right = geoms.sprocket_dof
        fastest = max(abs(body.velocity[left]), abs(body.velocity[right]))
        # After a hit, belts may move.
        at_rest = counts[HITS] > 0 or constants[0].radius * fastest < _STILL_MPS
        stands = voltage[0] == 0.0 and voltage[1] == 0.0 and at_rest
        counts[HITS if stands else CONTACTS] += 1
    counts[TOUCHING] = 1 if touching else 0
