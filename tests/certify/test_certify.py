"""The certificate: every family holds, wrong figures fail, and the command reports both."""

from __future__ import annotations

import json
import math

import pytest

from simloop import certify
from simloop.certify.checks import Check, absolute, at_most, relative, verdict
from simloop.certify.rig import Rig
from simloop.certify.rig_parts import RADIUS_M
from simloop.cli.main import app

QUICK = ["straight", "payload", "zones", "loose", "steps", "ramps", "tipping", "braking", "shorted"]
SLOW = [name for name in certify.families() if name not in (*QUICK, "native")]


@pytest.mark.parametrize("name", QUICK + SLOW)
def test_every_check_of_a_family_holds(name):
    checks = list(certify.run([name]))
    assert checks
    assert [check for check in checks if not check.ok] == []


def test_native_friction_is_compared_and_does_not_count():
    checks = list(certify.run(["native"]))
    assert all(check.informative for check in checks)
    ratios = [check for check in checks if "spin ratio" in check.name]
    assert min(check.error for check in ratios) > 0.1
    assert certify.passed(checks)


def test_errors_are_what_they_say():
    assert relative("g", "n", 1.02, 1.0, 0.03).error == pytest.approx(0.02)
    assert not relative("g", "n", 0.96, 1.0, 0.03).ok
    assert absolute("g", "n", -0.1, 0.0, 0.2).error == pytest.approx(0.1)
    assert at_most("g", "n", 0.5, 1.0).ok
    assert at_most("g", "n", 1.5, 1.0).error == pytest.approx(0.5)
    assert not verdict("g", "n", True, False).ok


@pytest.mark.parametrize("make", [relative, absolute])
def test_a_nan_never_passes(make):
    assert not make("g", "n", math.nan, 1.0, 1e9).ok
    assert not at_most("g", "n", math.nan, 1.0).ok


def test_a_failed_check_fails_the_whole_and_an_informative_one_does_not():
    bad = Check("g", "n", 2.0, 1.0, 1.0, 0.1)
    assert not certify.passed([bad])
    assert certify.passed([Check("g", "n", 2.0, 1.0, 1.0, 0.1, informative=True)])
    assert certify.figures([bad])["ok"] is False


def test_a_wrong_friction_is_found_out():
    """The certificate is no tautology: a vehicle on other ground than said fails it."""
    bench = Rig(friction=0.6).build(own_friction=0.5)
    bench.hold(0.0, 1.0, volts=20.0)
    pull = float(bench.plant.tracks.track_force.sum())
    assert not relative("g", "n", pull, 0.6 * bench.weight_n, 0.02).ok


def test_the_command_writes_a_table_and_json(tmp_path, capsys):
    file = tmp_path / "certificate.json"
    code = app(["certify", "--only", "straight", "--json", str(file)], standalone_mode=False)
    assert code == 0
    figures = json.loads(file.read_text())
    assert figures["ok"] is True
    keys = {"name", "value", "expected", "error", "tolerance", "ok", "group"}
    assert keys <= set(figures["checks"][0])
    assert {"versions", "machine"} <= set(figures)
    assert "checks hold" in capsys.readouterr().out


def test_the_rigs_vehicle_has_the_radius_that_theory_is_given():
    assert Rig().build(settle_s=0.0).plant.sprocket_radius_m == RADIUS_M
