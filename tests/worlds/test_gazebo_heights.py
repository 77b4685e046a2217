"""What is in the robot's way by its height, in worlds as Gazebo's building editor makes them."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.gazebo import BOUNDS, box, collision, model, plan_of, pose, read, world
from scipy import ndimage

from simloop.common.errors import InputError
from simloop.scenario.build import build_world
from simloop.scenario.load import load
from simloop.worlds.gazebo_world import read_sdf

ROUND = collision("<cylinder><radius>.1</radius><length>1</length></cylinder>")
POST = model("post", ROUND, pose("0 0 .5 0 0 0"))
PLANE = model("plane", collision("<plane><normal>0 0 1</normal></plane>"))
HIGH = 2.5


def wall(name: str, x0: float, y0: float, x1: float, y1: float, *openings: tuple) -> str:
    """A wall of the building editor: a link with boxes beside, over and under its openings.

    openings: distance of the middle from the wall's first end, width, sill and lintel, m.
    """
    length, yaw = np.hypot(x1 - x0, y1 - y0), np.arctan2(y1 - y0, x1 - x0)
    parts, at = [], 0.0
    for middle, width, sill, lintel in sorted(openings):
        parts.append((at, middle - 0.5 * width, 0.0, HIGH))
        parts.append((middle - 0.5 * width, middle + 0.5 * width, lintel, HIGH))
        if sill:
            parts.append((middle - 0.5 * width, middle + 0.5 * width, 0.0, sill))
        at = middle + 0.5 * width
    parts.append((at, length, 0.0, HIGH))
    boxes = [
        box(b - a, 0.15, top - low, pose(f"{0.5 * (a + b - length)} 0 {0.5 * (low + top)} 0 0 0"))
        for a, b, low, top in parts
    ]
    place = pose(f"{0.5 * (x0 + x1)} {0.5 * (y0 + y1)} 0 0 0 {yaw}", "frame=''")
    return f"<link name='{name}'>{place}{''.join(boxes)}</link>"


DOOR, WINDOW = (0.9, 0.0, 2.0), (1.2, 0.8, 2.0)
HOUSE = "".join(
    (
        wall("south", -6, -4, 6, -4, (3.0, *WINDOW), (6.5, *DOOR)),
        wall("north", 6, 4, -6, 4, (3.0, *WINDOW), (9.0, *WINDOW)),
        wall("west", -6, 4, -6, -4, (4.0, *WINDOW)),
        wall("east", 6, -4, 6, 4, (2.0, *WINDOW)),
        wall("inner", -1, -4, -1, 4, (5.5, *DOOR)),
        wall("room", -1, 0.5, 6, 0.5, (2.5, *DOOR)),
        wall("closet", 3.5, 0.5, 3.5, 4.0),  # without a door
        wall("nook", -6, 1.0, -4.2, 2.6, (1.1, *DOOR)),  # turned
    )
)


def reachable_m2(layout, start, clearance_m=0.25, step=0.02) -> float:
    """The area that the middle of a disc can reach within the bounds."""
    plan = plan_of(layout, step)
    free = plan.distance_m > clearance_m
    labels = np.asarray(ndimage.label(free)[0])
    column, row = ((np.array(start) - plan.origin_m) / step).astype(int)
    assert labels[row, column]
    return float(np.count_nonzero(labels == labels[row, column]) * step**2)


def drawn_m2(start, bounds, clearance_m=0.25, step=0.02) -> float:
    """The same from the walls' own numbers: samples of the walls, and their distance transform."""
    x = np.arange(bounds[0] + 0.5 * step, bounds[2], step)
    y = np.arange(bounds[1] + 0.5 * step, bounds[3], step)
    filled = np.zeros((len(y), len(x)), bool)
    across = np.linspace(-0.075, 0.075, 31)

    def fill(x0, y0, x1, y1, gaps):
        length = np.hypot(x1 - x0, y1 - y0)
        along = np.arange(0.0, length, 0.004)
        for middle, width in gaps:
            along = along[np.abs(along - middle) > 0.5 * width]
        ahead = np.array([x1 - x0, y1 - y0]) / length
        points = np.array([x0, y0]) + along[:, None, None] * ahead
        points = points + across[None, :, None] * [-ahead[1], ahead[0]]
        cells = ((points - [bounds[0], bounds[1]]) / step).astype(int).reshape(-1, 2)
        filled[cells[:, 1], cells[:, 0]] = True

    fill(-6, -4, 6, -4, [(6.5, 0.9)])
    fill(6, 4, -6, 4, [])
    fill(-6, 4, -6, -4, [])
    fill(6, -4, 6, 4, [])
    fill(-1, -4, -1, 4, [(5.5, 0.9)])
    fill(-1, 0.5, 6, 0.5, [(2.5, 0.9)])
    fill(3.5, 0.5, 3.5, 4.0, [])
    fill(-6, 1.0, -4.2, 2.6, [(1.1, 0.9)])
    free = ndimage.distance_transform_edt(~filled) * step > clearance_m
    labels = np.asarray(ndimage.label(free)[0])
    column, row = ((np.array(start) - bounds[:2]) / step).astype(int)
    return float(np.count_nonzero(labels == labels[row, column]) * step**2)


