"""Arenas, true floor plans, and clutter that is drawn from a seed."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from simloop.worlds.arena import arena_names, arena_path, bounds_of, build
from simloop.worlds.body import Body
from simloop.worlds.cross_section import floor_plan, section_of
from simloop.worlds.floor_plan import BAND_M, Section, is_blocked, is_passable, rasterise
from simloop.worlds.generators.clutter import draw_clutter, hide_from_lidar
from simloop.worlds.obstacles import Obstacle
from simloop.worlds.solids import solid_of_model

START, GOAL = np.zeros(2), np.array([3.6, 3.9])
BODY = Body(0.49, 0.465, 0.2)
ROOM = (-0.65, -0.55, 4.35, 4.45)
LOOK = arena_path("open").parent / "assets" / "look.xml"


def test_the_arenas_are_there() -> None:
    assert arena_names() == ["clutter", "corridor", "experiment", "field", "open", "trap"]


def test_an_unknown_arena_is_refused_with_the_names() -> None:
    with pytest.raises(ValueError, match=r"experimant.*experiment, field, open, trap"):
        build("experimant")


def test_a_broken_arena_file_is_refused_in_one_line(tmp_path: Path) -> None:
    file = tmp_path / "bad.xml"
    file.write_text("<mujoco><worldbody><geom type='sphare'/></worldbody></mujoco>")
    with pytest.raises(ValueError, match=r"bad\.xml") as error:
        build(file)
    assert "\n" not in str(error.value)


def test_the_experiment_has_twelve_obstacles_in_the_way_and_a_way_through() -> None:
    plan = floor_plan(build("experiment"))
    names = {s.name.split("_")[1] for s in plan.sections if s.name.startswith("obstacle_")}
    assert len(names) == 12
    assert plan.bounds_m[2] - plan.bounds_m[0] == pytest.approx(5.0)
    assert plan.bounds_m[3] - plan.bounds_m[1] == pytest.approx(5.0)
    assert is_blocked(plan, START, GOAL)
    assert is_passable(plan, START, GOAL, 0.32)
    assert plan.clearance_m(np.array([START, GOAL])).min() > 0.45


def test_the_l_is_of_one_piece() -> None:
    sections = {s.name: s for s in floor_plan(build("experiment")).sections}
    long = rasterise([sections["obstacle_04_ell_long"]], ROOM, 1.0)
    assert long.clearance_m(sections["obstacle_04_ell_short"].vertices_m).min() < 0.0


@pytest.mark.parametrize(
    ("name", "goal"), [("corridor", (5.4, 4.1)), ("trap", (4.6, 0.0)), ("open", (3.6, 3.9))]
)
def test_the_other_arenas_can_be_passed(name: str, goal: tuple[float, float]) -> None:
    plan = floor_plan(build(name))
    assert is_passable(plan, START, np.array(goal), 0.32)
    assert is_blocked(plan, START, np.array(goal)) == (name != "open")


def test_walls_are_where_the_bounds_say() -> None:
    plan = floor_plan(build("clutter"))
    x_min, y_min, x_max, y_max = plan.bounds_m
    middle = np.array([[x_min, 2.0], [x_max, 2.0], [2.0, y_min], [2.0, y_max]])
    assert plan.clearance_m(middle) == pytest.approx(0.0, abs=1e-9)


def plain_distance(point: np.ndarray, section: Section) -> float:
    """The slow and obvious signed distance to one section."""
    outline = section.vertices_m
    nearest, inside = math.inf, len(outline) > 2
    for a, b in zip(np.roll(outline, 1, axis=0), outline, strict=True):
        edge, to = b - a, point - a
        share = 0.0 if not edge.any() else min(1.0, max(0.0, float(to @ edge / (edge @ edge))))
        nearest = min(nearest, math.dist(to, share * edge))
        inside = inside and edge[0] * to[1] - edge[1] * to[0] >= 0.0
    return (-nearest if inside else nearest) - section.radius_m


def test_distances_agree_with_the_plain_ones() -> None:
    plan = floor_plan(build("experiment"))
    points = np.random.default_rng(3).uniform(ROOM[:2], ROOM[2:], (60, 2))
    plain = [min(plain_distance(p, s) for s in plan.sections) for p in points]
    assert plan.clearance_m(points) == pytest.approx(plain, abs=1e-12)


def test_the_raster_holds_the_distances_of_its_cells() -> None:
    plan = floor_plan(build("trap"), resolution_m=0.05)
    row, column = 30, 77
    centre = plan.origin_m + (np.array([column, row]) + 0.5) * plan.resolution_m
    assert plan.distance_m[row, column] == pytest.approx(
        plan.clearance_m(centre[None])[0], abs=1e-6
    )
    assert plan.distance_m.shape == (92, 124)
    assert plan.distance_m.dtype == np.float32


def test_an_empty_plan_is_clear_everywhere() -> None:
    plan = rasterise([], (0.0, 0.0, 1.0, 1.0), 0.1)
    assert np.all(np.isinf(plan.distance_m))
    with pytest.raises(ValueError, match="positive area"):
        rasterise([], (0.0, 0.0, 0.0, 1.0))


SHAPES = {
    "box": ("0.3 0.1 0.2", mujoco.mjtGeom.mjGEOM_BOX),
    "cylinder": ("0.1 0.3", mujoco.mjtGeom.mjGEOM_CYLINDER),
    "capsule": ("0.1 0.2", mujoco.mjtGeom.mjGEOM_CAPSULE),
    "ellipsoid": ("0.3 0.1 0.2", mujoco.mjtGeom.mjGEOM_ELLIPSOID),
    "sphere": ("0.2", mujoco.mjtGeom.mjGEOM_SPHERE),
}


@settings(max_examples=60)
@given(
    kind=st.sampled_from(sorted(SHAPES)),
    turn=st.sampled_from([(0, 0), (90, 0), (0, 90), (180, 0), (25, 0), (30, 50), (0, 70)]),
    yaw=st.floats(-180.0, 180.0),
    height=st.floats(-0.05, 0.5),
)
@example(kind="ellipsoid", turn=(0, 0), yaw=30.0, height=0.4)
@example(kind="ellipsoid", turn=(180, 0), yaw=30.0, height=-0.1)
@example(kind="capsule", turn=(90, 0), yaw=30.0, height=0.3)
@example(kind="sphere", turn=(0, 0), yaw=0.0, height=0.4)
def test_a_section_is_what_the_solid_shows_between_two_heights(
    kind: str, turn: tuple[float, float], yaw: float, height: float
) -> None:
    size, _ = SHAPES[kind]
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><compiler eulerseq="ZYX"/><worldbody>
        <geom name="it" type="{kind}" size="{size}" pos="0.3 -0.2 {height}"
         euler="{yaw} {turn[0]} {turn[1]}"/></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    draw = np.random.default_rng(7).uniform(-0.35, 0.35, (40_000, 3)) + data.geom_xpos[0]
    draw[:, 2] = np.random.default_rng(8).uniform(*BAND_M, len(draw))
    seen = draw[in_solid(model, data, draw)][:, :2]
    section = section_of(solid_of_model(model, data, 0), BAND_M)
    if section is None:
        assert len(seen) < 20  # at most a sliver, or it merely touches the band
        return
    plan = rasterise([section], (-1.0, -1.0, 1.0, 1.0), 1.0)
    if len(seen):
        assert plan.clearance_m(seen).max() < 1e-3  # nothing sticks out
    # Nor is the outline too large: at every point 2 mm inside it, the solid is there at some
    # height. That is enough, because outline and solid are convex.
    rim = rim_of(section)
    centre = rim.mean(axis=0)
    away = np.hypot(*(rim - centre).T)[:, None]
    if away.min() < 0.01:
        return
    within = rim - 0.002 * (rim - centre) / away
    heights = np.linspace(*BAND_M, 2000)
    for point in within:
        column = np.column_stack([np.tile(point, (len(heights), 1)), heights])
        assert np.any(in_solid(model, data, column)), point


def rim_of(section: Section) -> np.ndarray:
    """(N, 2) points on the outline that span all of it."""
    if section.radius_m == 0.0:
        return section.vertices_m
    angle = 2.0 * math.pi * np.arange(24) / 24
    ring = section.radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rim = (section.vertices_m[:, None] + ring).reshape(-1, 2)
    distance = rasterise([section], (-1.0, -1.0, 1.0, 1.0), 1.0).clearance_m(rim)
    return rim[distance > -1e-9]  # not those that another vertex's disc has swallowed


def in_solid(model: mujoco.MjModel, data: mujoco.MjData, points: np.ndarray) -> np.ndarray:
    """Whether points (N, 3) of the world lie within geom 0, by its inequality alone."""
    kind, size = int(model.geom_type[0]), model.geom_size[0]
    p = (points - data.geom_xpos[0]) @ data.geom_xmat[0].reshape(3, 3)
    radial = np.hypot(p[:, 0], p[:, 1])
    if kind == SHAPES["box"][1]:
        return np.all(np.abs(p) <= size, axis=1)
    if kind == SHAPES["cylinder"][1]:
        return (radial <= size[0]) & (np.abs(p[:, 2]) <= size[1])
    if kind == SHAPES["capsule"][1]:
        return np.hypot(radial, np.maximum(np.abs(p[:, 2]) - size[1], 0.0)) <= size[0]
    if kind == SHAPES["ellipsoid"][1]:
        return np.sum((p / size) ** 2, axis=1) <= 1.0
    return np.sum(p**2, axis=1) <= size[0] ** 2


@pytest.mark.parametrize(
    "obstacle",
    [
        Obstacle("box", (1.0, 1.5), (0.5, 0.2), 0.7),
        Obstacle("cylinder", (1.0, 1.5), (0.4,)),
        Obstacle("ellipse", (1.0, 1.5), (0.6, 0.3), -0.4),
        Obstacle("ell", (1.0, 1.5), (0.6, 0.5, 0.1), 2.0),
        Obstacle("polygon", (1.0, 1.5), (), 0.3, 0.3, ((-0.2, -0.1), (0.3, -0.1), (0.1, 0.25))),
        Obstacle(  # clockwise
            "polygon", (1.0, 1.5), (), 0.3, 0.3, ((0.1, 0.25), (0.3, -0.1), (-0.2, -0.1))
        ),
    ],
    ids=lambda o: o.shape,
)
def test_what_is_built_is_what_was_asked_for(obstacle: Obstacle) -> None:
    built = floor_plan(build("open", [obstacle]))
    asked = rasterise(obstacle.sections(), ROOM, 1.0)
    points = np.random.default_rng(5).uniform((0.3, 0.8), (1.7, 2.2), (400, 2))
    outside = points[asked.clearance_m(points) > 0.0]
    assert built.clearance_m(outside) == pytest.approx(asked.clearance_m(outside), abs=1.5e-3)
    assert np.any(asked.clearance_m(points) < 0.0)
    assert np.all(built.clearance_m(points[asked.clearance_m(points) < -2e-3]) < 0.0)


@pytest.mark.parametrize(
    ("shape", "size", "vertices", "says"),
    [
        ("box", (0.2,), (), "length, width"),
        ("cylinder", (0.2, 0.1), (), "diameter"),
        ("ell", (0.2, 0.2, 0.3), (), "thickness"),
        ("polygon", (), ((0.0, 0.0), (1.0, 0.0)), "convex"),
        ("polygon", (), ((0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)), "convex"),
        ("box", (0.2, 0.1), ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), "vertices_m"),
        ("box", (0.2, -0.1), (), "greater than 0"),
        ("sphere", (0.2,), (), "box"),
    ],
)
def test_impossible_obstacles_are_refused(
    shape: str, size: tuple[float, ...], vertices: tuple, says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        Obstacle(shape, (0.0, 0.0), size, vertices_m=vertices)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(12))
def test_a_drawn_room_is_blocked_passable_and_leaves_room_to_turn(seed: int) -> None:
    room = draw_clutter(np.random.default_rng(seed), START, GOAL, ROOM, BODY)
    plan = floor_plan(build("clutter", room))
    assert len(room) == 12
    assert is_blocked(plan, START, GOAL)
    assert is_passable(plan, START, GOAL, 0.29)
    drawn = rasterise([s for item in room for s in item.sections()], ROOM, 1.0)
    assert drawn.clearance_m(np.array([START, GOAL])).min() >= 0.44
    assert len({item.shape for item in room}) >= 3
    for section in drawn.sections:
        low, high = section.vertices_m.min(0), section.vertices_m.max(0)
        assert np.all(low - section.radius_m > ROOM[:2])
        assert np.all(high + section.radius_m < ROOM[2:])


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('pos="2 2 0"', 'pos="2 2 -0.5"', "no floor: .*floor: its upper face is at z = -0.5 m"),
        ('name="floor"', 'name="floor" euler="0 0.1 0"', "no floor: .*floor: it is not level"),
        ("</worldbody>", '<body><freejoint/><geom size="1"/></body></worldbody>', "has a joint"),
        ("</worldbody>", '<geom name="x" size="1" group="3"/></worldbody>', "x is in group 3"),
    ],
)
def test_an_arena_that_would_not_be_what_it_seems_is_refused(tmp_path, old, new, says) -> None:
    text = arena_path("open").read_text().replace("assets/look.xml", str(LOOK))
    assert old in text
    (tmp_path / "odd.xml").write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=f"odd.xml: .*{says}"):
        build(str(tmp_path / "odd.xml"))


def test_a_seed_is_a_room() -> None:
    first = draw_clutter(np.random.default_rng(4), START, GOAL, ROOM, BODY)
    again = draw_clutter(np.random.default_rng(4), START, GOAL, ROOM, BODY)
    other = draw_clutter(np.random.default_rng(5), START, GOAL, ROOM, BODY)
    assert first == again
    assert first != other


def test_a_room_that_cannot_be_drawn_is_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="inside the walls"):
        draw_clutter(rng, START, (4.3, 3.9), ROOM, BODY)
    with pytest.raises(ValueError, match="so near that no obstacle"):
        # Nothing can stand between two ends so close that both need the room to turn.
        draw_clutter(rng, START, (0.8, 0.0), ROOM, BODY, count=1)
    with pytest.raises(ValueError, match="no place for 60 obstacles: ask for fewer"):
        draw_clutter(rng, START, GOAL, ROOM, BODY, count=60)


def test_what_is_drawn_keeps_clear_of_what_stands() -> None:
    there = Section("pillar", np.array([[1.5, 1.5], [2.5, 1.5], [2.5, 2.5], [1.5, 2.5]]))
    room = draw_clutter(np.random.default_rng(3), START, GOAL, ROOM, BODY, 8, standing=[there])
    alone = rasterise([there], ROOM, 1.0)
    for item in room:
        for section in item.sections():
            assert alone.clearance_m(section.vertices_m).min() - section.radius_m > 0.0
    plan = rasterise([there, *(s for item in room for s in item.sections())], ROOM, 0.025)
    assert is_passable(plan, START, GOAL, 0.29)


@pytest.mark.parametrize("lidar_m", [0.15, 0.2, 0.4])
def test_hidden_obstacles_miss_the_lidars_plane_wherever_it_is(lidar_m):
    room = draw_clutter(np.random.default_rng(2), START, GOAL, ROOM, BODY)
    hidden = hide_from_lidar(np.random.default_rng(0), room * 20, 1.0, lidar_m)
    tops = np.array([item.bottom_m + item.height_m for item in hidden])
    bottoms = np.array([item.bottom_m for item in hidden])
    below, above = tops < lidar_m, bottoms > lidar_m
    assert np.all(below | above)
    kinds = [below & (bottoms == 0.0), below & (bottoms > 0.0), above]
    assert all(0.2 < kind.mean() < 0.5 for kind in kinds)
    assert hide_from_lidar(np.random.default_rng(0), room, 0.0, lidar_m) == room
    assert hide_from_lidar(np.random.default_rng(0), room, 0.5, lidar_m) != room


def test_a_passage_is_as_wide_as_it_is() -> None:
    gate = [
        Section("left", np.array([[-1.0, 0.3], [1.0, 0.3], [1.0, 3.0], [-1.0, 3.0]])),
        Section("right", np.array([[-1.0, -3.0], [1.0, -3.0], [1.0, -0.3], [-1.0, -0.3]])),
    ]
    plan = rasterise(gate, (-3.0, -3.0, 3.0, 3.0), 0.02)
    ends = np.array([[-2.0, 0.0], [2.0, 0.0]])
    assert is_passable(plan, *ends, 0.27)
    assert not is_passable(plan, *ends, 0.31)
    assert not is_blocked(plan, *ends)


def test_bounds_are_given_or_those_of_the_floor(tmp_path: Path) -> None:
    file = tmp_path / "bare.xml"
    bare = "<mujoco><worldbody><geom name='floor' type='plane' size='3 2 1' pos='1 0 0'/>"
    file.write_text(f"{bare}</worldbody></mujoco>")
    assert bounds_of(build(file)) == pytest.approx([-2.0, -2.0, 4.0, 2.0])
    file.write_text(f"{bare.replace('3 2 1', '0 0 1')}</worldbody></mujoco>")
    with pytest.raises(ValueError, match=r"no numeric 'bounds'.*its floor has no end"):
        build(file)
