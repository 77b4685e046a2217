"""The one line for wrong input."""

from __future__ import annotations

from simloop.common.errors import InputError, did_you_mean


def test_a_message_is_one_line():
    assert str(InputError("a file:\n  is   wrong")) == "a file: is wrong"


def test_an_unknown_name_gets_the_nearest_choice_and_all_choices():
    assert did_you_mean("opn", ["trap", "open"]) == " (did you mean 'open'?); choices: open, trap"
    assert did_you_mean("zzz", ["trap", "open"]) == "; choices: open, trap"
    assert did_you_mean("zzz", []) == "; choices: none"
