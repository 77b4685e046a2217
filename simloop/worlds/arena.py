"""Arenas: load an MJCF world, and add the vehicle and the content of a layout.

An arena file is a world without a vehicle. In those of the package, the floor is a geom named
``floor``, walls are named ``wall_*`` and obstacles ``obstacle_*``. All are in geom group 0, which
the LiDAR sees. The vehicle's visual geoms are in group 2 and its collision geoms in group 3. The
numeric ``bounds`` gives the free space. `simloop.worlds.mjcf` reads the file.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from simloop.common.data_files import models_dir
from simloop.common.errors import InputError, printable
from simloop.common.limits import ARENA_SIDE_M, LOOSE_BODIES, check_limit
from simloop.config import PayloadConfig
from simloop.messages import FloatArray
from simloop.physics.engine import warnings_heard
from simloop.worlds.layout import Layout
from simloop.worlds.mjcf.climb import Climb
from simloop.worlds.mjcf.join import join, vehicle_spec
from simloop.worlds.mjcf.reader import read_spec
from simloop.worlds.mjcf.stands import Stands
from simloop.worlds.mjcf_ground import add_loose, add_movers, add_terrain, climb_of
from simloop.worlds.mjcf_obstacles import add_obstacles
from simloop.worlds.obstacles import Obstacle
from simloop.worlds.terrain import Loose, Terrain

_OVERLAP_M = 0.001  # penetration above which two geoms overlap
_FEW_JOINTS = 8  # the vehicle's three, and some loose bodies
_HEAP_BYTES = 2**29
_MANY_BODIES = 500  # with more, the search for contacts needs more memory than MuJoCo takes
_SAME_M = 1e-6
_RIM_M = 0.2  # width of the floor beyond the bounds, on which walls stand


def arena_names() -> list[str]:
    """List the arenas of the package.

    Returns:
        Their names in alphabetical order.
    """
    return sorted(path.stem for path in (models_dir() / "arenas").glob("*.xml"))


def arena_path(arena: str | Path) -> Path:
    """Find the MJCF file of an arena.

    Args:
        arena: a name, or a path ending in ``.xml``.

    Returns:
        The file.

    Raises:
        ValueError: the file does not exist or the name is unknown; the error lists the names.
    """
    if _is_file(arena):
        path = Path(arena)
        try:
            found = path.exists()
        except (OSError, ValueError):  # e.g. a loop of links, or a name that is too long
            found = False
        if not found:
            raise InputError(f"no arena file {path}")
        return path
    if str(arena) not in arena_names():
        raise InputError(f"unknown arena {str(arena)!r}; the arenas are {', '.join(arena_names())}")
    return models_dir() / "arenas" / f"{arena}.xml"


def _is_file(arena: str | Path) -> bool:
    """Tell whether an arena is a file of its own, not one of the package's by its name."""
    return str(arena).endswith(".xml")


def assemble(layout: Layout, friction: float = 0.6) -> mujoco.MjSpec:
    """Assemble a world from the arena, the vehicle and the layout, without compiling it.

    Args:
        layout: the description of the world.
        friction: coefficient of friction of the tracks; it decides which terrain can be climbed,
            and therefore counts as ground.

    Returns:
        The specification. The vehicle keeps the names of its own file and stands at the origin.

    Raises:
        ValueError: as `assemble_with_notes`.
    """
    return assemble_with_notes(layout, friction)[0]


def assemble_with_notes(
    layout: Layout, friction: float = 0.6
) -> tuple[mujoco.MjSpec, tuple[str, ...]]:
    """Assemble a world, and tell what of the arena's file is not used or was decided.

    Args:
        layout: the description of the world.
        friction: coefficient of friction of the tracks.

    Returns:
        The specification as from `assemble`, and lines for the user.

    Raises:
        ValueError: the arena is unknown, MuJoCo does not accept its file, or it has geoms or
            joints that LiDAR, contacts and floor plan would treat differently.
    """
    path = arena_path(layout.arena)
    check_limit(len(layout.loose), LOOSE_BODIES, "loose: bodies")
    said: list[str] = []
    try:
        world = join(_read(path, layout, climb_of(vehicle_spec(), friction), said))
        if layout.bounds_m is not None and not _is_file(layout.arena):
            _resize(world, np.array(layout.bounds_m, np.float64))
        add_obstacles(world, layout.obstacles)
        if layout.terrain is not None:
            add_terrain(world, layout.terrain, friction)
        add_loose(world, layout.loose)
        add_movers(world, layout.movers)
    except (ValueError, mujoco.FatalError) as error:
        raise _named(path, error) from error
    world.modelname, world.modelfiledir = path.stem, str(path.resolve().parent)
    return world, tuple(f"{path.name}: {printable(text, 400)}" for text in said)


