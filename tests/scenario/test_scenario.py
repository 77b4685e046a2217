"""Scenario files: validation, overrides, errors in one line, and saving."""

from __future__ import annotations

import os
import string
import subprocess
import sys
import typing
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.config import MOVED_KEYS, Config
from simloop.mapping.grid_map import GridMap
from simloop.scenario.build import build_world, nearest
from simloop.scenario.catalog import arena_files, planner_names, scenario_facts, scenario_files
from simloop.scenario.explain import keys_at
from simloop.scenario.inputs import files_behind, input_files
from simloop.scenario.load import apply_override, from_table, load, resolve
from simloop.scenario.save import to_toml
from simloop.scenario.scenario import Scenario

MINIMAL = 'arena = "open"\nstart = [0, 0, 0]\ngoal = [1, 2]\n'


def write(directory, text, name="mine.toml"):
    path = directory / name
    path.write_text(text, encoding="utf-8")
    return path


def error_of(*args, **kwargs):
    with pytest.raises(InputError) as caught:
        load(*args, **kwargs)
    text = str(caught.value)
    assert "\n" not in text
    return text


@pytest.mark.parametrize("name", scenario_files())
def test_every_scenario_loads_builds_and_survives_being_written(name, tmp_path):
    scenario = load(name)
    assert scenario.name == name and scenario_facts(scenario_files()[name])["title"]
    world = build_world(scenario)
    ends = np.array([scenario.start[:2], scenario.goal])
    assert np.all(world.floor.clearance_m(ends) >= world.body.footprint_radius_m)
    saved = write(tmp_path, to_toml(scenario, {"simloop": "0.1.0"}), "other_name.toml")
    assert load(saved) == scenario


def test_overrides_seed_and_planner_reach_every_part():
    scenario = load(
        "experiment",
        [
            "goal=[3.0, 2.5]",
            "start.2=1.5",
            "planner.penalty=30",
            "rates.lidar_s = 0.2",
            "title=short",
            'description="two words"',
            "planner.precise=true",
            "clutter.count=3",
            "obstacles=[{shape='box', position_m=[1, 1], size_m=[0.2, 0.3]}]",
            "obstacles.0.yaw_rad=0.5",
        ],
        seed=7,
        planner="tlbo",
    )
    assert scenario.goal == (3.0, 2.5) and scenario.start == (0.0, 0.0, 1.5)
    assert scenario.config.planner.penalty == 30.0 and scenario.config.planner.precise is True
    assert scenario.config.rates.lidar_s == 0.2 and scenario.seed == 7
    assert (scenario.title, scenario.description) == ("short", "two words")
    assert scenario.clutter is not None and scenario.clutter.count == 3
    assert scenario.obstacles[0].yaw_rad == 0.5


def all_keys():
    """(key, value) of every leaf of the effective configuration."""
    scenario = load("clutter")
    for field in fields(Scenario):
        value = getattr(scenario, field.name)
        if field.name == "config":
            for section in fields(value):
                table = getattr(value, section.name)
                for item in fields(table):
                    if getattr(table, item.name) is None:  # an optional table
                        continue
                    yield f"{section.name}.{item.name}", getattr(table, item.name)
        elif not is_dataclass(value) and value is not None:
            yield field.name, value
    yield "clutter.count", 5


