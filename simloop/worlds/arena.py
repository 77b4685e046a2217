"""Arenas: load an MJCF world, and add the vehicle and the content of a layout.

An arena file is a world without a vehicle. Its floor is a geom named ``floor``, its walls are named
``wall_*``, its obstacles ``obstacle_*``. All are in geom group 0, which the LiDAR sees. The
vehicle's visual geoms are in group 2 and its collision geoms in group 3. The numeric ``bounds``
gives the free space.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np

from simloop.common.data_files import models_dir
from simloop.config import PayloadConfig
from simloop.messages import FloatArray
from simloop.physics.vehicle_geoms import SEEN_GROUPS
from simloop.worlds.layout import Layout
from simloop.worlds.mjcf_ground import add_loose, add_movers, add_terrain
from simloop.worlds.mjcf_obstacles import add_obstacles
from simloop.worlds.obstacles import Obstacle
from simloop.worlds.terrain import Loose, Terrain

_OVERLAP_M = 0.001  # penetration above which two geoms overlap
_MANY_BODIES, _MANY_LOOSE = 500, 20  # with more, MuJoCo's own size of its memory is too small
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
    if str(arena).endswith(".xml"):
        path = Path(arena)
        if not path.is_file():
            raise ValueError(f"no arena file {path}")
        return path
    if str(arena) not in arena_names():
        raise ValueError(f"unknown arena {str(arena)!r}; the arenas are {', '.join(arena_names())}")
    return models_dir() / "arenas" / f"{arena}.xml"


def assemble(layout: Layout, friction: float = 0.6) -> mujoco.MjSpec:
    """Assemble a world from the arena, the vehicle and the layout, without compiling it.

    Args:
        layout: the description of the world.
        friction: coefficient of friction of the tracks; it decides which terrain can be climbed,
            and therefore counts as ground.

    Returns:
        The specification. The vehicle keeps the names of its own file and stands at the origin.

    Raises:
        ValueError: the arena is unknown, MuJoCo does not accept its file, or it has geoms or
            joints that LiDAR, contacts and floor plan would treat differently.
    """
    path = arena_path(layout.arena)
    try:
        world = _with_vehicle(path)
        _check_arena(world)
        if layout.bounds_m is not None:
            _resize(world, np.array(layout.bounds_m, np.float64))
        add_obstacles(world, layout.obstacles)
        if layout.terrain is not None:
            add_terrain(world, layout.terrain, friction)
        add_loose(world, layout.loose)
        add_movers(world, layout.movers)
    except (ValueError, mujoco.FatalError) as error:
        raise _named(path, error) from error
    return world


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


def _checked_bounds(numbers: FloatArray) -> FloatArray:
    if len(numbers) != 4:
        raise ValueError("the arena has no numeric 'bounds' of four numbers")
    return np.array(numbers, dtype=np.float64)


def _named(path: Path, error: Exception) -> ValueError:
    """Make an error in one line that begins with the arena's file."""
    return ValueError(f"{path.name}: {' '.join(str(error).split())}")


def overlaps(model: mujoco.MjModel, start: Sequence[float] | FloatArray) -> list[tuple[str, str]]:
    """List pairs of geoms that overlap at the start, if one of them is loose or moving.

    Args:
        model: the compiled world.
        start: (3,) x, y, yaw of base_link in map, m, m, rad.

    Returns:
        The names of both geoms of each pair; "the robot" for the vehicle's geoms.
    """
    data = mujoco.MjData(model)
    base = model.body("base_link")
    at = int(model.jnt_qposadr[base.jntadr[0]])
    data.qpos[at : at + 2] = start[:2]
    data.qpos[at + 3 : at + 7] = math.cos(0.5 * start[2]), 0.0, 0.0, math.sin(0.5 * start[2])
    mujoco.mj_forward(model, data)
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


def _with_vehicle(path: Path) -> mujoco.MjSpec:
    """Load the arena and the vehicle in one world."""
    # The files are included, because MuJoCo warns if a model is attached without a prefix.
    models = models_dir()
    files = (path.resolve(), models / "tracked_ugv.xml")
    includes = "".join(f"<include file={quoteattr(str(file))}/>" for file in files)
    assets = sorted((models / "assets").glob("*.obj"))
    meshes = {f"assets/{file.name}": file.read_bytes() for file in assets}
    world = mujoco.MjSpec.from_string(f"<mujoco>{includes}</mujoco>", assets=meshes)
    world.modelname, world.modelfiledir = path.stem, str(path.resolve().parent)
    # The vehicle's file has a plane and a light of its own, so that it can be opened alone.
    world.delete(world.geom("ground"))
    world.delete(world.light("ground_light"))
    # The keyframe holds only the vehicle's joints, not those of loose bodies.
    world.delete(world.key("home"))
    return world


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


def _check_arena(world: mujoco.MjSpec) -> None:
    """Raise ValueError for geoms that LiDAR, contacts and floor plan would treat differently."""
    vehicle = world.body("base_link")
    joints = {joint.name for joint in vehicle.find_all("joint")}
    geoms = {geom.name for geom in vehicle.find_all("geom")}
    for joint in world.joints:
        if joint.name not in joints:
            _check_loose(joint)
    if any(body.mocap for body in world.bodies):
        raise ValueError("an arena must not have mocap bodies: use [[movers]]")
    if world.geom("floor") is None:
        raise ValueError("the arena has no geom named 'floor'")
    for geom in world.geoms:
        solid = geom.contype or geom.conaffinity
        if geom.name not in geoms and solid and geom.group not in SEEN_GROUPS:
            name = geom.name or "without a name"
            raise ValueError(
                f"geom {name} is in group {geom.group}, which the LiDAR does not see: use 0"
            )


def _check_loose(joint: mujoco.MjsJoint) -> None:
    """Raise ValueError for joints other than the free joints of bodies that are named as loose."""
    body = joint.parent
    names = [body.name, *(geom.name for geom in body.geoms)]
    free = joint.type == mujoco.mjtJoint.mjJNT_FREE
    if not free or not all(name.startswith(("loose_", "obstacle_")) for name in names):
        raise ValueError(
            f"an arena must be static, but this one has a joint ({joint.name or 'no name'}): "
            "only bodies on free joints may move; name them and their geoms loose_* or obstacle_*"
        )


def _set_options(world: mujoco.MjSpec, timestep_s: float) -> None:
    """Set the solver options for few, frictionless contacts and eight degrees of freedom."""
    option = world.option
    option.timestep = timestep_s
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    _reserve_memory(world)


def _reserve_memory(world: mujoco.MjSpec) -> None:
    """Give MuJoCo room for many bodies; its own rule counts too few, and a step would fail.

    Measured: the search for contacts takes 4 bytes for each pair of bodies. A loose body has some
    16 rows of constraints on 6 columns of its own, and MuJoCo keeps dense matrices of all of them.
    """
    bodies = len(world.bodies)
    loose = sum(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in world.joints)
    if bodies > _MANY_BODIES or loose > _MANY_LOOSE:
        world.memory = max(world.memory, 2**24 + 8 * bodies**2 + 4096 * loose**2)
