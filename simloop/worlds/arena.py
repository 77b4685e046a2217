"""Arenas: MJCF worlds, the vehicle in them, and what is truly there.

An arena file is a world alone. Its floor is named ``floor``, its walls ``wall_*``, what stands in
it ``obstacle_*``, all in geom group 0, which is what the LiDAR sees; the vehicle's visuals are in
group 2 and its collision geoms in group 3. The numeric ``bounds`` gives the free space.
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
from simloop.worlds.mjcf_ground import add_loose, add_movers, add_terrain
from simloop.worlds.movers.settings import Mover
from simloop.worlds.obstacles import Obstacle
from simloop.worlds.terrain import Loose, Terrain

_MATERIALS = ("oak", "teal", "brick", "mustard", "slate", "sage", "plum")
_OVERLAP_M = 0.001
_RIM_M = 0.2  # of floor beyond the bounds, for walls to stand on


def arena_names() -> list[str]:
    """The arenas that come with the package, in alphabetical order."""
    return sorted(path.stem for path in (models_dir() / "arenas").glob("*.xml"))


def arena_path(arena: str | Path) -> Path:
    """The MJCF file of an arena, given by name or as a path ending in ``.xml``.

    Raises ValueError, which lists the names, for an unknown one.
    """
    if str(arena).endswith(".xml"):
        path = Path(arena)
        if not path.is_file():
            raise ValueError(f"no arena file {path}")
        return path
    if str(arena) not in arena_names():
        raise ValueError(f"no arena {str(arena)!r}; there are {', '.join(arena_names())}")
    return models_dir() / "arenas" / f"{arena}.xml"


def build(
    arena: str | Path,
    obstacles: Sequence[Obstacle] = (),
    timestep_s: float = 0.002,
    payload: PayloadConfig | None = None,
    terrain: Terrain | None = None,
    loose: Sequence[Loose] = (),
    friction: float = 0.6,
    bounds: Sequence[float] | None = None,
    movers: Sequence[Mover] = (),
) -> mujoco.MjModel:
    """The arena with the vehicle at its origin, further obstacles and ground, compiled.

    friction: of the tracks, which decides what terrain can be climbed (see ``ground``). bounds:
    (4,) x_min, y_min, x_max, y_max that the arena's floor gets instead of its own.

    The vehicle's names stay as they are in its own file. Raises ValueError for an unknown arena
    or a file that MuJoCo does not take.
    """
    path = arena_path(arena)
    try:
        world = _with_vehicle(path)
        _check_arena(world)
        if bounds is not None:
            _resize(world, np.array(bounds, np.float64))
        for number, obstacle in enumerate(obstacles, start=1):
            _add_obstacle(world, f"obstacle_drawn_{number:02d}", obstacle, number)
        if terrain is not None:
            add_terrain(world, terrain, friction)
        add_loose(world, loose)
        add_movers(world, movers)
        if payload is not None:
            add_payload(world, payload)
        _set_options(world, timestep_s)
        return world.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ValueError(f"{path.name}: {' '.join(str(error).split())}") from error


def bounds_of(model: mujoco.MjModel) -> FloatArray:
    """(4,) x_min, y_min, x_max, y_max of the arena's free space. Raises ValueError if not given."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, "bounds")
    if index < 0 or model.numeric_size[index] != 4:
        raise ValueError("the arena has no numeric 'bounds' of four figures")
    start = model.numeric_adr[index]
    return np.array(model.numeric_data[start : start + 4], dtype=np.float64)


def overlaps(model: mujoco.MjModel, start: Sequence[float] | FloatArray) -> list[tuple[str, str]]:
    """Pairs of geoms, one of them loose, that begin inside one another or in the robot's place."""
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
    """Both files in one world, as includes: MuJoCo warns of attaching without a prefix."""
    models = models_dir()
    files = (path.resolve(), models / "tracked_ugv.xml")
    includes = "".join(f"<include file={quoteattr(str(file))}/>" for file in files)
    assets = sorted((models / "assets").glob("*.obj"))
    meshes = {f"assets/{file.name}": file.read_bytes() for file in assets}
    world = mujoco.MjSpec.from_string(f"<mujoco>{includes}</mujoco>", assets=meshes)
    world.modelname, world.modelfiledir = path.stem, str(path.resolve().parent)
    # The plane and the light by which the vehicle's own file can be opened alone.
    world.delete(world.geom("ground"))
    world.delete(world.light("ground_light"))
    # It lists the joints of the vehicle alone.
    world.delete(world.key("home"))
    return world


