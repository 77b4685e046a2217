"""The model of the tracks: its constants, its state, and the arrays that its kernels share.

MuJoCo solves the frictionless support contacts of the road wheels. The shear forces are computed
here. Each road wheel carries its share of the belt, which is cut into a front and a rear cell (see
`brush`). Where the wheel touches, the cells' shear acts on the vehicle, and the opposite force acts
on any movable body under it. The sprocket bears the reaction of the belt: its joint feels the
torque -r sum(F . t), with t the belt's direction at the contact and r the sprocket's radius.

A wheel may touch several surfaces at once, for example the ground and the edge of a step. Each
surface is a patch with its own cells (see `track_contacts`).

The motor (EMG49) is a voltage source behind a resistance and a back electromotive force. Its driver
limits the current. The joint's ``frictionloss`` is the sum of the gear friction, the rolling
resistance of the loaded track, and the holding brake's torque if the brake is on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import config as numba_config
from numba import njit
from numpy.typing import NDArray

from simloop.common.grey_image import read_grey
from simloop.config import FrictionImage, FrictionZone, MotorConfig, TracksConfig
from simloop.messages import FloatArray

# Kinds of geoms in the kernels. Road wheel i is WHEEL + i.
GROUND, OBSTACLE, HULL, WHEEL = 0, 1, 2, 3
PATCHES = 3
"""Most surfaces that one road wheel can touch at a time."""
Record = Any
"""A row of a structured array in a kernel. Its fields have names."""
MOST_WHEELS = 32
"""Most road wheels, both sides together."""
# Each argument of a kernel costs time in the interpreter at every call. Therefore the whole state
# of the tracks is in one block, whose size does not depend on the vehicle.
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
"""The largest load of a patch that gives friction, in weights of the vehicle.

A harder impact lasts one or two steps. The kernel knows a step's load only after the step, so
friction in proportion to such an impact would throw the vehicle instead of holding it.
"""


class TrackParameters(NamedTuple):
    """Constants of the track kernels.

    Attributes:
        friction: Coulomb friction mu outside all zones.
        shear_modulus: K, m.
        shear_damping: time constant c of the brush, s.
        rolling_resistance: drag over load.
        radius: radius of the sprockets, m.
        resistance: armature resistance of a motor, ohm.
        torque_per_a: torque constant at the output shaft, N m/A.
        back_emf: back-EMF constant at the output shaft, V s/rad.
        current_limit: current limit of the driver, A.
        gear_friction: gear friction at the output shaft, N m.
        brake_torque: torque of a holding brake, N m.
        cell: length of a cell, half a road wheel's share of the belt, m.
        most_load: the largest load of a patch that gives friction, N.
        dt: physics step, s.
    """

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
    """State and results of the kernels, as views into a block of `STATE_BLOCK`.

    Wheels are ordered front to rear, left before right. The block's other fields are work space.

    Attributes:
        mean: (wheels, PATCHES, 2, 2) mean shear displacement of each patch's front and rear cell,
            along and across the belt, m.
        outlet: (wheels, PATCHES, 2, 2) displacement at the cells' downstream ends, m.
        normal: (wheels, PATCHES, 3) normals of the patches in base_link; 0 where there is no patch.
        body: (wheels, PATCHES) numbers of the bodies under the patches.
        main: (wheels,) the most loaded patch; -1 where there is none.
        load: (wheels,) load of each wheel, N.
        current: (2,) motor currents, left and right, A.
        track_force: (2,) thrust along the belts, N.
        slip: (2,) speed of the belts' surface over the ground, weighted by load, m/s; negative
            if the belt drives.
        work: (4,) work since the reset, J: electrical, shear, joint friction, motor shafts.
        last: (8,) velocities of the last step: base_link's at its centre of mass, linear (3,) m/s,
            angular (3,) rad/s, and the sprockets', rad/s.
        touching: (1,) number of the vehicle's contacts with obstacles.
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
        """Make the views into a block.

        Args:
            block: (1,) of `STATE_BLOCK`.

        Returns:
            Views, cut to the number of wheels.
        """
        wheels = int(block["wheels"][0])
        fields = {name: block[name][0] for name in cls._fields}
        cut = {name: f[:wheels] if len(f) == MOST_WHEELS else f for name, f in fields.items()}
        return cls(**cut)


def state_block(wheels: int) -> NDArray[np.void]:
    """Make the state of tracks at rest in the air.

    Args:
        wheels: road wheels of both sides together.

    Returns:
        (1,) of `STATE_BLOCK`.

    Raises:
        ValueError: there are more than MOST_WHEELS road wheels.
    """
    if wheels > MOST_WHEELS:
        raise ValueError(
            f"the vehicle has {wheels} road wheels; at most {MOST_WHEELS} are supported"
        )
    block = np.zeros(1, STATE_BLOCK)
    block["wheels"], block["main"] = wheels, -1
    return _with_names(block)


