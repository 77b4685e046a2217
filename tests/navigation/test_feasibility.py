"""A goal without a way to it: said, and not taken for one that is only hard to reach."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from simloop.common.errors import InputError
from simloop.loop import Simulation
from simloop.messages import Event, WorldView
from simloop.navigation.feasibility import Feasibility, is_closed_off
from simloop.scenario.build import build_world
from simloop.scenario.load import load

STEP = 0.05
BOX = """
start = [1.0, 1.0, 0.0]
goal = [4.0, 4.0]
bounds_m = [0.0, 0.0, 6.0, 6.0]
time_limit_s = 120.0
{more}
[[obstacles]]
shape = "box"
position_m = [4.0, 3.2]
size_m = [{width}, 0.2]
[[obstacles]]
shape = "box"
position_m = [4.0, 4.8]
size_m = [1.8, 0.2]
[[obstacles]]
shape = "box"
position_m = [3.2, 4.0]
size_m = [0.2, 1.4]
[[obstacles]]
shape = "box"
position_m = [4.8, 4.0]
size_m = [0.2, 1.4]
"""


def view_of(occupied, t_ns=0):
    distance = ndimage.distance_transform_edt(~occupied, sampling=STEP).astype(np.float32)
    nothing = np.zeros((0, 3))
    return WorldView(t_ns, np.zeros(2), STEP, distance, nothing, np.array([-9.0, -9.0, 9.0, 9.0]))


def ring(gap_cells):
    """A square wall round (2, 2) in 4 m x 4 m, with a gap in it."""
    occupied = np.zeros((80, 80), bool)
    occupied[24:57, [24, 56]] = occupied[[24, 56], 24:57] = True
    occupied[40 : 40 + gap_cells, 56] = False
    return occupied


PLACE, GOAL = np.array([0.5, 0.5, 0.0]), np.array([2.0, 2.0])


@pytest.mark.parametrize(("gap_cells", "closed"), [(0, True), (6, True), (14, False)])
def test_a_ring_is_closed_unless_its_gap_is_as_wide_as_the_robot(gap_cells, closed):
    assert is_closed_off(view_of(ring(gap_cells)), PLACE, GOAL, 0.1, 0.21) is closed


def test_unknown_and_outside_are_ways_and_a_goal_under_something_has_none():
    wall = np.zeros((80, 80), bool)
    wall[:, 40] = True  # from edge to edge: round it, outside of what is known
    assert not is_closed_off(view_of(wall), PLACE, np.array([3.0, 2.0]), 0.1, 0.21)
    block = np.zeros((80, 80), bool)
    block[30:50, 30:50] = True
    assert is_closed_off(view_of(block), PLACE, GOAL, 0.1, 0.21)
    assert not is_closed_off(view_of(block), PLACE, GOAL, 1.5, 0.21)  # near is enough


def test_it_takes_three_looks_and_three_seconds():
    def looks(*times_s, closed=None):
        reach = Feasibility(0.1, 0.465)
        return [
            reach.update(view_of(ring(0 if shut else 14), round(1e9 * t)), PLACE, GOAL, False)
            for t, shut in zip(times_s, closed or [True] * len(times_s), strict=True)
        ]

    assert looks(0, 1, 2) == [False, False, False]
    assert looks(0, 2, 3, 4) == [False, False, True, False]  # said once
    assert looks(0, 4) == [False, False]
    assert not any(looks(0, 1, 2, 5, 6, closed=[True, True, False, True, True]))


def scenario(tmp_path, **fields):
    file = tmp_path / "box.toml"
    file.write_text(BOX.format(**{"more": "may_be_closed_off = true", "width": 1.8, **fields}))
    return load(file)


def test_the_robot_says_that_a_walled_in_goal_cannot_be_reached(tmp_path):
    said = []
    simulation = Simulation(scenario(tmp_path), listeners=[said.append])
    assert simulation.run().outcome == "unreachable"
    texts = [m.text for m in said if isinstance(m, Event)]
    assert sum("cannot be reached" in text for text in texts) == 1


def test_a_door_makes_it_a_goal_like_any_other(tmp_path):
    assert Simulation(scenario(tmp_path, width=0.2)).run().outcome == "reached"


def test_without_leave_such_a_world_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"walled off.*may_be_closed_off"):
        build_world(scenario(tmp_path, more=""))
