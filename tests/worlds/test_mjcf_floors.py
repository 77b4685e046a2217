"""What an MJCF file's floor is, how far it reaches, and what of the file is ground."""

from __future__ import annotations

import pytest

from simloop.common.errors import InputError
from simloop.scenario.build import build_world
from simloop.scenario.load import load
from simloop.worlds.arena import assemble_with_notes, compile_spec
from simloop.worlds.layout import Layout

ENDLESS = '<geom name="floor" type="plane" size="0 0 .05"/>'
ENDS = '<geom type="box" size="4 3 .1" pos="0 0 -.1"/>'
WALL = '<geom name="w" type="box" pos="2 0 0.3" size="0.1 1 0.3"/>'


@pytest.fixture
def world_of(tmp_path):
    """Build the world of a scenario whose arena has these geoms."""

    def build(geoms: str, keys: str = ""):
        (tmp_path / "room.xml").write_text(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>")
        ends = 'arena = "room.xml"\nstart = [0.0, 0.0, 0.0]\ngoal = [0.6, 0.0]\n'
        (tmp_path / "mine.toml").write_text(ends + keys)
        return build_world(load(tmp_path / "mine.toml"))

    return build


@pytest.mark.parametrize("floor", [ENDLESS, ENDS, '<geom type="plane" size="0 3 1"/>'])
def test_a_scenario_bounds_the_floor_of_a_file(world_of, floor):
    world = world_of(floor + WALL, "bounds_m = [-3, -2, 3.5, 2]")
    assert world.floor.bounds_m.tolist() == [-3.0, -2.0, 3.5, 2.0]
    assert world.floor.nearest([1.0, 0.0]) == (pytest.approx(0.9), "w")


def test_an_endless_floor_without_bounds_asks_for_what_then_works(world_of):
    with pytest.raises(InputError, match="its floor has no end: give bounds_m in the scenario"):
        world_of(ENDLESS + WALL)


def test_a_scenario_leaves_a_box_that_is_the_floor_where_it_is(world_of):
    model = world_of(ENDS + WALL, "bounds_m = [-3, -2, 3.5, 2]").model
    assert model.geom("floor").size.tolist() == [4.0, 3.0, 0.1]
    assert model.geom("floor").pos[2] == -0.1


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("bounds_m = [-3, -2, 4.5, 2]", "reaches beyond the floor, which has x -4 to 4, y -3 to 3"),
        ("bounds_m = [-3, -2, 0.5, 2]", "goal"),
        ("bounds_m = [-3, -2, -3, 2]", "x_min, y_min must be below x_max, y_max"),
    ],
)
def test_bounds_that_cannot_be_are_refused(world_of, keys, said):
    with pytest.raises(InputError, match=said):
        world_of(ENDS + WALL, keys)


FLOOR = '<geom name="floor" type="plane" size="4 4 .1"/>'
STAIRS = "".join(
    f'<geom name="ground_{n}" type="box" size=".15 1 {0.01 * n}" pos="{0.3 * n} 0 {0.01 * n}"/>'
    for n in range(1, 6)
)
RAMP = "0 -1 0 0 1 0 1 -1 .4 1 1 .4 1 -1 0 1 1 0"


@pytest.fixture
def read(tmp_path):
    """Compile a file with a floor and these geoms; return its names and bits, and the notes."""

    def read_geoms(geoms: str, more: str = "", friction: float = 0.6):
        text = f"<mujoco>{more}<worldbody>{FLOOR}{geoms}</worldbody></mujoco>"
        (tmp_path / "room.xml").write_text(text)
        layout = Layout(arena=str(tmp_path / "room.xml"))
        spec, notes = assemble_with_notes(layout, friction)
        model = compile_spec(spec)
        bits = {model.geom(n).name: int(model.geom_contype[n]) for n in range(model.ngeom)}
        return {name: bits[name] for name in bits if "ground" in name}, " | ".join(notes)

    return read_geoms


@pytest.mark.parametrize(
    "shape",
    [
        'type="box" size="0.1 2 0.3" pos="0.9 0 0.3"',
        'type="box" size="0.1 2 0.02" pos="0.9 0 0.02"',
        'type="box" size="0.3 0.1 2" euler="0 90 0" pos="0.9 0 0.3"',
        'type="box" size="1 1 0.1" euler="0 60 0" pos="0.9 0 0.3"',
        'type="cylinder" size="0.1 0.3" pos="0.9 0 0.3"',
        'type="sphere" size="0.3" pos="0.9 0 0.3"',
        'type="mesh" mesh="wall"',
        'type="box" size="1 1 0.1" pos="0.9 0 1.5"',
    ],
)
def test_what_is_too_high_to_climb_is_no_ground_whatever_its_name(read, shape):
    corners = " ".join(f"{x} {y} {z}" for x in (1, 1.2) for y in (-1, 1) for z in (0, 0.6))
    mesh = f'<asset><mesh name="wall" vertex="{corners}"/></asset>'
    taken = '<geom name="obstacle_ground_w" type="box" size=".1 .1 .1" pos="-1 0 .1"/>'
    bits, said = read(f'{taken}<geom name="ground_w" {shape}/>', mesh)
    assert bits == {"obstacle_ground_w": 1, "obstacle_ground_w_": 1}
    assert "too high or too steep for the robot to climb, so an obstacle: ground_w" in said


def test_ramps_stairs_and_what_they_lead_to_are_ground(read):
    deck = '<geom name="ground_deck" type="box" size=".5 1 .05" pos="-2.5 0 .35"/>'
    ramps = f"""<geom name="ground_slope" type="mesh" mesh="ramp" pos="-4 0 0"/>
        <geom name="ground_board" type="box" size=".6 .5 .02" euler="0 20 0" pos="3 0 .19"/>{deck}
        <geom name="ground_plate" type="box" size="1 .2 .01" pos="0 3 0.01"/>"""
    bits, said = read(ramps + STAIRS, f'<asset><mesh name="ramp" vertex="{RAMP}"/></asset>')
    assert "obstacle" not in said
    assert bits == {f"ground_{n}": 3 for n in ("slope", "board", "deck", *range(2, 6))} | {
        "ground_1": 2,
        "ground_plate": 2,
    }


def test_less_friction_makes_an_obstacle_of_a_ramp(read):
    ramp = '<geom name="ground_r" type="mesh" mesh="ramp"/>'
    mesh = f'<asset><mesh name="ramp" vertex="{RAMP}"/></asset>'
    assert [list(read(ramp, mesh, mu)[0]) for mu in (0.45, 0.35)] == [
        ["ground_r"],
        ["obstacle_ground_r"],
    ]


def test_the_robot_meets_a_wall_that_calls_itself_ground(world_of):
    wall = '<geom name="ground_wall" type="box" pos="1.4 0 0.3" size="0.1 2 0.3"/>'
    floor = world_of(FLOOR + wall).floor
    assert floor.nearest([0.9, 0.0]) == (pytest.approx(0.4), "obstacle_ground_wall")


@pytest.mark.parametrize(("height", "steep"), [(1.3, True), (1.1, False)])
def test_steep_places_of_a_height_field_are_named(read, height, steep):
    field = (
        f'<asset><hfield name="h" nrow="2" ncol="2" size="1 1 {height} .1" elevation="0 0 1 1"/>'
    )
    bits, said = read('<geom name="ground_h" type="hfield" hfield="h"/>', f"{field}</asset>")
    assert bits == {"ground_h": 3}
    assert ("too steep to climb in places" in said) == steep
