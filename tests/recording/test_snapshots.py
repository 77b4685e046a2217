"""Pictures of a run, and the flat view of what the planner knows."""

from __future__ import annotations

import itertools
import logging
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from helpers.synthetic_run import GOAL, OFF, SyntheticRun

from simloop.config import VehicleConfig
from simloop.messages import LidarScan, MapUpdate, Plan, SmoothPath, WorldView
from simloop.recording.belief_picture import (
    DISC,
    INK,
    PAPER,
    PATH,
    SCAN,
    UNKNOWN,
    Belief,
    PlannerView,
)
from simloop.recording.belief_picture import GOAL as GOAL_INK
from simloop.recording.offscreen import NoOpenGLError, open_gl_context
from simloop.recording.snapshots import Snapshots
from simloop.worlds.arena import build

BOUNDS = (0.0, 0.0, 4.7, 4.7)  # with the view's margin: 5 m, 100 px a metre


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return build("experiment")


@pytest.fixture(scope="module")
def has_gl() -> bool:
    try:
        open_gl_context(64, 64).free()
    except NoOpenGLError:
        return False
    return True


def offered(model: mujoco.MjModel, directory: Path, duration_s: float) -> Snapshots:
    snapshots = Snapshots(model, directory, GOAL, title="a made-up run")
    for message in SyntheticRun(model, duration_s).messages():
        snapshots.offer(message)
    return snapshots


def pixel(point: tuple[float, float]) -> tuple[int, int]:
    """Row and column of a point in map, in a view of BOUNDS at 500 px."""
    return round(500 - (point[1] + 0.15) * 100), round((point[0] + 0.15) * 100)


def view(**knowledge: object) -> np.ndarray:
    belief = Belief(
        np.array([2.0, 1.0, 0.5 * np.pi]), np.array([4.0, 4.0]), np.zeros((0, 2)), **knowledge
    )  # type: ignore[arg-type]
    return PlannerView(BOUNDS, 500, VehicleConfig()).draw(belief)


def off_colour(image: np.ndarray, point: tuple[float, float], colour: tuple[int, ...]) -> float:
    """Least distance in colour of the nine pixels around a point in map."""
    row, column = pixel(point)
    around = image[row - 1 : row + 2, column - 1 : column + 2].astype(float)
    return float(np.abs(around - colour).sum(axis=2).min())


def test_eight_moments_and_a_sheet_from_start_to_end(
    model: mujoco.MjModel, tmp_path: Path, has_gl: bool
) -> None:
    if not has_gl:
        pytest.skip("no OpenGL off screen here")
    sheet = offered(model, tmp_path / "new" / "pictures", 14.0).finish()
    assert sheet is not None
    assert sheet.name == "contact_sheet.png"
    tiles = [cv2.imread(str(sheet.parent / f"moment_{i}.png")) for i in range(1, 9)]
    height, width = tiles[0].shape[:2]
    image = cv2.imread(str(sheet))
    assert image.shape[0] > 2 * height
    assert image.shape[1] > 4 * width
    # The scene is lit and coloured, and the robot is elsewhere each time.
    scenes = [tile[:500].astype(float) for tile in tiles]
    assert scenes[0].std() > 25.0
    for before, after in itertools.pairwise(scenes):
        moved = np.abs(after - before).max(axis=2) > 40.0
        assert 200 < moved.sum() < 0.1 * moved.size
    assert not (sheet.parent / "moment_9.png").exists()


def test_without_opengl_one_warning_and_the_planners_views(
    model: mujoco.MjModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "none-such")
    with caplog.at_level(logging.WARNING):
        sheet = offered(model, tmp_path, 3.0).finish()
    assert len(caplog.records) == 1
    assert "without the 3D scene" in caplog.text
    assert sheet is not None
    assert cv2.imread(str(sheet)) is not None


def test_a_run_of_one_instant_has_one_picture(
    model: mujoco.MjModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "none-such")
    assert offered(model, tmp_path, 0.0).finish() is not None
    assert sorted(p.name for p in tmp_path.iterdir()) == ["contact_sheet.png", "moment_1.png"]


def test_without_messages_nothing_is_written(model: mujoco.MjModel, tmp_path: Path) -> None:
    assert Snapshots(model, tmp_path / "none", GOAL).finish() is None
    assert not (tmp_path / "none").exists()


