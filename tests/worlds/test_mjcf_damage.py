"""Damaged arenas end in one line, never in a traceback or a crash of MuJoCo."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.worlds.arena import arena_path, build
from simloop.worlds.mjcf.scan import scan

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


@pytest.mark.parametrize(
    ("head", "geoms", "said"),
    [
        ("", f'<replicate count="3000">{"<site/>" * 2000}</replicate>', "number of <site>"),
        (
            "",
            '<replicate count="60"><replicate count="60"><camera/><camera/><camera/></replicate>'
            "</replicate>",
            "number of <camera>",
        ),
        (
            "",
            f'<replicate count="3999">{"<frame/><site/><light/>" * 2}</replicate>' * 9,
            "number of <frame>",
        ),
        (f"<default>{'<default/>' * 1000}</default>", "", "number of <default>"),
        (f"<asset>{'<material/>' * 10_001}</asset>", "", "number of <material>"),
        ('<custom><numeric name="q" size="1500000000" data="0"/></custom>', "", "numbers of"),
        (f"<custom>{'<text/>' * 10_001}</custom>", "", "number of <text>"),
    ],
)
def test_elements_and_their_copies_are_counted_before_any_is_made(folder, head, geoms, said):
    file = folder / "many.xml"
    file.write_text(f"<mujoco>{head}<worldbody>{geoms}</worldbody></mujoco>")
    with pytest.raises(InputError, match=said):
        scan(file)
