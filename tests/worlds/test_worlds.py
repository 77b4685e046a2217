"""Worlds that are drawn from a seed, or read from map_server and Gazebo files."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.scenario.build import build_world
from simloop.scenario.load import load
from simloop.worlds.body import Body
from simloop.worlds.floor_plan import is_passable, rasterise
from simloop.worlds.gazebo_world import read_sdf
from simloop.worlds.generators import buildings, fields, mazes
from simloop.worlds.generators import generator as generator_module
from simloop.worlds.generators.generator import Generator, draw_world
from simloop.worlds.layout import walls_about
from simloop.worlds.map_server_world import read_map_world, tile_rectangles

BODY = Body(0.49, 0.465, 0.2)
KINDS = ("barn", "forest", "rooms", "maze", "gaps", "utrap")


@pytest.mark.parametrize("kind", KINDS)
def test_a_world_is_its_seeds_and_can_be_crossed(kind):
    scenario = load(kind, seed=5)
    floor = build_world(scenario).floor
    again, other = build_world(scenario).floor, build_world(load(kind, seed=6)).floor
    assert np.array_equal(floor.distance_m, again.distance_m)
    assert not np.array_equal(floor.distance_m, other.distance_m)
    start, goal = np.array(scenario.start[:2]), np.array(scenario.goal)
    assert is_passable(floor, start, goal, 0.5 * BODY.width_m)
    assert floor.bounds_m.tolist() == [0.0, 0.0, *scenario.generator.size_m]


@pytest.mark.parametrize("kind", KINDS)
def test_an_end_that_no_world_can_have_is_refused_before_any_is_drawn(monkeypatch, kind):
    monkeypatch.setitem(generator_module._DRAW, kind, None)  # calling it would fail
    big = Generator(kind, (100.0, 100.0))
    for start, goal, told in (
        ((-1.0, 3.0), (9.0, 9.0), r"start \(-1, 3\) is outside the floor"),
        ((3.0, 3.0), (9.0, math.nan), "goal .* is outside the floor"),
        ((3.0, 3.0), (99.9, 9.0), r"goal .* is 0.10 m from a wall; the robot needs 0.3"),
    ):
        with pytest.raises(ValueError, match=told):
            draw_world(big, np.random.default_rng(0), start, goal, BODY)


def test_a_world_of_too_many_obstacles_is_refused():
    for generator in (
        Generator("forest", (100.0, 100.0), width_m=0.05, density=1.0),
        Generator("barn", (100.0, 100.0)),
    ):
        with pytest.raises(InputError, match="at most 20,000 are allowed"):
            draw_world(generator, np.random.default_rng(0), (3.0, 3.0), (9.0, 9.0), BODY)


def test_a_forest_is_the_one_that_a_search_through_all_trunks_gives():
    def plain(rng, bounds, apart_m, density):
        low, high = np.array(bounds[:2]), np.array(bounds[2:])
        darts = int(density * 30 * np.prod(high - low) / (apart_m + 0.25) ** 2)
        trunks = np.empty((0, 3))
        for _ in range(darts):
            place, radius = rng.uniform(low, high), 0.5 * rng.uniform(0.1, 0.4)
            off = np.hypot(*(trunks[:, :2] - place).T) - trunks[:, 2] - radius
            if np.all(off >= apart_m):
                trunks = np.vstack([trunks, [*place, radius]])
        return trunks

    for apart_m in (0.2, 0.8):
        given_ = ((0.0, -3.0, 9.0, 7.0), apart_m, 0.3)
        drawn = fields.forest(np.random.default_rng(7), *given_)
        trunks = [(*one.position_m, 0.5 * one.size_m[0]) for one in drawn]
        np.testing.assert_array_equal(trunks, plain(np.random.default_rng(7), *given_))


@given(st.integers(0, 2**32), st.floats(0.0, 1.0))
@settings(max_examples=60)
def test_the_rectangles_are_those_of_the_plain_greedy_search(seed, share):
    rng = np.random.default_rng(seed)
    filled = rng.random(tuple(rng.integers(1, 14, 2))) < share
    left, expected = filled.copy(), []
    for row, column in np.argwhere(filled).tolist():
        if left[row, column]:
            wide = column + int(np.argmin([*left[row, column:], False]))
            high = row + int(np.argmin([*left[row:, column:wide].all(axis=1), False]))
            left[row:high, column:wide] = False
            expected.append((row, column, high, wide))
    assert tile_rectangles(filled) == expected
    assert tile_rectangles(filled, 3) == expected[:3]


def test_a_map_of_thousands_of_boxes_is_built(tmp_path):
    rng = np.random.default_rng(5)
    picture = np.full((600, 600), 254, np.uint8)
    for row, column in rng.integers(40, 590, (3500, 2)):
        picture[row : row + 2, column : column + 3] = 0
    picture[460:560, 60:160] = picture[60:160, 460:560] = 254
    (tmp_path / "m.pgm").write_bytes(b"P5 600 600 255\n" + picture.tobytes())
    (tmp_path / "m.yaml").write_text("image: m.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")
    (tmp_path / "s.toml").write_text(
        'arena = "m.yaml"\nstart = [5, 5, 0]\ngoal = [25, 25]\nmay_be_closed_off = true\n'
    )
    floor = build_world(load(tmp_path / "s.toml")).floor
    assert len(floor.sections) > 2000
    j, i = np.nonzero(picture[::-1] == 0)
    inside = floor.clearance_m(0.05 * (np.column_stack([i, j]) + 0.5))
    assert inside.max() < -0.02


def test_a_saved_scenario_gives_the_same_world(tmp_path):
    from simloop.scenario.save import to_toml

    scenario = load("maze", seed=3)
    file = tmp_path / "again.toml"
    file.write_text(to_toml(scenario))
    assert load(file) == scenario


@given(st.integers(0, 2**32), st.integers(2, 9), st.integers(2, 9))
@settings(max_examples=30)
def test_a_perfect_maze_joins_every_pair_of_cells_by_one_way(seed, columns, rows):
    east, north = mazes.spanning_walls(np.random.default_rng(seed), columns, rows)
    doors = (~east).sum() + (~north).sum()
    assert doors == columns * rows - 1  # with all cells reached, a tree
    reached, stack = {(0, 0)}, [(0, 0)]
    while stack:
        i, j = stack.pop()
        steps = [((i + 1, j), i + 1 < columns and not east[min(i, columns - 2), j]),
                 ((i - 1, j), i > 0 and not east[i - 1, j]),
                 ((i, j + 1), j + 1 < rows and not north[i, min(j, rows - 2)]),
                 ((i, j - 1), j > 0 and not north[i, j - 1])]  # fmt: skip
        for cell, is_open in steps:
            if is_open and cell not in reached:
                reached.add(cell)
                stack.append(cell)
    assert len(reached) == columns * rows


def test_corridors_are_as_wide_as_asked_for_and_loops_take_walls_away():
    bounds = (0.0, 0.0, 7.0, 7.0)
    walls = mazes.maze(np.random.default_rng(1), bounds, 0.8, 0.0)
    open_walls = mazes.maze(np.random.default_rng(1), bounds, 0.8, 0.5)
    plan = rasterise([s for w in [*walls, *walls_about(bounds)] for s in w.sections()], bounds)
    middles = np.arange(7) + 0.5
    centres = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2)
    assert plan.clearance_m(centres).min() == pytest.approx(0.4, abs=1e-6)

    def length(them):
        return sum(max(one.size_m) for one in them)

    assert length(open_walls) < 0.75 * length(walls)


@pytest.mark.parametrize("width", [0.55, 0.9])
def test_gaps_and_doors_are_exactly_as_wide_as_asked_for(width):
    ends = np.array([[0.5, 2.0], [9.5, 2.0]])
    bounds = (0.0, 0.0, 10.0, 4.0)
    walls = buildings.gaps(np.random.default_rng(2), bounds, 2.0, [width], ends)
    by_wall = {}
    for one in walls:
        by_wall.setdefault(one.position_m[0], []).append(one)
    assert len(by_wall) >= 4
    for pieces in by_wall.values():
        assert sum(one.size_m[1] for one in pieces) == pytest.approx(4.0 - width)
    rooms = buildings.rooms(np.random.default_rng(2), (0, 0, 6, 6), 3.0, width, 0.0)
    total = sum(max(one.size_m) for one in rooms)
    assert total == pytest.approx(4 * 3.0 - 3 * width)  # three doors join four rooms


def test_trunks_keep_apart_and_a_denser_forest_has_more():
    bounds = (0.0, 0.0, 12.0, 12.0)
    thin, thick = (fields.forest(np.random.default_rng(3), bounds, 0.8, d) for d in (0.1, 0.9))
    assert len(thick) > 1.2 * len(thin) > 0
    places = np.array([one.position_m for one in thick])
    radii = np.array([0.5 * one.size_m[0] for one in thick])
    gaps = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)) - radii - radii[:, None]
    assert gaps[~np.eye(len(gaps), dtype=bool)].min() >= 0.8


def test_the_dead_ends_bar_the_straight_way_and_open_towards_the_start():
    ends = np.array([[0.8, 4.0], [9.2, 4.0]])
    for seed in range(10):
        rng = np.random.default_rng(seed)
        things = mazes.dead_ends(rng, 2.5, 2, ends)
        plan = rasterise([s for one in things for s in one.sections()], (0, 0, 10, 8))
        line = ends[0] + np.linspace(0, 1, 800)[:, None] * (ends[1] - ends[0])
        assert plan.clearance_m(line).min() < 0.0
        back, arm, _ = things[:3]
        assert math.dist(arm.position_m, ends[0]) < math.dist(back.position_m, ends[0])


def test_what_cannot_be_crossed_is_told_after_two_hundred_trials():
    wall_to_wall = Generator("barn", (3.0, 4.0), density=0.9)
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="no passable barn"):
        draw_world(wall_to_wall, rng, (1.5, 0.6), (1.5, 3.4), BODY)


@pytest.mark.parametrize(
    ("override", "told"),
    [
        ("generator.kind=labyrinth", "generator.kind"),
        ("generator.gaps_m=[]", "gaps_m"),
        ("generator.width=1", "unknown key"),
        ("arena=trap", "leave out arena"),
        ("bounds_m=[0,0,5,5]", "bounds_m"),
    ],
)
def test_a_wrong_generator_is_one_line(override, told):
    with pytest.raises(InputError, match=told):
        load("gaps", [override])


def save_picture(filled, file, resolution=0.05, origin=(-1.0, 2.0)):
    """As map_server has it: the first row of the picture is the uppermost."""
    values = np.where(filled[::-1], 0, 254).astype(np.uint8)
    header = f"P5\n{filled.shape[1]} {filled.shape[0]}\n255\n".encode()
    file.with_suffix(".pgm").write_bytes(header + values.tobytes())
    file.write_text(
        f"image: {file.with_suffix('.pgm').name}\nresolution: {resolution}\n"
        f"origin: [{origin[0]}, {origin[1]}, 0.0]\n"
    )


@given(st.integers(0, 2**32), st.floats(0.0, 1.0))
@settings(max_examples=40)
def test_rectangles_tile_the_filled_cells_exactly(seed, share):
    filled = np.random.default_rng(seed).random((13, 17)) < share
    count = np.zeros(filled.shape, int)
    for r0, c0, r1, c1 in tile_rectangles(filled):
        count[r0:r1, c0:c1] += 1
    assert np.array_equal(count, filled.astype(int))


def test_a_map_stands_up_to_the_cell(tmp_path):
    filled = np.zeros((80, 100), bool)
    filled[[0, -1]] = filled[:, [0, -1]] = True
    filled[30:50, 40:45] = True
    save_picture(filled, tmp_path / "hall.yaml")
    layout = read_map_world(tmp_path / "hall.yaml")
    assert layout.bounds_m == pytest.approx((-1.0, 2.0, 4.0, 6.0))
    plan = rasterise([s for one in layout.obstacles for s in one.sections()], layout.bounds_m)
    y, x = np.mgrid[0:80, 0:100]
    centres = np.stack([-1.0 + 0.05 * (x + 0.5), 2.0 + 0.05 * (y + 0.5)], axis=-1).reshape(-1, 2)
    assert np.array_equal(plan.clearance_m(centres).reshape(80, 100) < 0.0, filled)
    file = tmp_path / "mine.toml"
    file.write_text('arena = "hall.yaml"\nstart = [0.0, 4.0, 0.0]\ngoal = [3.0, 4.0]\n')
    world = build_world(load(file))
    assert world.floor.clearance_m(np.array([[1.0, 4.0]]))[0] == pytest.approx(0.0, abs=0.01)


WORLD = """<sdf version="1.6"><world name="w">
<model name="ground"><link name="l"><collision name="c"><geometry><plane/></geometry></collision>
</link></model>
<model name="post"><pose>1 2 0.3 0 0 0</pose><link name="l"><collision name="c"><geometry>
<cylinder><radius>0.075</radius><length>0.6</length></cylinder></geometry></collision></link>
</model>
<model name="crate"><pose>3 0 0 0 0 1.5707963</pose><link name="l"><pose>0.5 0 0 0 0 0</pose>
<collision name="c"><geometry><box><size>1 0.2 0.5</size></box></geometry></collision></link>
</model></world></sdf>"""


def test_a_gazebo_world_stands_where_its_nested_poses_put_it(tmp_path):
    file = tmp_path / "room.world"
    file.write_text(WORLD)
    layout = read_sdf(file)
    post, crate = layout.obstacles
    assert (post.shape, post.position_m, post.size_m) == ("cylinder", (1.0, 2.0), (0.15,))
    assert crate.position_m == pytest.approx((3.0, 0.5))
    assert crate.yaw_rad == pytest.approx(0.5 * math.pi, abs=1e-6)
    assert layout.bounds_m == pytest.approx((-1.075, -2.0, 5.1, 4.075))
    scenario = tmp_path / "s.toml"
    scenario.write_text('arena = "room.world"\nstart = [0.0, 0.0, 0.0]\ngoal = [1.0, 0.0]\n')
    assert len(build_world(load(scenario)).floor.sections) == 2


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("<cylinder><radius>0.075</radius><length>0.6</length></cylinder>",
         "<mesh><uri>model://tree.dae</uri></mesh>", "post: mesh: model://tree.dae: not found"),
        ("1 2 0.3 0 0 0", "1 2", "model post: pose '1 2': not 6 numbers"),
        ("<radius>0.075", "<radius>-1", "impossible size"),
        ("<radius>0.075</radius>", "<radius>nan</radius>", "not 1 numbers"),
        ("</world>", "<include><uri>model://oak</uri></include></world>", "includes model://oak"),
        ("<sdf", "<!DOCTYPE x><sdf", "entities"),
        ("</sdf>", "", "not XML"),
        ("sdf", "urdf", "not a Gazebo world"),
    ],
)  # fmt: skip
def test_what_cannot_stand_here_is_refused_by_name(tmp_path, old, new, told):
    file = tmp_path / "room.world"
    file.write_text(WORLD.replace(old, new))
    with pytest.raises(InputError, match=told):
        read_sdf(file)


@given(st.binary(max_size=200))
def test_rubbish_is_no_world_and_ends_in_one_line(tmp_path_factory, data):
    file = tmp_path_factory.mktemp("sdf") / "x.world"
    file.write_bytes(data)
    with pytest.raises(InputError):
        read_sdf(file)
