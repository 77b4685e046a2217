"""Lines that the architecture draws, held by reading the code itself."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import numpy as np
import pytest

import simloop
from simloop import messages
from simloop.robot import Robot

PACKAGE = Path(simloop.__file__).parent
# The robot's own software: none of it may know the truth or the physics.
ROBOT = [
    "robot",
    "localiser",
    "ekf",
    "slam_grid",
    "tlbo_planner",
    "bezier",
    "elastic",
    "tracker",
    "monitor",
    "watchdog",
    "recovery",
    "distance_field",
]
TRUTH = {
    "plant",
    "arena",
    "world",
    "floor_plan",
    "metrics",
    "loop",
    "sensors",
    "tracks",
    "faults",
    "health_account",
    "depth_camera",
    "shortest",
    "footprint",
    "crowd",
    "motion",
}
CLOCK = {
    "loop",
    "profiler",
    "bench_loop",
    "bench_planners",
    "cli",
    "report",
    "warmup",
    "session",
    "trials",
    "bench_slam",
}


def modules():
    return sorted(PACKAGE.rglob("*.py"))


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


def robot_files() -> list[Path]:
    """The robot's modules and all that they import of the package, to the end."""
    seen: set[Path] = set()
    todo = [PACKAGE / f"{name}.py" for name in ROBOT] + sorted((PACKAGE / "planners").glob("*.py"))
    while todo:
        path = todo.pop()
        if path in seen:
            continue
        seen.add(path)
        for name in imports(path):
            if name.startswith("simloop."):
                target = PACKAGE / (name.removeprefix("simloop.").replace(".", "/") + ".py")
                if target.exists():
                    todo.append(target)
    return sorted(seen)


@pytest.mark.parametrize("path", robot_files(), ids=lambda p: p.stem)
def test_the_robots_software_cannot_reach_the_truth(path):
    assert path.stem not in TRUTH
    names = imports(path)
    assert not any(name.split(".")[0] == "mujoco" for name in names)
    truths = ("Truth", "TrackTruth", "LooseTruth")
    assert not names & {f"simloop.messages.{truth}" for truth in truths}
    assert (
        "Truth"
        not in {
            node.id for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Name)
        }
        or path.stem == "messages"
    )


def test_the_robot_takes_sensor_messages_only():
    taken = inspect.signature(Robot.step).parameters
    assert [p.annotation for p in taken.values()][1:] == [
        "EncoderReading",
        "ImuReading",
        "LidarScan | None",
        "GoalReading | None",
        "DepthImage | None",
    ]


def test_only_the_plants_side_imports_mujoco():
    users = {p.stem for p in modules() if any(n.split(".")[0] == "mujoco" for n in imports(p))}
    certificate = {"rig", "ground", "fuzz"}
    known = {"plant", "plant_geoms", "arena", "snapshot", "world", "recorder", "scene_shapes"}
    assert users <= known | certificate
    assert "plant" in users


def test_rerun_is_imported_by_the_recorder_alone_and_lazily():
    users = {p for p in modules() if any(n.split(".")[0] == "rerun" for n in imports(p))}
    recorder = {"recorder", "record_columns", "record_images", "scene_log", "blueprint"}
    recorder.add("recording")
    assert {p.stem for p in users} <= recorder
    for path in modules():
        assert not any(n.split(".")[0] == "rerun" for n in imports(path, top_level_only=True)), path


@pytest.mark.parametrize("path", modules(), ids=lambda p: p.stem)
def test_no_wall_clock_and_no_global_random_numbers_in_decisions(path):
    text = path.read_text()
    if path.stem not in CLOCK:
        assert "perf_counter" not in text
        assert "time.time" not in text
    assert "np.random.seed" not in text
    assert "import random" not in text


@pytest.mark.parametrize("path", modules(), ids=lambda p: p.stem)
def test_files_stay_short(path):
    assert len(path.read_text().splitlines()) <= 400


def test_arrays_in_messages_cannot_be_written():
    fix = messages.PoseFix(0, np.zeros(3), np.eye(3), 1.0, True)
    with pytest.raises(ValueError, match="read-only"):
        fix.pose[0] = 1.0
