"""What an MJCF file's floor is, how far it reaches, and what of the file is ground."""

from __future__ import annotations

import pytest

from simloop.common.errors import InputError
from simloop.scenario.build import build_world
from simloop.scenario.load import load

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
