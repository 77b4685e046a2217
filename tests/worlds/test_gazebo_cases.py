"""Worlds from public bug reports, beside the clone; each folder's README says what is right."""

from __future__ import annotations

import pytest
from helpers.shared_cases import shared_case

from simloop.common.errors import InputError
from simloop.scenario.build import build_world
from simloop.scenario.load import load
from simloop.worlds.gazebo_world import read_sdf

BOUNDS = (-10.0, -10.0, 10.0, 10.0)
REFUSED = ("heightmap", "lol", "old_1_0", "size_attr")
EMPTY = ("collide_none", "two_shapes_thin")
ONE = (
    *("actor", "capsule", "cdata", "comment_in_pose", "declaration_late", "dynamic", "empty_pose"),
    *("empty_pose_text", "include_ground", "include_sun", "namespace_default", "namespace_prefix"),
    *("negative_zero", "nested_merge", "newline_pose", "placement_frame", "polyline", "utf16"),
    *("relative_to_model", "relative_to_world", "roll_pi_and_pitch_pi", "visual_only"),
    "yaw_on_cylinder_tilt",
)


@pytest.mark.parametrize(
    ("scenario", "point", "clearance"),
    [
        ("08-sdf-state/s.toml", (7.0, 0.0), 0.5),
        ("09-sdf-degrees/deg.toml", (3.0, 1.5), -0.1),
        ("09-sdf-degrees/deg.toml", (4.5, 0.0), 1.4),
        ("09-sdf-degrees/quat.toml", (3.0, 1.5), -0.1),
        ("09-sdf-degrees/deg180.toml", (3.0, 1.5), 1.4),
        ("09-sdf-degrees/deg30.toml", (3.0, 1.5), 1.1990381),
        ("10-sdf-heights/door.toml", (2.0, 0.0), 0.45),
        ("10-sdf-heights/floor.toml", (2.0, 0.0), 0.9),
        ("10-sdf-heights/ceiling.toml", (2.0, 0.0), 0.9),
    ],
)
def test_a_world_is_as_gazebo_shows_it(scenario, point, clearance):
    folder, _, file = scenario.partition("/")
    floor = build_world(load(shared_case(folder) / file)).floor
    assert floor.clearance_m(point)[0] == pytest.approx(clearance, abs=1e-6)


@pytest.mark.parametrize("name", [*REFUSED, *EMPTY, *ONE, "population", "sphere"])
def test_each_peculiarity_is_read_or_refused(name):
    file = shared_case("11-sdf-misc") / f"{name}.sdf"
    if name in REFUSED:
        with pytest.raises(InputError):
            read_sdf(file, BOUNDS)
        return
    places = [one.position_m for one in read_sdf(file, BOUNDS).obstacles]
    count = {"population": 5, "sphere": 2} | dict.fromkeys(EMPTY, 0)
    assert len(places) == count.get(name, 1)
    if name == "placement_frame":
        assert places == [(2.0, 0.0)]
    if name.startswith("empty_pose"):
        assert places == [(0.0, 0.0)]