@pytest.mark.parametrize(("key", "value"), list(all_keys()), ids=lambda item: str(item)[:40])
def test_set_reaches_every_key_and_refuses_what_it_cannot_be(key, value):
    text = '"x"' if isinstance(value, str) else "{}"
    if isinstance(value, str):
        text = f'"{value}"'
    elif isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, tuple):
        text = str(list(value))
    else:
        text = repr(value)
    expected = load("clutter", ["clutter.count=5"] if key == "clutter.count" else [])
    assert load("clutter", [f"{key}={text}"]) == expected
    assert key.split(".")[-1] in error_of("clutter", [f"{key}={{nonsense = 1}}"])


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("planner.penalti=3", "planner.penalti: unknown key (did you mean 'penalty'?); choices:"),
        ("planer.name=tlbo", "unknown key 'planer' (did you mean 'planner'?); choices: arena"),
        ("clutter.cont=3", "did you mean 'count'?"),
        ("config.rates=1", "unknown key 'config'"),
        ("planner.penalty='30'", 'planner.penalty: must be a valid number, not "30"'),
        ("planner.penalty=true", "planner.penalty: must be a valid number, not true"),
        ("planner.learners=10.5", "planner.learners: must be a valid integer"),
        ("planner=3", "planner: must be a table, not 3"),
        ("goal=[1.0, nan]", "goal.1: must be a finite number, not nan"),
        ("goal=[-inf, 1.0]", "goal.0: must be a finite number, not -inf"),
        ("goal=[1.0]", "goal: too few values, 1 given"),
        ("goal=[1.0, 2.0, 3.0]", "goal"),
        ("goal=3", "goal: must be a list, not 3"),
        ("goal.2=3", "goal.2: index must be 0 to 1"),
        ("goal=[1,", "not a TOML value"),
        ("goal", "write it as key=value"),
        ("=3", "write it as key=value"),
        ("arena=3\ngoal=[1,2]", "one value at a time"),
        ("name.x=3", "name is a value, not a table"),
        ("rates.lidar_s=-0.1", "rates.lidar_s: must be greater than 0, not -0.1"),
        ("rates.lidar_s=0.025", "rates.lidar_s = 0.025 s is not a whole multiple of"),
        ("arena=opn", "unknown arena 'opn' (did you mean 'open'?); choices: clutter,"),
        ("arena=none.xml", "arena: no such file"),
        ("planner.name=tlb", "unknown planner 'tlb' (did you mean 'tlbo'?); choices: abc, "),
        ("seed=-1", "seed: must be greater than or equal to 0, not -1"),
        ("time_limit_s=1" + "0" * 400, "time_limit_s: must be a finite number"),
        ("time_limit_s=1" + "0" * 5000, "not a TOML value"),
        ("goal=" + "[" * 5000, "not a TOML value"),
        ("obstacles=[{shape='cone', position_m=[1,1]}]", "obstacles.0.shape: must be 'box'"),
        ("obstacles=[{shape='box', position_m=[1,1]}]", "obstacles.0: size_m of a box is"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(override, expected):
    assert expected in error_of("experiment", [override])


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("experimnt", "unknown scenario 'experimnt' (did you mean 'experiment'?); choices:"),
        ("missing/file.toml", "missing/file.toml: no such file"),
        ("missing.toml", "missing.toml: no such file"),
        ("", "unknown scenario ''"),
        ("..", "unknown scenario '..'"),
    ],
)
def test_a_scenario_that_is_not_there(name, expected):
    assert expected in error_of(name)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("goal = [1, 2\nx = 3", "mine.toml: not valid TOML"),
        ("arena = \"open\"\nstart = [0, 0, 0]\n", "mine.toml: goal: this key is required"),
        (MINIMAL + "[planer]\n", "mine.toml: unknown key 'planer'"),
        (MINIMAL + "goal = [1, 2]\n", "line 4"),
        (MINIMAL + "[rates]\nlidar_s = 1979-05-27\n", "rates.lidar_s: must be a valid number"),
    ],
)  # fmt: skip
def test_a_file_that_is_wrong_is_named(tmp_path, text, expected):
    assert expected in error_of(write(tmp_path, text))


def test_files_that_are_no_text_or_no_file(tmp_path):
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    assert "not a text file" in error_of(binary)
    (tmp_path / "folder.toml").mkdir()
    assert "is a directory" in error_of(tmp_path / "folder.toml")


def test_an_arena_of_ones_own_is_found_beside_the_scenario(tmp_path):
    (tmp_path / "room.xml").write_text(arena_files()["open"].read_text())
    (tmp_path / "assets").mkdir()
    for file in (arena_files()["open"].parent / "assets").iterdir():
        (tmp_path / "assets" / file.name).write_bytes(file.read_bytes())
    scenario = load(write(tmp_path, MINIMAL.replace('"open"', '"room.xml"')))
    assert scenario.arena == str(tmp_path / "room.xml") and scenario.name == "mine"
    assert build_world(scenario).floor.contains([0.0, 0.0])