def _resize(world: mujoco.MjSpec, bounds: FloatArray) -> None:
    """Give the floor other bounds (4,), and the camera a place from which all of it is seen."""
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
    """A small, dense body fixed to the chassis; it is not seen, and touches nothing."""
    if payload.mass_kg > 0.0:
        load = world.body("base_link").add_body(name="payload", pos=list(payload.position_m))
        load.mass, load.inertia = payload.mass_kg, [1e-3 * payload.mass_kg] * 3
        load.explicitinertial = True


def _check_arena(world: mujoco.MjSpec) -> None:
    """Raise ValueError for what would not be true to the robot or to the floor plan."""
    vehicle = world.body("base_link")
    joints = {joint.name for joint in vehicle.find_all("joint")}
    geoms = {geom.name for geom in vehicle.find_all("geom")}
    for joint in world.joints:
        if joint.name not in joints:
            _check_loose(joint)
    if any(body.mocap for body in world.bodies):
        raise ValueError("what moves is said by the scenario's [[movers]], not by the arena")
    if world.geom("floor") is None:
        raise ValueError("the arena has no geom named 'floor'")
    for geom in world.geoms:
        solid = geom.contype or geom.conaffinity
        if geom.name not in geoms and solid and geom.group not in SEEN_GROUPS:
            name = geom.name or "without a name"
            raise ValueError(f"geom {name} is in group {geom.group}, which no LiDAR sees: use 0")


def _check_loose(joint: mujoco.MjsJoint) -> None:
    """An arena stands still, but for whole bodies that are loose, and named so."""
    body = joint.parent
    names = [body.name, *(geom.name for geom in body.geoms)]
    free = joint.type == mujoco.mjtJoint.mjJNT_FREE
    if not free or not all(name.startswith(("loose_", "obstacle_")) for name in names):
        raise ValueError(
            f"an arena stands still, but this one has a joint ({joint.name or 'no name'}): "
            "only bodies on free joints may move, they and their geoms named loose_* or obstacle_*"
        )


def _set_options(world: mujoco.MjSpec, timestep_s: float) -> None:
    """Few, frictionless contacts and eight degrees of freedom: small, dense, two iterations."""
    option = world.option
    option.timestep = timestep_s
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE


def _add_obstacle(world: mujoco.MjSpec, name: str, obstacle: Obstacle, number: int) -> None:
    parts = obstacle.parts()
    for letter, part in zip("ab", parts, strict=False):
        geom = world.worldbody.add_geom(
            name=name if len(parts) == 1 else f"{name}_{letter}",
            contype=1,
            conaffinity=0,
            material=_MATERIALS[number % len(_MATERIALS)],
        )
        _shape(world, geom, part)


def _shape(world: mujoco.MjSpec, geom: mujoco.MjsGeom, part: Obstacle) -> None:
    x, y = part.position_m
    half_height = 0.5 * part.height_m
    geom.pos = [x, y, part.bottom_m + half_height]
    geom.quat = [np.cos(0.5 * part.yaw_rad), 0.0, 0.0, np.sin(0.5 * part.yaw_rad)]
    if part.shape == "cylinder":
        geom.type = mujoco.mjtGeom.mjGEOM_CYLINDER
        geom.size = [0.5 * part.size_m[0], half_height, 0.0]
    elif part.shape == "box":
        geom.type = mujoco.mjtGeom.mjGEOM_BOX
        geom.size = [0.5 * part.size_m[0], 0.5 * part.size_m[1], half_height]
    else:
        # An ellipse is a prism too: an ellipsoid would overhang, and show the LiDAR less than
        # what the hull meets.
        section = Obstacle(
            part.shape, (0.0, 0.0), part.size_m, 0.0, part.height_m, part.vertices_m
        ).sections()[0]
        outline = section.vertices_m[:: 2 if part.shape == "ellipse" else 1]
        vertices = [
            np.column_stack([outline, np.full(len(outline), z)])
            for z in (-half_height, half_height)
        ]
        mesh = world.add_mesh(name=geom.name, uservert=np.concatenate(vertices).ravel().tolist())
        geom.type = mujoco.mjtGeom.mjGEOM_MESH
        geom.meshname = mesh.name
