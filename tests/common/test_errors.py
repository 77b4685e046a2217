"""The one line for wrong input."""

from __future__ import annotations

from simloop.common.errors import LONGEST_MESSAGE, InputError, did_you_mean


def test_a_message_is_one_line():
    assert str(InputError("a file:\n  is   wrong")) == "a file: is wrong"


def test_an_unknown_name_gets_the_nearest_choice_and_all_choices():
    assert did_you_mean("opn", ["trap", "open"]) == " (did you mean 'open'?); choices: open, trap"
    assert did_you_mean("zzz", ["trap", "open"]) == "; choices: open, trap"
    assert did_you_mean("zzz", []) == "; choices: none"


def test_a_message_shows_control_characters_and_has_an_end():
    assert str(InputError("name \x1b[31mred\x07: unknown")) == r"name \x1b[31mred\x07: unknown"
    long = str(InputError("start " + "x" * 10_000_000 + " end"))
    assert len(long) <= LONGEST_MESSAGE and long.startswith("start") and long.endswith("end")