def test_scenarios_are_read_without_mujoco():
    """The import of MuJoCo is slow, and fails where MUJOCO_GL names what is not there."""
    code = "import sys, simloop.scenario.load as l; l.load('maze'); print('mujoco' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


NUMBERS = st.floats(-1e4, 1e4)
TEXT = st.text(alphabet=string.printable + "äß€\x7f\x00\u2028😀", max_size=30)


@given(title=TEXT, goal=st.tuples(NUMBERS, NUMBERS), seed=st.integers(0, 2**63 - 1))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_a_scenario_holds_survives_being_written(tmp_path, title, goal, seed):
    table = {"name": "x", "arena": "open", "start": [0.0, 0.0, 0.0], "goal": list(goal)}
    scenario = from_table(table | {"title": title, "seed": seed}, source="test")
    assert load(write(tmp_path, to_toml(scenario))) == scenario


@given(st.text(max_size=40))
def test_no_override_does_anything_but_apply_or_be_refused(text):
    try:
        load("open", [text])
    except InputError as error:
        assert "\n" not in str(error)


def test_overriding_leaves_other_keys_alone():
    table = {"planner": {"penalty": 1.0, "name": "tlbo"}}
    apply_override(table, "planner.penalty=2")
    assert table == {"planner": {"penalty": 2, "name": "tlbo"}}


@pytest.mark.parametrize(
    ("name", "override", "expected"),
    [
        ("experiment", "goal=[9.0, 9.0]", "goal (9, 9) is outside the arena: x -0.65 to 4.35"),
        ("experiment", "start=[-9.0, 0.0, 0.0]", "start (-9, 0) is outside the arena"),
        ("experiment", "goal=[2.05, 0.55]", "goal (2.05, 0.55) is inside obstacle_02"),
        ("experiment", "goal=[4.2, 2.0]", "m from wall_east; the robot needs 0.25 m"),
        ("experiment", "start=[4.06, 1.95, 0.785]", "outline touches wall_east"),
        ("corridor", "goal=[0.0, 3.0]", "goal (0, 3) is walled off from the start"),
        ("clutter", "goal=[-9.0, 1.0]", "goal (-9, 1) is outside the arena"),
        ("clutter", "goal=[4.3, 4.4]", "inside the walls"),
    ],
)
def test_a_start_or_goal_that_cannot_be_stood_on_is_refused(name, override, expected):
    with pytest.raises(InputError) as caught:
        build_world(load(name, [override]))
    assert expected in str(caught.value) and "\n" not in str(caught.value)


def test_clutter_is_drawn_from_the_seed_alone():
    def outlines(seed):
        sections = build_world(load("clutter", seed=seed)).floor.sections
        return np.concatenate([section.vertices_m for section in sections])

    assert np.array_equal(outlines(3), outlines(3))
    assert outlines(3).shape != outlines(4).shape or not np.array_equal(outlines(3), outlines(4))


def tables(holder=Scenario, location=()):
    """(location, class) of every table that a scenario file may hold, at any depth."""
    yield list(location), holder
    for field in fields(holder):
        inner = "" if field.name == "config" else field.name
        for found in dataclasses_in(typing.get_type_hints(holder)[field.name]):
            yield from tables(found, (*location, inner) if inner else location)


def dataclasses_in(hint):
    if is_dataclass(hint):
        return [hint]
    return [found for inner in typing.get_args(hint) for found in dataclasses_in(inner)]


def test_an_unknown_key_is_answered_with_the_keys_of_its_own_table():
    deep = [found for found in tables() if found[0]]
    assert {len(location) for location, _ in deep} == {1, 2}
    for location, holder in deep:
        assert keys_at(location) == [field.name for field in fields(holder)]
        # The same behind the index of a list, which pydantic puts between the keys.
        assert keys_at([*location, 0]) == keys_at(location)
    assert {"goal", "clutter", "planner", "rates"} <= set(keys_at([]))
    assert "config" not in keys_at([])
    assert keys_at(["goal"]) == keys_at(["clutter", "zones"]) == keys_at(["none"]) == []


