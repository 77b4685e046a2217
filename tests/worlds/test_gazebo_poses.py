"""Models stand where Gazebo puts them: by frames, states, populations and includes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.gazebo import box, centres, model, pose, read, world
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from simloop.common.errors import InputError
from simloop.scenario.build import build_world
from simloop.scenario.load import load
from simloop.worlds.gazebo.values import pose_of
from simloop.worlds.gazebo.xml_tree import parse_tree

CRATE = box(0.4, 0.2, 1.0)
ANGLE = st.floats(-7.0, 7.0)


@given(ANGLE, ANGLE, ANGLE)
def test_the_three_ways_to_write_a_rotation_agree(roll, pitch, yaw):
    turned = Rotation.from_euler("xyz", [roll, pitch, yaw])
    degrees = np.degrees([roll, pitch, yaw])
    x, y, z, w = 1.5 * turned.as_quat()  # its length is corrected
    for attributes, values in (
        ("", (roll, pitch, yaw)),
        ("degrees='true'", degrees),
        ("degrees='1' rotation_format='euler_rpy'", degrees),
        ("rotation_format='quat_xyzw'", (x, y, z, w)),
    ):
        text = (
            f"<model>{pose('1 2 3 ' + ' '.join(map(repr, map(float, values))), attributes)}</model>"
        )
        read_pose = pose_of("here", parse_tree(text.encode(), "here"))
        assert read_pose[:3, :3] == pytest.approx(turned.as_matrix(), abs=1e-9)
        assert read_pose[:3, 3] == pytest.approx([1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<pose rotation_format='quat_xyzw'>0 0 0 0 0 0 0</pose>", "length 0, not 1"),
        ("<pose rotation_format='matrix'>0 0 0 0 0 0</pose>", "choices: euler_rpy"),
        ("<pose degrees='yes'>0 0 0 0 0 0</pose>", "must be true or false"),
        ("<pose degrees='1' rotation_format='quat_xyzw'>0 0 0 0 0 0 1</pose>", "in degrees"),
        ("<pose>1 2 3 4 5 6 7</pose>", "not 6 numbers"),
        ("<pose>1e9 0 0 0 0 0</pose>", "not 6 numbers"),
        ("<pose>1_0 0 0 0 0 0</pose>", "not 6 numbers"),
        ("<pose relative_to='nowhere'>1 0 0 0 0 0</pose>", "relative to 'nowhere'"),
        ("<pose relative_to='m'>1 0 0 0 0 0</pose>", "frame 'm' is relative to itself"),
    ],
)
def test_a_pose_that_cannot_be_told_is_refused_by_the_models_name(tmp_path, text, told):
    with pytest.raises(InputError, match=told):
        read(tmp_path, world(model("m", CRATE, text)))


@pytest.mark.parametrize("text", ["", "<pose/>", "<pose> </pose>", "<pose frame=''/>"])
def test_a_missing_or_empty_pose_moves_nothing(tmp_path, text):
    assert centres(read(tmp_path, world(model("m", CRATE, text)))).tolist() == [[0.0, 0.0]]


def test_frames_lead_to_each_other_in_any_order(tmp_path):
    text = world(
        model("last", CRATE, pose("0 1 0 0 0 0", "relative_to='corner'")),
        "<frame name='corner' attached_to='first::tip'><pose>1 0 0 0 0 0</pose></frame>",
        "<model name='first'><static>1</static><pose>2 0 0 0 0 1.5707963267948966</pose>"
        f"<link name='base'>{CRATE}</link>"
        "<frame name='tip' attached_to='elbow'><pose>1 0 0 0 0 0</pose></frame>"
        "<joint name='elbow' type='fixed'><parent>base</parent><child>arm</child></joint>"
        "<link name='arm'><pose relative_to='base'>1 0 0 0 0 0</pose></link></model>",
    )
    # The tip is 2 m ahead of first, which looks along y: (2, 2). The corner is at (2, 3).
    assert centres(read(tmp_path, text)) == pytest.approx(np.array([[1.0, 3.0], [2.0, 0.0]]))


def test_a_placement_frame_is_what_the_pose_places(tmp_path):
    tip = "<frame name='tip'><pose>1 0 0 0 0 1.5707963267948966</pose></frame>"
    at = pose("3 0 0 0 0 0")
    for attributes in ("placement_frame='tip'", "placement_frame='in::tip'"):
        inner = f"<model name='in'>{tip}</model>" if "::" in attributes else tip
        layout = read(tmp_path, world(model("m", CRATE, at + inner, attributes)))
        # The tip looks along x, so the model looks along -y from 1 m above the tip.
        assert centres(layout) == pytest.approx(np.array([[3.0, 1.0]]))
        assert layout.obstacles[0].yaw_rad == pytest.approx(-0.5 * math.pi)


def test_poses_of_nested_models_links_and_collisions_add_up(tmp_path):
    inner = model("in", box(1, 0.2, 1, pose("0 1 0 0 0 0")), pose("1 0 0 0 0 1.5707963267948966"))
    layout = read(tmp_path, world(f"<model name='m'>{pose('0 2 0 0 0 0')}{inner}</model>"))
    assert centres(layout) == pytest.approx(np.array([[0.0, 2.0]]))


STATE = """<state world_name='w'>
<insertions><model name='new'><static>1</static><pose>5 5 0 0 0 0</pose>
<link name='l'>{crate}</link></model></insertions><deletions><name>gone</name></deletions>
<model name='moved'><pose>1 1 0 0 0 0</pose><scale>2 3 1</scale></model>
<model name='linked'><pose>2 2 0 0 0 0</pose><link name='l'><pose>3 2 0 0 0 0</pose></link></model>
<model name='nest'><pose>0 0 0 0 0 0</pose><model name='in'><pose>4 4 0 0 0 0</pose></model></model>
<model name='ghost'><pose>9 9 0 0 0 0</pose></model>
</state>"""


def test_a_saved_state_wins(tmp_path):
    names = ("moved", "linked", "gone", "still")
    models = [model(name, CRATE, pose(f"{-k} -5 0 0 0 0")) for k, name in enumerate(names, 1)]
    nest = f"<model name='nest'>{model('in', CRATE, pose('1 0 0 0 0 0'))}</model>"
    layout = read(tmp_path, world(STATE.format(crate=CRATE), *models, nest))
    expected = np.array([[-4, -5], [1, 1], [3, 2], [4, 4], [5, 5]], float)
    assert centres(layout) == pytest.approx(expected)
    sizes = {one.position_m: one.size_m for one in layout.obstacles}
    assert sizes[1.0, 1.0] == pytest.approx((0.8, 0.6))  # twice and three times as large
    assert any("ghost" in line for line in layout.notes)


def test_a_grid_and_a_line_of_models_stand_where_gazebo_puts_them(tmp_path):
    can = model("can", CRATE, pose("7 7 0 0 0 0"))  # its own pose does not count
    grid = f"""<population name='p'>{can}<pose>1 2 0 0 0 0</pose><model_count>99</model_count>
    <distribution><type>grid</type><rows>2</rows><cols>3</cols><step>2 1 0</step></distribution>
    </population>"""
    expected = [[x, y] for x in (-1.0, 1.0, 3.0) for y in (1.5, 2.5)]
    assert centres(read(tmp_path, world(grid))).tolist() == expected
    line = f"""<population name='p'>{can}<pose>0 0 0 0 0 0</pose><box><size>4 2 .01</size></box>
    <model_count>4</model_count><distribution><type>linear-x</type></distribution></population>"""
    assert centres(read(tmp_path, world(line))).tolist() == [[x, 0.0] for x in (-2, -1, 0, 1)]
    for kind in ("random", "uniform", "linear-q"):
        with pytest.raises(InputError, match=f"population p: distribution '{kind}'"):
            read(tmp_path, world(line.replace("linear-x", kind)))
    with pytest.raises(InputError, match="population p: models: 10,000,000,000; at most"):
        read(
            tmp_path,
            world(grid.replace("<rows>2<", "<rows>1e5<").replace("<cols>3<", "<cols>1e5<")),
        )


def test_an_included_model_comes_from_a_named_folder(tmp_path, monkeypatch):
    oak = tmp_path / "models" / "oak"
    oak.mkdir(parents=True)
    (oak / "model.config").write_text(
        "<model><sdf version='1.9'>old.sdf</sdf><sdf version='1.10'>new.sdf</sdf></model>"
    )
    (oak / "new.sdf").write_text(
        f"<sdf version='1.10'>{model('tree', CRATE, pose('9 9 0 0 0 0'))}</sdf>"
    )
    room = tmp_path / "room"
    room.mkdir()
    include = "<include><uri>{}</uri><name>a</name><pose>2 1 0 0 0 0</pose></include>"
    (room / "s.toml").write_text('arena = "some.world"\nstart = [0, 0, 0]\ngoal = [1.0, 0.0]\n')
    for uri in ("model://oak", "https://fuel.gazebosim.org/1.0/x/models/oak", "file://oak", "oak"):
        layout = read(room, world(include.format(uri)), model_path=[tmp_path / "models"])
        assert centres(layout).tolist() == [[2.0, 1.0]]
        with pytest.raises(InputError, match=r"--model-path DIR"):
            read(room, world(include.format(uri)))
    monkeypatch.setenv("GAZEBO_MODEL_PATH", f"/nowhere:{tmp_path / 'models'}")
    scenario = load(room / "s.toml")
    assert scenario.model_path == (str(tmp_path / "models"),)  # a saved scenario finds it again
    assert len(build_world(scenario).floor.sections) == 1
    monkeypatch.delenv("GAZEBO_MODEL_PATH")
    named = load(room / "s.toml", model_path=[tmp_path / "models"])
    assert named.model_path == scenario.model_path
    with pytest.raises(InputError, match="no such folder"):
        load(room / "s.toml", model_path=[tmp_path / "none"])
    with pytest.raises(InputError, match="only for a Gazebo world"):
        load("open", model_path=[tmp_path])


def test_only_files_in_named_folders_are_read(tmp_path):
    secret = tmp_path / "secret"
    secret.mkdir()
    (secret / "model.sdf").write_text(f"<sdf version='1.9'>{model('m', CRATE)}</sdf>")
    room = tmp_path / "room"
    room.mkdir()
    for uri in (
        f"file://{secret}",
        str(secret),
        "../secret",
        "model://../secret",
        "model://a/../../secret",
    ):
        with pytest.raises(InputError, match=r"outside the world's folder"):
            read(room, world(f"<include><uri>{uri}</uri></include>"))
    for uri in ("", "model://", "gopher://x", "http://[", "model://" + "x" * 9000, "model://%00"):
        with pytest.raises(InputError):
            read(room, world(f"<include><uri>{uri}</uri></include>"))


def test_a_model_that_includes_itself_ends_in_one_line(tmp_path):
    (tmp_path / "me").mkdir()
    again = "<include><uri>model://me</uri></include>"
    (tmp_path / "me" / "model.sdf").write_text(
        f"<sdf version='1.9'><model name='m'>{again}{again}</model></sdf>"
    )
    with pytest.raises(InputError, match="depth of models"):
        read(tmp_path, world(again))


def test_sun_and_ground_plane_are_left_out_and_told(tmp_path):
    includes = "".join(
        f"<include><uri>{uri}</uri></include>"
        for uri in (
            "model://sun",
            "model://ground_plane/",
            "https://fuel.x.org/1.0/O/models/Ground%20Plane",
        )
    )
    layout = read(tmp_path, world(model("m", CRATE), includes))
    assert len(layout.obstacles) == 1
    assert [line for line in layout.notes if "ground_plane" in line and "sun" in line]