def test_the_doors_of_a_house_are_open_and_its_windows_are_not(tmp_path):
    file = tmp_path / "model.sdf"  # a model alone, as in a folder of models
    file.write_text(
        f"<sdf version='1.6'><model name='house'><static>1</static>{HOUSE}</model></sdf>"
    )
    layout = read_sdf(file)
    assert layout.bounds_m == pytest.approx((-8.0, -6.075, 8.0, 6.075), abs=0.1)
    inside = reachable_m2(layout, (0.0, -2.0))
    assert inside == pytest.approx(drawn_m2((0.0, -2.0), layout.bounds_m), rel=0.005)
    assert inside == pytest.approx(reachable_m2(layout, (7.0, 0.0)))  # and from outside
    closet = reachable_m2(layout, (4.7, 2.2))
    assert closet == pytest.approx(drawn_m2((4.7, 2.2), layout.bounds_m), rel=0.03) and closet < 6.0
    sills = [one for one in layout.obstacles if one.height_m == pytest.approx(0.8)]
    assert len(sills) == 5
    assert layout.notes == (
        "model.sdf: what hangs higher than the robot (0.25 m) is left out: house",
    )


@pytest.mark.parametrize(
    ("z", "high", "in_the_way"),
    [
        (0.5, 1.0, True),
        (-0.02, 0.1, True),  # 3 cm are over the ground
        (-0.04, 0.1, False),  # 1 cm over the ground
        (-0.5, 1.0, False),  # a slab whose top is the ground
        (0.35, 0.2, False),  # hangs just over the robot
        (0.34, 0.2, True),
        (3.05, 0.1, False),
        (0.1, 0.2, True),
    ],
)
def test_a_box_counts_if_it_reaches_the_heights_of_the_robot(tmp_path, z, high, in_the_way):
    crate = model("crate", box(1.0, 1.0, high), pose(f"3 0 {z} 0 0 0"))
    layout = read(tmp_path, world(POST, crate))
    assert len(layout.obstacles) == 1 + in_the_way
    if in_the_way:
        one = next(one for one in layout.obstacles if one.shape == "box")
        assert one.bottom_m == pytest.approx(max(0.0, z - 0.5 * high))
        assert one.bottom_m + one.height_m == pytest.approx(min(z + 0.5 * high, 3.0))
    else:
        assert "crate" in layout.notes[0]


