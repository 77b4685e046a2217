"""The fixture for tests of one's own, used as a stranger would."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest_plugins = ["pytester"]

OWN = """
pytest_plugins = ["simloop.campaign.pytest_plugin"]

def test_reaches(simloop_run):
    simloop_run("open", seed=1, overrides=["goal=[1.0,0.0]"]).assert_reached(within_s=20)

def test_too_slow(simloop_run):
    simloop_run("open", overrides=["goal=[1.0,0.0]"]).assert_reached(within_s=0.5)

def test_never(simloop_run):
    simloop_run("open", overrides=["time_limit_s=0.2"]).assert_reached()
"""


def test_three_lines_make_a_regression_test(pytester: pytest.Pytester):
    pytester.makepyfile(OWN)
    result = pytester.runpytest_subprocess("-p", "no:cacheprovider", "-p", "no:simloop")
    result.assert_outcomes(passed=1, failed=2)
    result.stdout.fnmatch_lines_random(
        [
            "*reached after * s, not within 0.5 s*",
            "*timeout after 0.2 s, *m from the goal*",
            "*again: simloop run open --seed 0 --set time_limit_s=0.2*",
            "*recorded: rerun *.rrd*",
        ]
    )


def test_the_plugin_alone_imports_nothing_slow():
    code = (
        "import simloop.campaign.pytest_plugin, sys; "
        "print([m for m in ('mujoco', 'numba', 'numpy') if m in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert ran.stdout.strip() == "[]"
