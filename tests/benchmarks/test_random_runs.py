"""Random short runs of the whole loop: they are drawn from a number, and none of them fails."""

from __future__ import annotations

import shlex

import pytest

from simloop.benchmarks.random_runs import Case, draw_case, numbers, run_case
from simloop.config import Config
from simloop.planners.registry import available

QUICK = range(3)


def failures(chosen, seed=0):
    """Try runs; return the failures with the commands that repeat them."""
    found = {}
    for number in chosen:
        case = draw_case(seed, number)
        result = run_case(case)
        if result.failure:
            found[case.command()] = result.failure
    return found


def test_a_run_is_drawn_from_its_number_alone():
    assert draw_case(0, 7) == draw_case(0, 7)
    assert len({draw_case(0, number) for number in range(50)}) == 50
    assert draw_case(0, 7) != draw_case(1, 7)


def test_the_command_repeats_the_run():
    case = draw_case(0, 3)
    program, command, scenario, flag, seed, *sets = shlex.split(case.command())
    assert (program, command, scenario) == ("simloop", "run", case.scenario)
    assert (flag, int(seed)) == ("--seed", case.seed)
    assert tuple(sets[1::2]) == case.overrides and set(sets[::2]) == {"--set"}


def test_every_numeric_setting_has_limits_that_hold_its_default():
    known = numbers()
    assert len(known) > 80
    for key, (default, least, most, _) in known.items():
        assert least <= default <= most < float("inf"), key
        section, _, name = key.partition(".")
        assert getattr(getattr(Config(), section), name) == default


def test_all_worlds_faults_and_planners_come_up():
    texts = [" ".join(draw_case(0, number).overrides) for number in range(2000)]
    for word in (
        "barn",
        "forest",
        "rooms",
        "maze",
        "gaps",
        "utrap",
        "ell",
        "kidnapped",
        "glass",
        "crowd=",
        "goal_motion=",
        "camera.enabled",
        *(f"={name}" for name in available()),
    ):
        assert any(word in text for text in texts), word  # fmt: skip


def test_a_few_random_runs():
    assert failures(QUICK) == {}


@pytest.mark.slow
def test_some_tens_of_random_runs():
    assert failures(range(1000, 1060)) == {}


@pytest.mark.slow
def test_every_numeric_setting_at_both_of_its_limits():
    found = {}
    for k, (key, (_, least, most, whole)) in enumerate(sorted(numbers().items())):
        for value in (least, most):
            text = f"{key}={round(value) if whole else repr(value)}"
            overrides = ("time_limit_s=2.5", text, "camera.enabled=true")
            result = run_case(Case("low" if k % 2 else "hall", 1, overrides), patience_s=30.0)
            if result.failure:
                found[text] = result.failure
    assert found == {}