def test_a_prior_map_is_checked_without_building_its_grid(tmp_path, monkeypatch):
    (tmp_path / "map.pgm").write_bytes(b"P5 4 1 255\n" + bytes([0, 255, 120, 180]))
    file = tmp_path / "map.yaml"
    file.write_text("image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n")

    def refused(*_):
        raise AssertionError("the loader built a grid")

    monkeypatch.setattr(GridMap, "of", refused)
    assert load("open", [f'slam.prior_map="{file}"']).config.slam.prior_map == str(file)
    (tmp_path / "map.pgm").write_bytes(b"P5 4 1 255\n")
    assert "cut off" in error_of("open", [f'slam.prior_map="{file}"'])


def test_nearest_names_what_stands_there():
    floor = build_world(load("experiment")).floor
    distance, name = nearest(floor, np.array([2.05, 0.55 + 0.19 + 0.05]))
    assert name == "obstacle_02_drum" and distance == pytest.approx(0.05, abs=1e-9)


def test_every_planner_named_can_be_chosen():
    for name in planner_names():
        assert load("open", planner=name).config.planner.name == name


def test_zones_and_payload_survive_being_written_and_read(tmp_path):
    file = tmp_path / "zones.toml"
    file.write_text(
        'arena = "open"\nstart = [0, 0, 0]\ngoal = [1, 0]\n'
        "[[tracks.zones]]\nmin_m = [0, 0]\nmax_m = [1, 2]\nfriction = 0.2\n"
        "[payload]\nmass_kg = 3.0\n"
    )
    wanted = load(file)
    assert wanted.config.tracks.zones[0].friction == 0.2
    again = tmp_path / "again.toml"
    again.write_text(to_toml(wanted))
    assert load(again, [f'name="{wanted.name}"']).config == wanted.config
    with pytest.raises(InputError, match="min_m"):
        load(file, ["tracks.zones.0.min_m=[5, 5]"])


def test_keys_of_older_files_are_read_as_what_they_are_now(tmp_path):
    file = tmp_path / "old.toml"
    file.write_text(
        'arena = "open"\nstart = [1.0, 1.0, 0.0]\ngoal = [3.0, 1.0]\n'
        "[tracker]\nmax_speed_mps = 0.3\nmonitor_margin_m = 0.02\nstuck_s = 2.0\ncreep_mps = 0.2\n"
    )
    config = load(file, ["tracker.max_accel_mps2=0.5"]).config
    assert (config.drive.max_speed_mps, config.drive.max_accel_mps2) == (0.3, 0.5)
    assert (config.monitor.margin_m, config.recovery.stuck_s) == (0.02, 2.0)
    assert config.tracker.creep_mps == 0.2
    assert load(file, ["drive.max_speed_mps=0.4"]).config.drive.max_speed_mps == 0.4


def test_an_old_key_beside_its_new_one_is_refused(tmp_path):
    file = tmp_path / "both.toml"
    file.write_text(
        'arena = "open"\nstart = [1.0, 1.0, 0.0]\ngoal = [3.0, 1.0]\n'
        "[tracker]\nmax_speed_mps = 0.3\n[drive]\nmax_speed_mps = 0.4\n"
    )
    with pytest.raises(InputError, match=r"tracker\.max_speed_mps is now drive\.max_speed_mps"):
        load(file)


def test_every_old_key_leads_to_a_setting_that_exists():
    for new in MOVED_KEYS.values():
        section, key = new.split(".")
        assert hasattr(getattr(Config(), section), key)


def test_a_whole_file_saved_by_an_older_version_is_the_same_run():
    """With all keys of that time, at the places of that time."""
    file = Path(__file__).parent / "data" / "saved_before_the_split.toml"
    assert load(file).config == load("experiment").config


@pytest.mark.parametrize(
    ("override", "text"),
    [
        ("separation.decel_mps2=5.0", "separation.decel_mps2 is above drive.max_brake_mps2"),
        ("recovery.back_off_mps=0.6", "recovery.back_off_mps is above drive.max_speed_mps"),
        ("drive.max_brake_mps2=0.5", "drive.max_brake_mps2 is below drive.max_decel_mps2"),
    ],
)
def test_limits_that_do_not_agree_are_refused(override, text):
    with pytest.raises(InputError, match=text):
        load("open", [override])


