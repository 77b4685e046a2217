"""Hostile and broken SDF files end in one line, before they take time or memory."""

from __future__ import annotations

import io
import re

import pytest
from helpers.gazebo import box, collision, model, pose, read, world
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from typer.testing import CliRunner

from simloop.cli import main
from simloop.cli.world import build_shown
from simloop.common.errors import InputError
from simloop.scenario.load import load
from simloop.worlds.gazebo_world import read_sdf

CRATE = model("m", box(1, 1, 1))
BOMB = "<!DOCTYPE l [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;&a;&a;'>]>"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-be"])
def test_entities_are_refused_in_any_encoding(tmp_path, encoding):
    file = tmp_path / "x.sdf"
    text = f"\ufeff{BOMB}{world(CRATE)}" if encoding == "utf-16-be" else BOMB + world(CRATE)
    file.write_bytes(text.encode(encoding))
    with pytest.raises(InputError, match=r"x\.sdf: defines a document type or its own entities"):
        read_sdf(file)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("<sdf>" + 5000 * "<model>" + 5000 * "</model>" + "</sdf>", "depth of nested elements: 65"),
        (world(20 * "<model name='m'>" + 20 * "</model>"), "depth of models in models: 17"),
        (world(51 * "<model/>"), "models, links, frames and joints: 51; at most 50"),
        (world(model("m", 50 * box(1, 1, 1))), "models, links and shapes: 51; at most 50"),
        (world(51 * "<frame name='f'/>"), "frames: 51; at most 50"),
        ("<sdf>" + 999 * "<a/>" + "</sdf>", "elements: 901; at most 900"),
        ("<gazebo version='1.0'><world/></gazebo>", "version 1.2 or older"),
        ("<sdf/>", "not a Gazebo world"),
        (world(CRATE)[:-9], "not XML"),
        ("<?xml version='1.0' encoding='nonsense'?>" + world(CRATE), "not XML"),
    ],
)
def test_a_file_that_is_too_large_or_no_world_is_refused(tmp_path, monkeypatch, text, told):
    monkeypatch.setattr("simloop.worlds.gazebo.models.SHAPES", 50)
    monkeypatch.setattr("simloop.worlds.gazebo.xml_tree.ELEMENTS", 900)
    with pytest.raises(InputError, match=told):
        read(tmp_path, text)


def test_a_world_of_a_kilometre_needs_bounds(tmp_path):
    far = model("far", box(1, 1, 1), pose("900 0 0 0 0 0"))
    with pytest.raises(
        InputError, match=r"side of the world \(see bounds_m\): 90\d m; at most 500 m"
    ):
        read(tmp_path, world(CRATE, far), bounds=None)
    assert len(read(tmp_path, world(CRATE, far)).obstacles) == 2
    floor = model("floor", box(900, 900, 0.1), pose("0 0 -0.05 0 0 0"))
    assert read(tmp_path, world(CRATE, floor), bounds=None).bounds_m == (-10.5, -10.5, 10.5, 10.5)


def test_a_visuals_content_takes_no_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("simloop.worlds.gazebo.xml_tree.ELEMENTS", 900)
    seen = "<visual name='v'>" + 999 * "<a/>" + "</visual>"
    layout = read(tmp_path, world(model("m", box(1, 1, 1) + seen)))
    assert len(layout.obstacles) == 1


def test_a_name_cannot_move_the_cursor(tmp_path):
    with pytest.raises(InputError) as caught:
        read(
            tmp_path,
            world(model("a&#x202e;b&#x9b;31m", "<collision><geometry><x/></geometry></collision>")),
        )
    assert str(caught.value).isprintable() and "\\u202e" in str(caught.value)


def test_only_the_first_world_is_read_and_that_is_told(tmp_path):
    text = world(CRATE).replace("</sdf>", f"<world name='second'>{CRATE}{CRATE}</world></sdf>")
    layout = read(tmp_path, text)
    assert len(layout.obstacles) == 1 and "second" in layout.notes[0]


TRIANGLE = "<point>0 0</point><point>1 0</point><point>0 1</point>"
WHOLE = world(
    "<frame name='f'><pose>1 0 0 0 0 0</pose></frame>",
    model("a", box(1, 1, 1), pose("1 2 3 4 5 6", "relative_to='f' degrees='true'")),
    model("b", collision("<capsule><radius>1</radius><length>2</length></capsule>")),
    model("c", collision(f"<polyline>{TRIANGLE}<height>1</height></polyline>")),
    "<state><model name='a'><pose>1 1 1 0 0 0</pose><scale>1 1 1</scale></model></state>",
)
PIECES = re.findall(r"<[^>]*>|[^<>\s]+|\s+", WHOLE)
ODD = [
    "",
    "<pose>",
    "</pose>",
    "nan",
    "1e999",
    "-1",
    "0",
    "1e5",
    "f",
    "a",
    "<box/>",
    "<state>",
    "\0",
    "&x;",
]


@pytest.mark.parametrize("count", [30, pytest.param(20_000, marks=pytest.mark.slow)])
def test_mutated_worlds_are_read_or_refused_in_one_line(tmp_path, count):
    @given(
        st.lists(
            st.tuples(st.integers(0, len(PIECES) - 1), st.sampled_from(ODD + PIECES)), max_size=6
        )
    )
    @settings(max_examples=count, deadline=None)
    def check(changes):
        pieces = list(PIECES)
        for place, piece in changes:
            pieces[place] = piece
        try:
            read(tmp_path, "".join(pieces))
        except InputError as error:
            assert "\n" not in str(error)

    check()


def test_the_command_line_finds_models_and_says_what_is_left_out(tmp_path):
    (tmp_path / "models" / "oak").mkdir(parents=True)
    (tmp_path / "models" / "oak" / "model.sdf").write_text(f"<sdf version='1.9'>{CRATE}</sdf>")
    roof = model("roof", box(9, 9, 0.1), pose("0 0 3 0 0 0"))
    include = "<include><uri>model://oak</uri><pose>2 2 0 0 0 0</pose></include>"
    (tmp_path / "room.world").write_text(world(roof, include))
    scenario = tmp_path / "s.toml"
    scenario.write_text('arena = "room.world"\nstart = [0, 0, 0]\ngoal = [0.05, 0.0]\n')
    runner, command = CliRunner(), ["run", str(scenario), "--set", "goal=[99,0]"]
    refused = runner.invoke(main.app, command)
    assert "name the folder that has it: --model-path" in str(refused.exception)
    found = runner.invoke(main.app, [*command, "--model-path", str(tmp_path / "models")])
    assert "goal (99, 0) is outside the arena" in str(found.exception)
    wanted = load(scenario, model_path=[tmp_path / "models"])
    shown = io.StringIO()
    build_shown(wanted, Console(file=shown, width=20))
    told = "what hangs higher than the robot (0.25 m) is left out: roof"
    assert f"note: room.world: {told}\n" in shown.getvalue()
