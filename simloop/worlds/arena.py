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
from scipy.spatial import ConvexHull, QhullError

from simloop.common.data_files import models_dir
from simloop.config import PayloadConfig
from simloop.messages import FloatArray
from simloop.physics.vehicle_geoms import SEEN_GROUPS
from simloop.worlds.floor_plan import BAND_M, FloorPlan, Section, rasterise
from simloop.worlds.generators.clutter import draw_clutter
from simloop.worlds.mjcf_ground import add_loose, add_movers, add_terrain
from simloop.worlds.movers.settings import Mover
from simloop.worlds.obstacles import Obstacle, ellipse_outline
from simloop.worlds.terrain import Loose, Terrain

__all__ = [
    "FloorPlan",
    "Obstacle",
    "Section",
    "arena_names",
    "arena_path",
    "bounds_of",
    "build",
    "draw_clutter",
    "floor_plan",
]

_MATERIALS = ("oak", "teal", "brick", "mustard", "slate", "sage", "plum")
_OVERLAP_M = 0.001
_RIM_M = 0.2  # of floor beyond the bounds, for walls to stand on
_UPRIGHT = 1.0 - 1e-9
_ROUND = 64
"""Points round a tilted round thing: its outline is then right to about 0.1 % of its radius."""


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


def floor_plan(
    model: mujoco.MjModel,
    resolution_m: float = 0.02,
    band_m: tuple[float, float] = BAND_M,
) -> FloorPlan:
    """What truly stands in the arena between two heights: all static geoms but planes and floor.

    Shapes are exact where they can be (see ``section_of_geom``); resolution_m is that
    of the raster. What is named ``ground_*`` is driven over, and is left out. Raises ValueError
    for any other height field, which is not supported.
    """
    return rasterise(sections_of(model, band_m), bounds_of(model), resolution_m)


def sections_of(
    model: mujoco.MjModel, band_m: tuple[float, float] = BAND_M, *, loose: bool = False
) -> list[Section]:
    """The outlines of what stands between two heights; loose: of loose things too, as placed."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    root = model.body_rootid[model.geom_bodyid]
    stands = solid & (model.body_weldid[model.geom_bodyid] == 0)
    if loose:
        stands |= solid & (root != 0) & (root != model.body("base_link").id)
    sections = []
    for geom in np.flatnonzero(stands):
        name = model.geom(geom).name
        is_ground = name == "floor" or name.startswith("ground_")
        if not is_ground and model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE:
            section = section_of_geom(model, data, int(geom), name, band_m)
            sections += [section] if section is not None else []
    return sections


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


def section_of_geom(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    geom: int,
    name: str,
    band_m: tuple[float, float],
) -> Section | None:
    """The outline of one geom within the band of heights, or None if it does not reach it.

    Exact for boxes, meshes (their convex hull) and spheres in any pose, for upright cylinders,
    and for capsules that stand or lie; upright ellipsoids are right to 0.1 mm, all else to about
    0.1 % of its radius. data: after ``mj_kinematics``. Raises ValueError for other types.
    """
    position = data.geom_xpos[geom]
    rotation = data.geom_xmat[geom].reshape(3, 3)
    size = model.geom_size[geom]
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    axis = rotation[:, 2]
    upright = abs(axis[2]) > _UPRIGHT
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return _swept_ball(name, position, np.zeros(3), size[0], band_m)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE and (upright or abs(axis[2]) < 1e-9):
        return _swept_ball(name, position, axis * size[1], size[0], band_m)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER and upright:
        if _gap(position[2], size[1], band_m) > 0.0:
            return None
        return Section(name, position[None, :2].copy(), float(size[0]))
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID and upright:
        rise = (np.clip(position[2], *band_m) - position[2]) / size[2]
        if abs(rise) >= 1.0:
            return None
        outline = ellipse_outline(size[0], size[1]) * math.sqrt(1.0 - rise**2)
        turned = outline @ rotation[:2, :2].T
        # Upside down, the turn is also a reflection: the outline's sense comes out reversed.
        return Section(name, (turned if axis[2] > 0.0 else turned[::-1]) + position[:2])
    points = _hull_points(model, geom, kind, size) @ rotation.T + position
    cut = _hull_in_band(points, band_m)
    return None if cut is None else Section(name, cut)


def _gap(height: float, half: float, band_m: tuple[float, float]) -> float:
    return float(max(band_m[0] - (height + half), (height - half) - band_m[1]))


def _swept_ball(
    name: str, centre: FloatArray, half: FloatArray, radius: float, band_m: tuple[float, float]
) -> Section | None:
    """A ball swept along centre +- half, which stands or lies: where it comes nearest the band."""
    gap = max(0.0, _gap(centre[2], abs(half[2]), band_m))
    if gap >= radius:
        return None
    ends = np.array([centre[:2] - half[:2], centre[:2] + half[:2]])
    lies = bool(np.any(ends[0] != ends[1]))
    return Section(name, ends if lies else ends[:1], math.sqrt(radius**2 - gap**2))


def _hull_points(
    model: mujoco.MjModel, geom: int, kind: mujoco.mjtGeom, size: FloatArray
) -> FloatArray:
    """(N, 3) points in the geom's frame whose convex hull is the geom."""
    corners = np.stack(np.meshgrid(*3 * [[-1.0, 1.0]]), axis=-1).reshape(-1, 3)
    around = 2.0 * math.pi * np.arange(_ROUND) / _ROUND
    ring = np.stack([np.cos(around), np.sin(around), np.zeros(_ROUND)], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return corners * size
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        return np.array(model.mesh_vert[start : start + count], dtype=np.float64)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return np.concatenate([size[0] * ring + side * size[1] * up for side in (-1.0, 1.0)])
    if kind in (mujoco.mjtGeom.mjGEOM_ELLIPSOID, mujoco.mjtGeom.mjGEOM_CAPSULE):
        elevation = np.linspace(-0.5 * math.pi, 0.5 * math.pi, _ROUND // 2 + 1)
        ball = ring * np.cos(elevation)[:, None, None] + up * np.sin(elevation)[:, None, None]
        ball = ball.reshape(-1, 3)
        if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return ball * size
        return np.concatenate([size[0] * ball + side * size[1] * up for side in (-1.0, 1.0)])
    raise ValueError(f"no floor plan for a geom of type {kind.name}: {model.geom(geom).name!r}")


def _hull_in_band(points: FloatArray, band_m: tuple[float, float]) -> FloatArray | None:
    """(V, 2) counter-clockwise: the convex hull of points (N, 3), cut to the band, seen from above.

    The cut is spanned by the vertices within the band and by where edges cross its two planes.
    """
    hull = ConvexHull(points)
    pairs = np.concatenate(
        [hull.simplices[:, [0, 1]], hull.simplices[:, [1, 2]], hull.simplices[:, [2, 0]]]
    )
    start, end = points[pairs[:, 0]], points[pairs[:, 1]]
    kept = [points[(points[:, 2] >= band_m[0]) & (points[:, 2] <= band_m[1])]]
    for level in band_m:
        crossing = (start[:, 2] < level) != (end[:, 2] < level)
        a, b = start[crossing], end[crossing]
        share = (level - a[:, 2]) / (b[:, 2] - a[:, 2])
        kept.append(a + share[:, None] * (b - a))
    flat = np.concatenate(kept)[:, :2]
    try:
        return flat[ConvexHull(flat).vertices].copy()
    except (QhullError, ValueError):
        return None  # it does not reach the band, or only touches it