@pytest.mark.parametrize(
    ("floor", "ground"),
    [
        (model("slab", box(20, 20, 0.1), pose("0 0 0.05 0 0 0")), 0.1),  # posts stand through it
        (model("slab", box(20, 20, 0.1), pose("0 0 0.05 0 0 0")) + PLANE, 0.1),
        (model("slab", box(20, 20, 0.1), pose("0 0 -0.2 0 0 0")) + PLANE, 0.0),
        (model("roof", box(20, 20, 0.1), pose("0 0 0.9 0 0 0")) + PLANE, 0.0),
        (model("podium", box(3, 3, 0.1), pose("6 6 0.05 0 0 0")) + PLANE, 0.0),
        (PLANE.replace("</static>", "</static><pose>0 0 -0.2 0 0 0</pose>"), -0.2),
    ],
)
def test_the_ground_is_what_the_robot_stands_on(tmp_path, floor, ground):
    low = model("low", box(1.0, 1.0, 0.3), pose(f"3 0 {ground} 0 0 0"))  # 0.15 m over the ground
    layout = read(tmp_path, world(POST, low, floor), ends_m=[(1.0, 0.0), (2.0, 2.0)])
    there = next(one for one in layout.obstacles if one.position_m == (3.0, 0.0))
    assert there.height_m == pytest.approx(0.15) and there.bottom_m == 0.0
    told = [line for line in layout.notes if "the ground is at height" in line]
    assert len(told) == (ground != 0.0)


def test_what_can_move_stands_still_and_what_touches_nothing_is_left_out(tmp_path):
    cart = POST.replace("true", "false").replace("post", "cart")
    air = model("air", box(1, 1, 1).replace("</geometry>", "</geometry><surface><contact>"
                "<collide_bitmask>0x00</collide_bitmask></contact></surface>"))  # fmt: skip
    seen = model("seen", "<visual name='v'><geometry><box/></geometry></visual>")
    layout = read(tmp_path, world(cart, air, seen, "<actor name='walker'/>"))
    assert len(layout.obstacles) == 1
    notes = " / ".join(layout.notes)
    for told in (
        "stand still here: cart",
        "touch nothing (by their <contact>) are left out: air",
        "without a collision shape are left out: seen",
        "actors are left out: walker",
    ):
        assert told in notes


def test_start_and_goal_near_the_rim_have_floor_around_them(tmp_path):
    (tmp_path / "some.world").write_text(
        world(model("post", box(0.2, 0.2, 1), pose("2 1 0 0 0 0")))
    )
    file = tmp_path / "s.toml"
    file.write_text('arena = "some.world"\nstart = [0, 0, 0]\ngoal = [4.0, 0.0]\n')
    built = build_world(load(file))
    assert built.floor.bounds_m == pytest.approx([-1.0, -1.1, 5.0, 3.1])
    assert read(tmp_path, world(POST)).bounds_m == BOUNDS


@pytest.mark.parametrize("height", [-0.5, 0.0, 1.5])
def test_an_included_ground_plane_tells_the_height_of_the_floor(tmp_path, height):
    plane = f"<include><uri>model://ground_plane</uri>{pose(f'0 0 {height} 0 0 0')}</include>"
    crate = model("crate", box(0.4, 0.4, 0.4), pose(f"2 0 {height + 0.2} 0 0 0"))
    lintel = model("lintel", box(0.4, 2, 0.4), pose(f"4 0 {height + 1.2} 0 0 0"))
    layout = read(tmp_path, world(plane, crate, lintel))
    (found,) = layout.obstacles
    assert found.position_m == (2.0, 0.0)
    assert found.height_m == pytest.approx(0.4) and found.bottom_m == pytest.approx(0.0)
    assert (f"the ground is at height {height:g} m" in " ".join(layout.notes)) == (height != 0.0)


def test_an_included_ground_plane_that_is_not_level_is_refused(tmp_path):
    plane = f"<include><uri>model://ground_plane</uri>{pose('0 0 0 0.2 0 0')}</include>"
    with pytest.raises(InputError, match="ground_plane: a plane that is not level"):
        read(tmp_path, world(plane, POST))


def test_what_an_include_changes_and_is_not_used_is_said(tmp_path):
    (tmp_path / "post").mkdir()
    (tmp_path / "post" / "model.sdf").write_text(f"<sdf version='1.9'>{POST}</sdf>")
    inside = "<uri>post</uri><experimental:params><collision element_id='l::c' action='remove'/>"
    layout = read(tmp_path, world(f"<include>{inside}</experimental:params></include>"))
    assert len(layout.obstacles) == 1
    assert "<experimental:params> of an <include> is not used: post" in " ".join(layout.notes)
