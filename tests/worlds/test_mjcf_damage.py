"""Damaged arenas end in one line, never in a traceback or a crash of MuJoCo."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.worlds.arena import arena_path, build

TEXT = arena_path("experiment").read_text()
PLACES = [match.span() for match in re.finditer(r'"[^"]*"|<\w+|\w+=|/>', TEXT)]
WORDS = [
    '""', '"0"', '"-1"', '"nan"', '"1e300"', '"2147483648"', '"0 0 0"', '"mesh"', '"plane"',
    "<geom", "<body", "<replicate", "<include", "<default", "type=", "size=",
    "file=", "mesh=", "/>", ">", "",
]  # fmt: skip
damage = st.lists(
    st.tuples(st.sampled_from(PLACES), st.sampled_from(WORDS)),
    min_size=1,
    max_size=3,
    unique_by=lambda one: one[0],
)


def check_damaged(folder, changes):
    text = TEXT
    for (start, end), word in sorted(changes, reverse=True):
        text = text[:start] + word + text[end:]
    file = folder / "room.xml"
    file.write_text(text)
    try:
        assert build(file).body("base_link").subtreemass == pytest.approx(10.0)
    except InputError as error:
        assert str(error).isprintable()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("damaged")


@settings(max_examples=60, deadline=None)
@given(changes=damage)
def test_a_damaged_arena_is_built_or_refused_in_one_line(folder, changes):
    check_damaged(folder, changes)


@pytest.mark.slow
@settings(max_examples=5000, deadline=None)
@given(changes=damage)
def test_many_damaged_arenas_are_built_or_refused_in_one_line(folder, changes):
    check_damaged(folder, changes)