def _read(path: Path, layout: Layout, climb: Climb, said: list[str]) -> mujoco.MjSpec:
    """Read an arena's file and check it; the result has numeric bounds."""
    arena, model, notes = read_spec(path)
    said += notes
    _check_joints(arena)
    rectangle = Stands(arena, model, climb).classify(path, said)
    numeric = arena.numeric("bounds")
    if layout.bounds_m is not None:
        bounds = np.array(layout.bounds_m, np.float64)
        if _is_file(layout.arena):
            _check_floor_below(bounds, rectangle)
    elif numeric is not None:
        bounds = np.array(list(numeric.data), np.float64)
    elif rectangle is not None:
        bounds = rectangle
        x0, y0, x1, y1 = bounds
        said.append(
            f"no numeric 'bounds': the floor's x {x0:g} to {x1:g}, y {y0:g} to {y1:g} m are used"
        )
    else:
        raise InputError(
            "the arena has no numeric 'bounds' of four numbers, and its floor has no end: give "
            "bounds_m in the scenario"
        )
    if numeric is not None:
        arena.delete(numeric)
    arena.add_numeric(name="bounds", data=list(_checked_bounds(bounds)), size=4)
    return arena


def compile_spec(
    world: mujoco.MjSpec, timestep_s: float = 0.002, payload: PayloadConfig | None = None
) -> mujoco.MjModel:
    """Compile an assembled world.

    Args:
        world: result of ``assemble``; payload and options are set in it.
        timestep_s: the physics step, s.
        payload: a load on the chassis, if any.

    Returns:
        The compiled model.

    Raises:
        ValueError: MuJoCo refuses the world. The text has one line.
    """
    if payload is not None:
        add_payload(world, payload)
    _set_options(world, timestep_s)
    try:
        # The arena's own warnings have been said when it was read. These are about the joining.
        with warnings_heard(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return world.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise _named(Path(f"{world.modelname}.xml"), error) from error


def build(
    arena: str | Path,
    obstacles: Sequence[Obstacle] = (),
    timestep_s: float = 0.002,
    payload: PayloadConfig | None = None,
    terrain: Terrain | None = None,
    loose: Sequence[Loose] = (),
    friction: float = 0.6,
) -> mujoco.MjModel:
    """Compile an arena with the vehicle at its origin and further things in it.

    Args:
        arena: a name, or the path of an MJCF file.
        obstacles: obstacles in addition to the arena's own.
        timestep_s: the physics step, s.
        payload: a load on the chassis, if any.
        terrain: ground that is not flat, if any.
        loose: movable bodies.
        friction: coefficient of friction of the tracks; it decides which terrain can be climbed,
            and therefore counts as ground.

    Returns:
        The compiled model.

    Raises:
        ValueError: the arena is unknown, or MuJoCo does not accept the file.
    """
    layout = Layout(None, tuple(obstacles), str(arena), terrain, tuple(loose))
    return compile_spec(assemble(layout, friction), timestep_s, payload)


def bounds_of(model: mujoco.MjModel) -> FloatArray:
    """Read the bounds of the free space in a compiled world.

    Args:
        model: the compiled world.

    Returns:
        (4,) x_min, y_min, x_max, y_max in map, m.

    Raises:
        ValueError: the arena has no bounds.
    """
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, "bounds")
    if index < 0:
        return _checked_bounds(np.zeros(0))
    start, count = model.numeric_adr[index], model.numeric_size[index]
    return _checked_bounds(model.numeric_data[start : start + count])


def bounds_of_spec(world: mujoco.MjSpec) -> FloatArray:
    """Read the bounds of the free space in a world that is not compiled yet.

    Args:
        world: the specification.

    Returns:
        (4,) x_min, y_min, x_max, y_max in map, m.

    Raises:
        ValueError: the arena has no bounds.
    """
    numeric = world.numeric("bounds")
    return _checked_bounds(np.zeros(0) if numeric is None else np.array(list(numeric.data)))


def _check_floor_below(bounds: FloatArray, rectangle: FloatArray | None) -> None:
    """Raise InputError for a scenario's bounds (4,) beyond a floor that has an end."""
    if rectangle is None:
        return
    low, high = rectangle[:2] - _SAME_M, rectangle[2:] + _SAME_M
    if np.any(bounds[:2] < low) or np.any(bounds[2:] > high):
        x0, y0, x1, y1 = rectangle
        raise InputError(
            f"bounds_m: reaches beyond the floor, which has x {x0:g} to {x1:g}, y {y0:g} to {y1:g}"
        )


def _checked_bounds(numbers: FloatArray) -> FloatArray:
    """Copy the bounds, and raise InputError for wrong ones."""
    if len(numbers) != 4:
        raise InputError("the arena has no numeric 'bounds' of four numbers")
    sides = numbers[2:] - numbers[:2]
    if not np.all(sides > 0.0):
        raise InputError(
            "the arena's bounds must be x_min, y_min, x_max, y_max with a positive area"
        )
    check_limit(float(sides.max()), ARENA_SIDE_M, "the arena's bounds: length of a side", "m")
    return np.array(numbers, dtype=np.float64)


