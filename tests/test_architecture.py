"""The rules that the layout keeps, checked by reading the code itself."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import simloop
from simloop import messages
from simloop.robot import Robot

PACKAGE = Path(simloop.__file__).parent
ROOT = PACKAGE.parent
# The robot's own software, by package and front door: none of it may know the truth.
ROBOT = (
    "robot",
    "localiser",
    "navigation",
    "perception",
    "control",
    "ekf",
    "slam_grid",
    "tlbo_planner",
    "tracker",
    "planners",
    "mapping",
    "estimation",
    "graph_slam",
)
TRUTH = ("truth", "physics", "worlds", "scenario", "evaluation", "simulation", "sensors", "loop")
MUJOCO = ("physics", "worlds", "scenario", "certify", "recording")
RERUN = ("recording", "replay")
# Wall time is measured here and reported; no decision reads it.
CLOCK = ("loop.py", "common/profiler.py", "replay/", "benchmarks/")


def modules() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def name_of(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def within(path: Path, rooms: tuple[str, ...]) -> bool:
    """Whether a module is one of these front doors or lies in one of these packages."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py") in rooms


def imports(path: Path, *, top_level_only: bool = False) -> set[str]:
    """Dotted names that a file imports."""
    tree = ast.parse(path.read_text())
    nodes = tree.body if top_level_only else ast.walk(tree)
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def functions(path: Path) -> list[ast.FunctionDef]:
    return [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.FunctionDef)]


def test_imports_keep_the_contracts():
    command = [str(Path(sys.executable).with_name("lint-imports")), "--no-cache"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("path", [p for p in modules() if within(p, ROBOT)], ids=name_of)
def test_ground_truth_never_reaches_the_robots_packages(path):
    names = imports(path)
    assert not {n for n in names if n.split(".")[0] == "mujoco"}
    assert not {n for n in names if n.startswith("simloop.") and n.split(".")[1] in TRUTH}
    words = {n.id for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Name)}
    assert not words & {"Truth", "TrackTruth", "LooseTruth", "Plant", "World"}


def test_every_front_door_and_package_of_the_robot_exists():
    present = {p.relative_to(PACKAGE).parts[0].removesuffix(".py") for p in modules()}
    assert set(ROBOT) | set(TRUTH) | set(MUJOCO) | set(RERUN) <= present


def test_the_robot_takes_sensor_messages_only():
    taken = inspect.signature(Robot.step).parameters
    assert [p.annotation for p in taken.values()][1:] == ["Readings"]
    assert [f.type for f in dataclasses.fields(messages.Readings)] == [
        "EncoderReading",
        "ImuReading",
        "LidarScan | None",
        "GoalReading | None",
        "DepthImage | None",
    ]


def test_only_the_simulators_side_imports_mujoco():
    users = [p for p in modules() if any(n.split(".")[0] == "mujoco" for n in imports(p))]
    assert users
    assert [name_of(p) for p in users if not within(p, MUJOCO)] == []


def test_rerun_is_imported_for_recordings_alone_and_lazily():
    users = [p for p in modules() if any(n.split(".")[0] == "rerun" for n in imports(p))]
    assert users
    assert [name_of(p) for p in users if not within(p, RERUN)] == []
    for path in users:
        at_once = imports(path, top_level_only=True)
        assert not any(n.split(".")[0] == "rerun" for n in at_once), path


@pytest.mark.parametrize("path", modules(), ids=name_of)
def test_no_wall_clock_and_no_global_random_numbers_in_decisions(path):
    text = path.read_text()
    if not name_of(path).startswith(CLOCK):
        assert "perf_counter" not in text
        assert "time.time" not in text
    assert "np.random.seed" not in text
    assert "import random" not in text


@pytest.mark.parametrize("path", modules(), ids=name_of)
def test_files_and_functions_stay_short(path):
    assert len(path.read_text().splitlines()) <= 400
    long = [f.name for f in functions(path) if f.end_lineno - f.lineno >= 60]
    assert long == []


def test_folders_stay_small():
    at_most = {PACKAGE: 14}
    for folder in {p.parent for p in modules()}:
        here = [p for p in folder.glob("*.py") if p.name != "__init__.py"]
        assert len(here) <= at_most.get(folder, 16), folder


def public_functions(path: Path) -> list[ast.FunctionDef]:
    """Functions and methods without a leading underscore, but for properties."""
    body = ast.parse(path.read_text()).body
    for holder in [n for n in body if isinstance(n, ast.ClassDef) and n.name[0] != "_"]:
        body = body + holder.body
    found = [n for n in body if isinstance(n, ast.FunctionDef) and n.name[0] != "_"]
    names = {f: {getattr(d, "id", getattr(d, "attr", "")) for d in f.decorator_list} for f in found}
    return [f for f in found if not names[f] & {"property", "setter", "overload"}]


@pytest.mark.parametrize("path", modules(), ids=name_of)
def test_public_functions_say_what_they_take_and_return(path):
    """Google style, with Args and Returns or Yields; with shapes, units and frames."""
    missing = []
    for function in public_functions(path):
        text, arguments = ast.get_docstring(function) or "", function.args
        taken = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
        taken = [a.arg for a in taken if a.arg not in ("self", "cls")]
        returns = function.returns
        nothing = returns is None or (isinstance(returns, ast.Constant) and returns.value is None)
        answers = nothing or "Returns:" in text or "Yields:" in text
        if not text or (taken and "Args:" not in text) or not answers:
            missing.append(function.name)
    assert missing == []


def test_no_test_imports_another_test():
    for path in (ROOT / "tests").rglob("*.py"):
        names = imports(path)
        assert not [n for n in names if n.split(".")[-1].startswith("test_")], path


def test_arrays_in_messages_cannot_be_written():
    fix = messages.PoseFix(0, np.zeros(3), np.eye(3), 1.0, True)
    with pytest.raises(ValueError, match="read-only"):
        fix.pose[0] = 1.0


def test_arrays_in_tuples_in_messages_cannot_be_written():
    polygon, nothing = np.zeros((3, 2)), np.zeros((0, 3))
    view = messages.WorldView(
        0, np.zeros(2), 0.05, np.zeros((0, 0), np.float32), nothing, np.zeros(4), (polygon,)
    )
    with pytest.raises(ValueError, match="read-only"):
        view.polygons_m[0][0, 0] = 1.0
