"""Track-ground forces with slip, the belt's reaction on its sprocket, and the motor's law.

MuJoCo solves the frictionless support contacts of the road wheels; the shear forces are ours.
Each road wheel stands for its share of the belt, cut into a front and a rear cell (see
``brush``). Where it touches, the cells' shear acts on the vehicle, and on whatever movable
body it touches the other way. What the belt gives the ground, the sprocket pays: the torque
on its joint is -r sum(F . t), t the belt's direction at the contact, r the sprocket's radius.

A wheel may touch several surfaces at once (the ground and a step's edge): each is a patch with
cells of its own, known again from step to step by its body and its normal.

The motor (EMG49) is a voltage source behind a resistance and a back electromotive force,
its current clipped by the driver; gear friction is the joint's ``frictionloss``, to which
the rolling resistance of the loaded track is added, and the holding brake where it is on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.common.grey_image import read_grey
from simloop.config import FrictionImage, FrictionZone, MotorConfig, TracksConfig
from simloop.messages import FloatArray

# What a geom is, as the kernel sees it; road wheel i is WHEEL + i.
GROUND, OBSTACLE, HULL, WHEEL = 0, 1, 2, 3
PATCHES = 3
"""Surfaces that one road wheel can touch at a time."""
Record = Any
"""A row of a structured array, as kernels see it: fields by name."""
MOST_WHEELS = 32
"""Road wheels of both sides together, at most."""
# A kernel's argument costs its way through the interpreter, a hundred of them a tick: so all that
# is the tracks' own lies in one block, of a size that does not depend on the vehicle.
STATE_BLOCK = np.dtype(
    [
        ("mean", np.float64, (MOST_WHEELS, PATCHES, 2, 2)),
        ("outlet", np.float64, (MOST_WHEELS, PATCHES, 2, 2)),
        ("normal", np.float64, (MOST_WHEELS, PATCHES, 3)),
        ("body", np.int64, (MOST_WHEELS, PATCHES)),
        ("main", np.int64, (MOST_WHEELS,)),
        ("load", np.float64, (MOST_WHEELS,)),
        ("current", np.float64, (2,)),
        ("track_force", np.float64, (2,)),
        ("slip", np.float64, (2,)),
        ("work", np.float64, (4,)),
        ("last", np.float64, (8,)),
        ("touching", np.int64, (1,)),
        ("touched", np.float64, (MOST_WHEELS, PATCHES, 7)),
        ("entering", np.float64, (2,)),
        ("sliding", np.float64, (2,)),
        ("rate", np.float64, (2,)),
        ("wheels", np.int64),
    ]
)


_HARDEST_WEIGHTS = 4.0
"""A harder blow than so many times the vehicle's weight is over within a step or two: friction, of
which the kernel knows only when the step is done, would throw the vehicle instead of holding it."""


class TrackParameters(NamedTuple):
    """Constants of the kernel; units as in the configuration, dt in s; cell: half a wheel's, m;
    most_load: N, what a patch's friction is reckoned with at most."""

    friction: float
    shear_modulus: float
    shear_damping: float
    rolling_resistance: float
    radius: float
    resistance: float
    torque_per_a: float
    back_emf: float
    current_limit: float
    gear_friction: float
    brake_torque: float
    cell: float
    most_load: float
    dt: float


class TrackState(NamedTuple):
    """What the kernel keeps and tells, as views into a block (see `STATE_BLOCK`, whose further
    fields are the kernel's scratch); wheels front to rear, left before right.

    mean, outlet: (wheels, patches, 2, 2) m, each patch's front and rear cell, along and across.
    normal: (wheels, patches, 3) of the patches in base_link, 0 where none is; body: (wheels,
    patches) what they lie on. main: (wheels,) the most loaded patch, -1 where none is.
    load: (wheels,) N. current: (2,) A. track_force: (2,) N along the belt. slip: (2,) m/s along
    the belt, weighted by load. work: (4,) J of electrical energy, of shear work, of joint friction
    and of the motors' shafts. last: (8,) velocities of the last step: base_link's at its centre of
    mass, linear, angular, and the sprockets'. touching: (1,) contacts of the vehicle with
    anything but the ground.
    """

    mean: FloatArray
    outlet: FloatArray
    normal: FloatArray
    body: NDArray[np.int64]
    main: NDArray[np.int64]
    load: FloatArray
    current: FloatArray
    track_force: FloatArray
    slip: FloatArray
    work: FloatArray
    last: FloatArray
    touching: NDArray[np.int64]

    @classmethod
    def within(cls, block: NDArray[np.void]) -> TrackState:
        """The views into a block (1,)."""
        wheels = int(block["wheels"][0])
        fields = {name: block[name][0] for name in cls._fields}
        cut = {name: f[:wheels] if len(f) == MOST_WHEELS else f for name, f in fields.items()}
        return cls(**cut)