def _named(path: Path, error: Exception) -> InputError:
    """Make an error in one line that begins with the arena's file."""
    text = str(error)
    return InputError(text if text.startswith(f"{path.name}") else f"{path.name}: {text}")


def overlaps(model: mujoco.MjModel, start: Sequence[float] | FloatArray) -> list[tuple[str, str]]:
    """List pairs of geoms that overlap at the start, if one of them is loose or moving.

    Args:
        model: the compiled world.
        start: (3,) x, y, yaw of base_link in map, m, m, rad.

    Returns:
        The names of both geoms of each pair; "the robot" for the vehicle's geoms.

    Raises:
        InputError: so many bodies overlap that MuJoCo has no memory for their contacts.
    """
    data = mujoco.MjData(model)
    base = model.body("base_link")
    at = int(model.jnt_qposadr[base.jntadr[0]])
    data.qpos[at : at + 2] = start[:2]
    data.qpos[at + 3 : at + 7] = math.cos(0.5 * start[2]), 0.0, 0.0, math.sin(0.5 * start[2])
    try:
        with warnings_heard() as heard:
            mujoco.mj_forward(model, data)
    except mujoco.FatalError as error:
        heard = [str(error)]
    if heard:
        raise InputError(f"the physics breaks down at the start: {heard[0]}")
    pairs = []
    for contact in data.contact[: data.ncon]:
        bodies = model.body_rootid[model.geom_bodyid[contact.geom]]
        if contact.dist < -_OVERLAP_M and np.any((bodies != 0) & (bodies != base.id)):
            first, second = (
                "the robot" if body == base.id else model.geom(geom).name
                for body, geom in zip(bodies, contact.geom, strict=True)
            )
            pairs.append((first, second))
    return pairs


def _resize(world: mujoco.MjSpec, bounds: FloatArray) -> None:
    """Give the floor other bounds (4,), and move the overview camera so that it shows them."""
    middle, half = 0.5 * (bounds[:2] + bounds[2:]), 0.5 * (bounds[2:] - bounds[:2])
    world.numeric("bounds").data = bounds
    floor = world.geom("floor")
    floor.pos, floor.size = [*middle, 0.0], [*(half + _RIM_M), 0.1]
    reach = float(half.max())
    world.stat.center, world.stat.extent = [*middle, 0.1], 2.0 * reach
    for camera in world.cameras:
        if camera.name == "overview":
            camera.pos = [middle[0], middle[1] - 1.7 * reach, 2.6 * reach]


def add_payload(world: mujoco.MjSpec, payload: PayloadConfig) -> None:
    """Add a load to the chassis: a small, dense body that is invisible and touches nothing.

    Args:
        world: the specification with the vehicle.
        payload: mass and position; a mass of 0 adds nothing.
    """
    if payload.mass_kg > 0.0:
        load = world.body("base_link").add_body(name="payload", pos=list(payload.position_m))
        load.mass, load.inertia = payload.mass_kg, [1e-3 * payload.mass_kg] * 3
        load.explicitinertial = True


def _check_joints(arena: mujoco.MjSpec) -> None:
    """Raise InputError for joints other than the free joints of bodies that are named as loose."""
    for joint in arena.joints:
        body = joint.parent
        names = [body.name, *(geom.name for geom in body.geoms)]
        free = joint.type == mujoco.mjtJoint.mjJNT_FREE
        if not free or not all(name.startswith(("loose_", "obstacle_")) for name in names):
            raise InputError(
                "an arena must be static, but this one has a joint "
                f"({printable(joint.name, 80) or 'no name'}): only bodies on free joints may move; "
                "name them and their geoms loose_* or obstacle_*"
            )
    if any(body.mocap for body in arena.bodies):
        raise InputError("an arena must not have mocap bodies: use [[movers]]")


def _set_options(world: mujoco.MjSpec, timestep_s: float) -> None:
    """Set the solver options for few, frictionless contacts and eight degrees of freedom."""
    option = world.option
    option.timestep = timestep_s
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    _reserve_memory(world)


def _reserve_memory(world: mujoco.MjSpec) -> None:
    """Give MuJoCo room for many bodies: without it, a step would fail and end the process.

    A heap of loose bodies has thousands of contacts. The search for contacts takes 4 bytes for each
    pair of bodies (measured).
    """
    bodies = len(world.bodies)
    if len(world.joints) > _FEW_JOINTS:
        world.memory = _HEAP_BYTES
    if bodies > _MANY_BODIES:
        world.memory = max(world.memory, 2**24 + 8 * bodies**2)