def test_moments_are_evenly_spread_and_show_what_was_known_then(
    model: mujoco.MjModel, tmp_path: Path
) -> None:
    chosen = offered(model, tmp_path, 12.0).chosen_moments()
    times = np.array([m.truth.t_ns for m in chosen]) * 1e-9
    assert len(times) == 8
    assert times[0] < 0.02
    assert times[-1] == pytest.approx(12.0)
    assert np.diff(times) == pytest.approx(12.0 / 7, abs=0.51)
    for moment in chosen:
        belief = moment.belief
        assert belief.plan is not None
        assert moment.truth.t_ns - 1.84e9 <= belief.plan.t_ns <= moment.truth.t_ns
        assert belief.scan is not None
        assert moment.truth.t_ns - 0.11e9 <= belief.scan.t_ns <= moment.truth.t_ns
        # The scan is drawn from where it was taken, not from where the robot is by now.
        then = SyntheticRun(model).pose(belief.scan.t_ns) + OFF
        assert belief.scan_pose == pytest.approx(then)


def test_the_map_is_drawn_where_it_is() -> None:
    log_odds = np.zeros((40, 60), np.float32)
    log_odds[8, 50] = 5.0
    log_odds[20:30, 20:30] = -5.0
    grid = MapUpdate(0, np.array([0.5, 1.0]), 0.05, log_odds)
    image = view(grid=grid)
    assert tuple(image[pixel((0.5 + 50.5 * 0.05, 1.0 + 8.5 * 0.05))]) == INK
    assert tuple(image[pixel((0.5 + 25 * 0.05, 1.0 + 25 * 0.05))]) == PAPER
    assert tuple(image[pixel((0.5 + 5 * 0.05, 1.0 + 35 * 0.05))]) == UNKNOWN
    assert tuple(image[pixel((4.5, 0.5))]) == UNKNOWN  # outside the grid
    dark = np.argwhere(np.all(image == INK, axis=2))
    dark = dark[np.abs(dark - 249.5).max(axis=1) < 240]  # without the frame
    dark = dark[np.hypot(*(dark - np.array(pixel((2.0, 1.0)))).T) > 45]  # nor the robot
    assert dark.mean(axis=0) == pytest.approx(pixel((3.025, 1.425)), abs=1.0)


def test_beliefs_are_drawn_where_they_are() -> None:
    line = np.array([[0.5, 3.0], [1.5, 3.0]])
    ones = np.ones(2)
    path = SmoothPath(0, line, ones, ones, ones, ones, True)
    world = WorldView(0, np.zeros(2), 0.05, np.zeros((2, 2), np.float32),
                      np.array([[3.0, 2.0, 0.3]]), np.array(BOUNDS))  # fmt: skip
    # One echo at 1 m, 90 degrees left of a robot that looks up: 1 m to its left in the map.
    scan = LidarScan(0, np.array([0.5 * np.pi, 0.0]), np.array([1.0, np.inf]),
                     np.zeros(2, np.int64), 0.15, 12.0)  # fmt: skip
    pose = np.array([2.0, 1.0, 0.5 * np.pi])
    image = view(path=path, world=world, scan=scan, scan_pose=pose)
    assert tuple(image[pixel((1.0, 3.0))]) == PATH
    assert tuple(image[pixel((4.0, 4.0))]) == GOAL_INK
    assert off_colour(image, (3.3, 2.0), DISC) < 80
    assert off_colour(image, (1.0, 1.0), SCAN) < 10
    assert off_colour(image, (3.0, 2.0), DISC) > 150
    tracks = [tuple(image[pixel((2.0 + side * 0.2, 1.0))]) for side in (-1.0, 1.0)]
    assert tracks == [INK, INK]


def test_candidates_and_an_empty_belief_can_be_drawn() -> None:
    line = np.array([[0.5, 3.0], [1.5, 3.0]])
    beside = (line + 0.5,)
    plan = Plan(
        0, line, 1.0, 1.0, 0.0, True, 100, 3, "tlbo", candidates_m=beside, safe_distance_m=0.26
    )
    assert np.any(view(plan=plan) != view())
