"""The reference of docs/scenarios.md lists the keys that there are, with their defaults."""

from __future__ import annotations

import re
from dataclasses import MISSING, fields
from pathlib import Path
from typing import get_args

import pytest

from simloop.config import Config
from simloop.physics.faults import Kind, keys_of
from simloop.scenario.load import load, parse_value
from simloop.scenario.scenario import Clutter, Scenario
from simloop.worlds.generators.generator import Generator
from simloop.worlds.movers.settings import Crowd, GoalMotion, Mover
from simloop.worlds.obstacles import Obstacle
from simloop.worlds.terrain import HeightField, Loose, Ramp, Step

PAGE = (Path(__file__).parents[2] / "docs" / "scenarios.md").read_text(encoding="utf-8")
TABLES = {
    "Top of the file": Scenario,
    "`[[obstacles]]`": Obstacle,
    "`[clutter]`": Clutter,
    "`[generator]`": Generator,
    "`[[terrain.ramps]]`": Ramp,
    "`[[terrain.steps]]`": Step,
    "`[terrain.height_field]`": HeightField,
    "`[[loose]]`": Loose,
    "`[[movers]]`": Mover,
    "`[crowd]`": Crowd,
    "`[goal_motion]`": GoalMotion,
}
OWN_TABLES = {"obstacles", "clutter", "generator", "terrain", "loose", "movers", "crowd"}
OWN_TABLES |= {"goal_motion", "faults", "config"}


def listed(heading):
    """Key -> default, as text, of the table under a heading."""
    text = PAGE.split(f"### {heading}\n")[1].split("\n#")[0]
    return dict(re.findall(r"^\| `(\w+)` \| [^|]*\| ([^|]*?) \|", text, re.MULTILINE))


@pytest.mark.parametrize("heading", TABLES)
def test_every_key_is_listed_with_its_default(heading):
    holder, found = TABLES[heading], listed(heading)
    tables = OWN_TABLES if holder is Scenario else set()
    expected = {field.name: field.default for field in fields(holder) if field.name not in tables}
    assert set(found) == set(expected)
    for key, default in expected.items():
        if default is MISSING:
            assert found[key] == "required", key
        elif default is None:
            assert found[key] == "none", key
        else:
            value = parse_value(found[key].strip("`"), key)
            assert (tuple(value) if isinstance(value, list) else value) == default, key


@pytest.mark.parametrize("block", re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL))
def test_the_examples_are_valid(block, tmp_path):
    ends = "" if "start =" in block else "start = [0.0, 0.0, 0.0]\ngoal = [3.0, 2.5]\n"
    (tmp_path / "mine.toml").write_text(ends + block)
    load(tmp_path / "mine.toml")


def test_every_table_of_a_world_is_in_the_reference():
    headings = " ".join(re.findall(r"^### (.*)$", PAGE, re.MULTILINE))
    for table in OWN_TABLES - {"faults", "config"}:
        assert f"[{table}]" in headings or f"[{table}." in headings
    for shown in ("steps", "ramps", "height_field"):
        assert f"terrain.{shown}]" in headings


def test_every_kind_of_fault_is_listed_with_its_keys():
    text = PAGE.split("### `[[faults]]`\n")[1].split("\n#")[0]
    rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]*)\| [^|]*\|$", text, re.MULTILINE))
    assert set(rows) == set(get_args(Kind))
    for kind in rows:
        assert all(f"`{key}`" in rows[kind] for key in keys_of(kind)), kind


def test_every_section_of_the_settings_is_named():
    text = PAGE.split("The sections of the settings are")[1].split("describes each key")[0]
    named = set(re.findall(r"`(\w+)`", text))
    assert named == {field.name for field in fields(Config)}