def state_block(wheels: int) -> NDArray[np.void]:
    """(1,) of `STATE_BLOCK`, at rest in the air; wheels: on both sides together."""
    if wheels > MOST_WHEELS:
        raise ValueError(f"{wheels} road wheels; no more than {MOST_WHEELS} are provided for")
    block = np.zeros(1, STATE_BLOCK)
    block["wheels"], block["main"] = wheels, -1
    return block


def as_block(values: tuple[float, ...]) -> NDArray[np.void]:
    """(1,) with the fields of a named tuple of floats."""
    kind = np.dtype([(name, np.float64) for name in values._fields])  # type: ignore[attr-defined]
    return np.array([tuple(values)], kind)


class ContactArrays(NamedTuple):
    """MuJoCo's contacts: geom (n, 2), pos (n, 3), frame (n, 9), row (n,); force (nefc,) by row."""

    geom: NDArray[np.int32]
    pos: FloatArray
    frame: FloatArray
    row: NDArray[np.int32]
    force: FloatArray


class BodyArrays(NamedTuple):
    """Views into MuJoCo's state that stay where they are: read, then written.

    position, rotation: (3,), (9,) of base_link; velocity: (nv,) qvel, whose first six
    are base_link's linear velocity (world) and angular velocity (base_link);
    com, cvel, subtree_com, wrench: (nbody, ...) of all bodies; root: (nbody,) their trees' roots;
    moves: (nbody,) whether they can; joint_force, joint_constraint,
    joint_friction: (nv,); base: base_link's number.
    """

    position: FloatArray
    rotation: FloatArray
    velocity: FloatArray
    com: FloatArray
    cvel: FloatArray
    subtree_com: FloatArray
    wrench: FloatArray
    root: NDArray[np.int32]
    moves: NDArray[np.bool_]
    joint_force: FloatArray
    joint_constraint: FloatArray
    joint_friction: FloatArray
    base: int


class Geoms(NamedTuple):
    """kind: (ngeom,) what each geom is; body: (ngeom,); sprocket_dof: (2,) left, right."""

    kind: NDArray[np.int64]
    body: NDArray[np.int32]
    sprocket_dof: NDArray[np.int64]


def track_parameters(
    tracks: TracksConfig,
    motor: MotorConfig,
    radius_m: float,
    dt_s: float,
    cell_m: float = 0.415 / 12,
    weight_n: float = 98.1,
) -> TrackParameters:
    """The kernel's constants. radius_m: of the sprockets. cell_m: half a road wheel's share of the
    belt."""
    return TrackParameters(
        friction=tracks.friction,
        shear_modulus=tracks.shear_modulus_m,
        shear_damping=tracks.shear_damping_s,
        rolling_resistance=tracks.rolling_resistance,
        radius=radius_m,
        resistance=motor.resistance_ohm,
        torque_per_a=motor.torque_nm_per_a,
        back_emf=motor.back_emf_v_per_radps,
        current_limit=motor.current_limit_a,
        gear_friction=motor.no_load_current_a * motor.torque_nm_per_a,
        brake_torque=motor.brake_torque_nm,
        cell=cell_m,
        most_load=_HARDEST_WEIGHTS * weight_n,
        dt=dt_s,
    )


class FrictionMap(NamedTuple):
    """zones: (n, 5) x_min, y_min, x_max, y_max, friction; the last one holds, and one whose
    friction is NaN has that of ``image`` (rows from y_min, columns from x_min) laid over it."""

    zones: FloatArray
    image: FloatArray


def friction_map(zones: Sequence[FrictionZone], image: FrictionImage | None = None) -> FrictionMap:
    """The ground's friction; the image lies below all zones. Raises InputError if unreadable."""
    rows = [(*zone.min_m, *zone.max_m, zone.friction) for zone in zones]
    pixels = np.zeros((1, 1))
    if image is not None:
        rows.insert(0, (*image.min_m, *image.max_m, np.nan))
        pixels = image.black + (image.white - image.black) * read_grey(image.file)
    return FrictionMap(np.array(rows, dtype=np.float64).reshape(-1, 5), pixels)


@njit(cache=True)
def friction_at(x: float, y: float, ground: FrictionMap, elsewhere: float) -> float:
    """Friction of the ground at a place."""
    zones, image = ground.zones, ground.image
    for i in range(zones.shape[0] - 1, -1, -1):
        if zones[i, 0] <= x <= zones[i, 2] and zones[i, 1] <= y <= zones[i, 3]:
            if not np.isnan(zones[i, 4]):
                return zones[i, 4]
            rows, columns = image.shape
            row = int(rows * (y - zones[i, 1]) / (zones[i, 3] - zones[i, 1]))
            column = int(columns * (x - zones[i, 0]) / (zones[i, 2] - zones[i, 0]))
            return image[min(row, rows - 1), min(column, columns - 1)]
    return elsewhere


@njit(cache=True)
def motor_current(voltage: float, speed: float, p: TrackParameters) -> float:
    """Armature current, A, at terminal voltage and output speed, rad/s, clipped by the driver."""
    current = (voltage - p.back_emf * speed) / p.resistance
    return min(max(current, -p.current_limit), p.current_limit)