def test_nothing_in_a_scenario_is_too_deep_too_long_or_endless(tmp_path):
    deep, name = "[" * 3000 + "1" + "]" * 3000, "a." * 3000 + "b"
    for override, expected in (
        (f"goal={deep}", "more than 64 deep"),
        (f"{name}=1", "more than 64 parts"),
        ("x=" + "[" * 80 + "]" * 80, "more than 64 deep"),
        ("seed=0x" + "f" * 400, "seed: must be less than"),
        ("seed=0x" + "f" * 4000, "bits of an integer"),
        ("goal=[0x" + "f" * 400 + ", 0]", "goal.0: must be a finite number"),
        ("goal=[1e999, 0]", "goal.0: must be a finite number"),
        ("start=[0, 0, 1e300]", "start.2: must be less than"),
        ("n" * 300 + "=1", "length of the key"),
        ("title='" + "n" * 300 + "'", "title: "),
        ("description='" + "n" * 20_000 + "'", "length of a text"),
        ("slam.grain_m=1e-300", "slam.grain_m: must be greater"),
        ("smoother.extra_room_m=1e-300", "smoother.extra_room_m: must be 0 or at least 1e-09"),
        ("imu.gyro_bias_radps=1000", "imu.gyro_bias_radps: must be less"),
    ):
        error = error_of("experiment", [override])
        assert expected in error and len(error) <= 1000 and error.isprintable(), error
    file = tmp_path / "x.toml"
    for text, expected in (
        (f"goal = {deep}", "more than 64 deep"),
        (f"{name} = 1", "a key has more than 64 parts"),
        ("x = 0x" + "f" * 400_000, "bits of an integer"),
        ("x = 1" + "0" * 5000, "not usable TOML"),
        ("# " + "x" * 2**20, "larger than 1 MiB"),
        ("\x1b[2J = 1", "not valid TOML"),
        ('"\\u001b[2J" = 1', "unknown key"),
    ):
        file.write_text(text)
        error = error_of(file)
        assert expected in error and len(error) <= 1000 and error.isprintable(), error
    os.mkfifo(tmp_path / "fifo.toml")
    assert "not a regular file" in error_of(tmp_path / "fifo.toml")
    assert "not a regular file" in error_of("/dev/zero")
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    assert "symbolic links" in error_of(tmp_path / "loop.toml")
    assert "too long" in error_of("n" * 5000 + ".toml")


def test_every_file_behind_a_scenario_counts_as_read(tmp_path):
    (tmp_path / "parts").mkdir()
    for name in ("room.pgm", "parts/wall.stl", "parts/part.xml", "ground.png"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "parts" / "part.xml").write_text('<mujoco><mesh file="wall.stl"/></mujoco>')
    (tmp_path / "room.yaml").write_text("\"image\": 'room.pgm' # a comment\nresolution: 1\n")
    (tmp_path / "arena.xml").write_text(
        '<mujoco><compiler meshdir="parts"/><include file="parts/part.xml"/></mujoco>'
    )
    found = files_behind(tmp_path / "arena.xml", "the arena")
    assert {path.name for path in found} == {"arena.xml", "part.xml", "wall.stl"}
    found = files_behind(tmp_path / "room.yaml", "the map")
    assert found[tmp_path / "room.pgm"] == "a file of the map"
    plain = input_files(load("experiment"), resolve("experiment"))
    assert {"experiment.xml", "experiment.toml", "tracked_ugv.xml"} <= {p.name for p in plain}


@given(st.binary(max_size=200), st.integers(0, 2000), st.integers(0, 60))
def test_a_damaged_file_is_refused_in_one_line(tmp_path_factory, noise, at, cut):
    whole = resolve("clutter").read_bytes()
    file = tmp_path_factory.mktemp("damaged") / "x.toml"
    file.write_bytes(whole[:at] + noise + whole[at + cut :])
    try:
        load(file)
    except InputError as error:
        assert str(error).isprintable() and len(str(error)) <= 1000