def as_block(values: tuple[float, ...]) -> NDArray[np.void]:
    """Turn a named tuple of floats into a structured array: one argument for a kernel, not many.

    Args:
        values: the named tuple.

    Returns:
        (1,) with the tuple's fields.
    """
    kind = np.dtype([(name, np.float64) for name in values._fields])  # type: ignore[attr-defined]
    return _with_names(np.array([tuple(values)], kind))


def _with_names(block: NDArray[np.void]) -> NDArray[np.void]:
    """Let uncompiled kernels (NUMBA_DISABLE_JIT=1) read a row's fields as compiled ones do."""
    return block.view(np.dtype((_Row, block.dtype))) if numba_config.DISABLE_JIT else block


class _Row(np.record):  # type: ignore[misc]
    """A row whose fields come before numpy's own methods of the same name, such as ``mean``."""

    def __getattribute__(self, name: str) -> Any:
        fields = super().__getattribute__("dtype").fields or {}
        return self[name] if name in fields else super().__getattribute__(name)

    def __setattr__(self, name: str, value: Any) -> None:
        self[name] = value


class ContactArrays(NamedTuple):
    """MuJoCo's contacts.

    Attributes:
        geom: (n, 2) the geoms that touch.
        pos: (n, 3) positions in the world, m.
        frame: (n, 9) axes in the world; the first three are the normal from first to second geom.
        row: (n,) the contact's row in ``force``; negative where it has none.
        force: (rows,) forces of the constraints, N.
    """

    geom: NDArray[np.int32]
    pos: FloatArray
    frame: FloatArray
    row: NDArray[np.int32]
    force: FloatArray


class BodyArrays(NamedTuple):
    """Views into MuJoCo's state. They stay valid.

    Kernels only read them, except the three that are marked as written.

    Attributes:
        position: (3,) of base_link in the world, m.
        rotation: (9,) world_from_base, row by row.
        velocity: (nv,) qvel from the vehicle's free joint on; the first six are base_link's linear
            velocity in the world, m/s, and its angular velocity in base_link, rad/s.
        com: (nbody, 3) centres of mass in the world, m.
        cvel: (nbody, 6) angular, rad/s, then linear velocity, m/s, at the tree's centre of mass.
        subtree_com: (nbody, 3) centres of mass of the trees, m.
        wrench: (nbody, 6) forces, N, and torques, N m, in the world; written.
        root: (nbody,) the roots of the bodies' trees.
        moves: (nbody,) whether a body can move.
        joint_force: (nv,) applied, N or N m, from the vehicle's free joint on; written.
        joint_constraint: (nv,) constraint forces, N or N m.
        joint_friction: (nv,) dry friction, N or N m; written.
        base: base_link's number.
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
    """What the kernels must know of the model's geoms and joints.

    Attributes:
        kind: (ngeom,) GROUND, OBSTACLE, HULL, or WHEEL + the road wheel's number.
        body: (ngeom,) the geoms' bodies.
        sprocket_dof: (2,) degrees of freedom of the left and right sprocket, counted from the
            vehicle's free joint.
    """

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
    """Collect the kernels' constants.

    Args:
        tracks: settings of the contact between track and ground.
        motor: settings of the motors.
        radius_m: true radius of the sprockets, m.
        dt_s: physics step, s.
        cell_m: half a road wheel's share of the belt, m.
        weight_n: weight of the vehicle, N.

    Returns:
        The constants.
    """
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
    """Friction of the ground at each place.

    Attributes:
        zones: (n, 5) x_min, y_min, x_max, y_max in map, m, and friction. Where zones overlap the
            last one holds. A zone whose friction is NaN takes it from ``image``.
        image: (rows, columns) friction over its zone: rows from y_min, columns from x_min.
    """

    zones: FloatArray
    image: FloatArray


def friction_map(zones: Sequence[FrictionZone], image: FrictionImage | None = None) -> FrictionMap:
    """Build the friction map of a scenario's ground.

    Args:
        zones: rectangles with their own friction.
        image: a grey image that lies below all zones.

    Returns:
        The map.

    Raises:
        InputError: the image cannot be read.
    """
    rows = [(*zone.min_m, *zone.max_m, zone.friction) for zone in zones]
    pixels = np.zeros((1, 1))
    if image is not None:
        rows.insert(0, (*image.min_m, *image.max_m, np.nan))
        pixels = image.black + (image.white - image.black) * read_grey(image.file)
    return FrictionMap(np.array(rows, dtype=np.float64).reshape(-1, 5), pixels)


@njit(cache=True)
def friction_at(x: float, y: float, ground: FrictionMap, elsewhere: float) -> float:
    """Look up the ground's friction at a place.

    Args:
        x: in map, m.
        y: in map, m.
        ground: the friction map.
        elsewhere: friction outside all zones.

    Returns:
        The friction; in an image, that of the nearest pixel.
    """
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
    """Compute the armature current of a motor: (V - k_e w) / R, limited by the driver.

    Args:
        voltage: V, requested at the terminals, V.
        speed: w of the output shaft, rad/s.
        p: the constants.

    Returns:
        The current, A.
    """
    current = (voltage - p.back_emf * speed) / p.resistance
    return min(max(current, -p.current_limit), p.current_limit)
