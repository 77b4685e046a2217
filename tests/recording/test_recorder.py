"""Recordings, read back with the recording library's own reader."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from helpers.recordings import column, read, scalars
from helpers.synthetic_run import OFF, SyntheticRun, scene_of_model

from simloop.geometry.se2 import compose, compose_all
from simloop.messages import DepthImage, LowObstacles, MapUpdate, Plan, WorldView
from simloop.recording.columns import ellipses, nees, occupancy_percent
from simloop.recording.recorder import RerunRecorder
from simloop.recording.scene_shapes import scene_shapes
from simloop.truth import Truth
from simloop.worlds.arena import build

MODEL = build("experiment")
SECONDS = 5.0


def recorder_to(path: Path) -> RerunRecorder:
    return RerunRecorder(path, scene_of_model(MODEL, title="made up"))


@pytest.fixture(scope="module")
def run() -> SyntheticRun:
    return SyntheticRun(MODEL, SECONDS)


@pytest.fixture(scope="module")
def recording(run: SyntheticRun, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    recorder = recorder_to(path)
    for message in run.messages():
        recorder.offer(message)
    recorder.close()
    recorder.close()  # twice does no harm
    return path


@pytest.fixture(scope="module")
def found(recording: Path) -> dict[str, list]:
    return read(recording)


def test_the_file_passes_the_librarys_check(recording: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(recording)], capture_output=True
    )
    assert done.returncode == 0, done.stderr.decode()


@pytest.mark.parametrize(
    ("entity", "source", "expected"),
    [
        ("speed/true", "Truth", [0.35]),
        ("speed/asked", "TrackCommand", [0.35]),
        ("speed/believed", "Estimate", [0.35]),
        ("yaw_rate/believed", "Estimate", [0.1]),
        ("current", "Truth", [0.7, 0.8]),
        ("voltage", "Truth", [14.0, 15.0]),
        ("track/true", "Truth", [9.4 * 0.037] * 2),
        ("track/asked", "TrackCommand", [9.5 * 0.037] * 2),
        ("filter", "Estimate", [0.001, 1.2]),
        ("filter/icr", "Estimate", [0.002, 0.01]),
        ("match", "PoseFix", [0.9, 1.0]),
        ("plan_cost", "Plan", [4.2, 5.6, 1.3]),
        ("plan_effort", "Plan", [9000, 40]),
        ("clearance", "SmoothPath", [0.31]),
        ("error_position", "Estimate", [np.hypot(0.008, 0.005)]),
        ("error_yaw", "Estimate", [0.004]),
        ("nees", "Estimate", [0.008**2 / 1e-4 + 0.005**2 / 4e-4 + 0.004**2 / 1e-5]),
    ],
)
def test_each_message_has_a_row_in_its_plot(
    found: dict[str, list], run: SyntheticRun, entity: str, source: str, expected: list[float]
) -> None:
    times, values = scalars(found[f"/plots/{entity}"])
    assert len(times) == run.counts[source]
    assert values == pytest.approx(np.tile(expected, (len(times), 1)), rel=1e-6)
    assert np.all(np.diff(times) > 0)
    assert times[0] == 0
    if source in ("Truth", "Estimate"):
        assert times[-1] == round(SECONDS * 1e9)


def transforms(tables: list) -> tuple[np.ndarray, np.ndarray]:
    times, where = column(tables, "Transform3D:translation")
    _, turns = column(tables, "Transform3D:quaternion")
    xyz, quaternion = np.array(where)[:, 0], np.array(turns)[:, 0]
    yaw = 2.0 * np.arctan2(quaternion[:, 2], quaternion[:, 3])
    return times, np.column_stack([xyz[:, :2], yaw])


def test_the_frames_combine_to_the_believed_pose(found: dict[str, list], run: SyntheticRun) -> None:
    times, map_from_odom = transforms(found["/map/odom"])
    again, odom_from_base = transforms(found["/map/odom/base_link"])
    assert np.array_equal(times, again)
    assert np.all(np.diff(times) == 40_000_000)  # 25 Hz, over the seams of the flushes too
    believed = np.array([run.pose(int(t)) + OFF for t in times])
    assert compose_all(map_from_odom, odom_from_base) == pytest.approx(believed, abs=1e-5)
    assert odom_from_base[-1, 0] == pytest.approx(0.35 * times[-1] * 1e-9, abs=1e-3)
    assert odom_from_base[:, 1:] == pytest.approx(0.0, abs=1e-9)


def test_the_true_pose_is_recorded(found: dict[str, list], run: SyntheticRun) -> None:
    times, poses = transforms(found["/map/truth"])
    assert poses == pytest.approx(np.array([run.pose(int(t)) for t in times]), abs=1e-6)


def test_scans_are_points_in_the_lasers_frame(found: dict[str, list], run: SyntheticRun) -> None:
    times, rows = column(found["/map/odom/base_link/laser/scan"], "Points3D:positions")
    assert len(times) == run.counts["LidarScan"] == 51
    scan = run.scan(0)
    first = np.array(rows[0])
    assert len(first) == np.isfinite(scan.ranges_m).sum()
    assert np.hypot(*first[:, :2].T) == pytest.approx(scan.ranges_m, rel=1e-5)
    assert np.arctan2(first[1:, 1], first[1:, 0]) == pytest.approx(scan.angles_rad[1:], abs=1e-5)


def test_maps_plans_and_paths_are_there(found: dict[str, list]) -> None:
    run = SyntheticRun(MODEL, SECONDS)
    times, images = column(found["/map/occupancy"], "GridMap:data")
    assert len(times) == 3
    grid = np.array(images[-1][0], np.uint8).reshape(104, 104)[::-1]
    last = [m for m in run.messages() if isinstance(m, MapUpdate)][-1]
    assert np.array_equal(grid, occupancy_percent(last.log_odds))
    assert 100 < (grid == 99).sum() < 1000  # walls
    _, strips = column(found["/map/plan/candidates"], "LineStrips3D:strips")
    assert [len(row) for row in strips] == [2, 2, 2]
    _, discs = column(found["/map/obstacle_discs"], "LineStrips3D:strips")
    ring = np.array(discs[0][1])[:, :2] - [2.05, 0.55]
    assert np.hypot(*ring.T) == pytest.approx(0.19, rel=1e-5)
    for entity in ("plan/chosen", "path"):
        assert len(column(found[f"/map/{entity}"], "LineStrips3D:strips")[0]) == 3
    _, trails = column(found["/map/trails/truth"], "LineStrips3D:strips")
    lengths = [len(row[0]) for row in trails]
    assert lengths == sorted(lengths)
    assert np.array(trails[-1][0])[-1, :2] == pytest.approx(run.pose(5 * 10**9)[:2], abs=0.05)


def test_events_are_recorded_in_order(found: dict[str, list]) -> None:
    times, texts = column(found["/events"], "TextLog:text")
    lines = [row[0] for row in texts]
    assert lines.count("mode: follow") == 1
    assert lines.count("replanned: frame") == 3
    assert sum(line.startswith("plan (frame): tlbo, cost 4.200, 5.60 m") for line in lines) == 3
    assert np.all(np.diff(times) >= 0)


def test_the_scene_is_recorded(found: dict[str, list]) -> None:
    def count(entity: str, component: str) -> int:
        return sum(
            len(t.column(component)[0]) for t in found[entity] if component in t.schema.names
        )

    boxes = [s for s in scene_shapes(MODEL) if s.body == "world" and s.kind == "box"]
    assert count("/map/arena/shapes/box", "Boxes3D:half_sizes") == len(boxes) > 8
    assert "/map/odom/base_link/shapes/visual_hull" in found
    assert "/map/odom/base_link/sprocket_left/turned/shapes/visual_sprocket_left" in found
    assert not any("hull_body" in entity or "road_" in entity for entity in found)


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_an_unfinished_file_is_readable_up_to_its_last_second(tmp_path: Path) -> None:
    path = tmp_path / "cut.rrd"
    recorder = recorder_to(path)
    for message in SyntheticRun(MODEL, 3.5).messages():
        recorder.offer(message)
    # Nobody closed it: as after a kill. It has no right to its name yet.
    assert not path.exists() and recorder.path.parent == tmp_path
    times, _ = scalars(read(recorder.path)["/plots/speed/true"])
    assert times[-1] >= 2_900_000_000
    recorder.close()
    times, _ = scalars(read(path)["/plots/speed/true"])
    assert times[-1] == 3_500_000_000


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
@pytest.mark.parametrize("most_bytes", [pytest.param(700_000, marks=pytest.mark.slow), 900_000])
def test_a_full_disk_gives_one_line_and_a_readable_file(tmp_path: Path, most_bytes: int) -> None:
    path = tmp_path / "full.rrd"
    child = textwrap.dedent(
        f"""
        import resource, sys
        sys.path.insert(0, {str(Path(__file__).parents[1])!r})
        from helpers.synthetic_run import SyntheticRun, scene_of_model
        from simloop.recording.recorder import RerunRecorder
        from simloop.worlds.arena import build
        model = build("experiment")
        recorder = RerunRecorder({str(path)!r}, scene_of_model(model))
        resource.setrlimit(resource.RLIMIT_FSIZE, ({most_bytes}, {most_bytes}))
        for message in SyntheticRun(model, 5.0).messages():
            recorder.offer(message)
        recorder.close()
        print("the run went on")
        """
    )
    done = subprocess.run(
        [sys.executable, "-c", child], capture_output=True, text=True, timeout=120
    )
    assert done.stdout == "the run went on\n"
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    (kept,) = tmp_path.iterdir()  # cut, so without its final name
    assert "recording stopped" in done.stderr and str(kept) in done.stderr
    assert kept.name.startswith("full.partial-") and kept.suffix == ".rrd"
    times, _ = scalars(read(kept)["/plots/speed/true"])
    assert 0 < len(times) < 501


def test_a_file_that_cannot_be_opened_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="no-such"):
        recorder_to(tmp_path / "no-such" / "run.rrd")
    if os.path.exists("/dev/full"):
        with pytest.raises(OSError, match="/dev/full"):
            recorder_to(Path("/dev/full"))


def test_messages_without_discs_or_candidates_are_recorded(tmp_path: Path) -> None:
    recorder = recorder_to(tmp_path / "bare.rrd")
    line = np.array([[0.0, 0.0], [1.0, 0.0]])
    recorder.offer(
        Plan(0, line, 1.0, 1.0, 0.0, False, 10, 1, "tlbo", "first", safe_distance_m=0.26)
    )
    grid = np.zeros((2, 2), np.float32)
    recorder.offer(WorldView(0, np.zeros(2), 0.05, grid, np.zeros((0, 3)), np.zeros(4)))
    recorder.close()
    found = read(tmp_path / "bare.rrd")
    assert [r[0] for r in column(found["/events"], "TextLog:level")[1]] == ["WARN"]
    assert [len(r) for r in column(found["/map/obstacle_discs"], "LineStrips3D:strips")[1]] == [0]


def test_depth_images_and_low_obstacles_are_recorded(tmp_path: Path) -> None:
    path, mount = tmp_path / "seen.rrd", np.array([0.2, 0.0, 0.16])
    recorder = RerunRecorder(path, scene_of_model(MODEL, camera_m=mount))
    depth = np.linspace(0.2, 3.0, 12, dtype=np.float32).reshape(3, 4)
    depth[0, 0] = np.inf
    for k in range(2):
        recorder.offer(DepthImage(k * 10**8, depth + np.float32(k), np.array([5.0, 6.0])))
        recorder.offer(LowObstacles(k * 10**8, np.arange(2.0 * k).reshape(k, 2)))
    recorder.close()
    tables = read(path)
    camera = "/map/odom/base_link/camera"
    times, buffers = column(tables[f"{camera}/depth"], "DepthImage:buffer")
    assert times.tolist() == [0, 10**8]
    second = np.frombuffer(bytes(buffers[1][0]), np.float32).reshape(3, 4)
    assert second[0, 0] == 0.0
    assert second[1:] == pytest.approx(depth[1:] + 1.0)
    names = {name for table in tables[camera] for name in table.schema.names}
    assert {"Transform3D:translation", "Pinhole:image_from_camera"} <= names
    _, places = column(tables["/map/low_obstacles"], "Points3D:positions")
    assert [len(p) for p in places] == [0, 1]


def test_the_library_is_imported_only_for_recording() -> None:
    code = "import simloop.recording.recorder, sys; print('rerun' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "False\n"


def test_many_poses_compose_like_single_ones() -> None:
    first, second = np.random.default_rng(1).uniform(-3.0, 3.0, (2, 20, 3))
    one_by_one = [compose(a, b) for a, b in zip(first, second, strict=True)]
    assert compose_all(first, second) == pytest.approx(np.array(one_by_one), abs=1e-12)


def test_health_is_recorded_when_it_changes(found: dict[str, list]) -> None:
    times, values = scalars(found["/plots/health"])
    assert times.tolist() == [0, 10**9]
    assert values[:, 0].tolist() == [0.0, 1.0]


def test_ellipses_contain_95_percent_and_nees_has_the_right_mean() -> None:
    rng = np.random.default_rng(2)
    covariance = np.array([[4e-4, 1e-4], [1e-4, 1e-4]])
    points = rng.multivariate_normal([1.0, 2.0], covariance, 20_000)
    (outline,) = ellipses(np.array([[1.0, 2.0]]), covariance[None], 1.0)
    d = outline - [1.0, 2.0]
    edge = np.einsum("ni,ij,nj->n", d, np.linalg.inv(covariance), d)
    assert edge == pytest.approx(5.991)
    values = nees(points - [1.0, 2.0], np.tile(covariance, (len(points), 1, 1)))
    assert np.mean(values < edge[0]) == pytest.approx(0.95, abs=0.01)
    assert values.mean() == pytest.approx(2.0, abs=0.05)


def test_occupancy_has_the_values_of_ros() -> None:
    odds = np.array([[0.0, -5.0], [5.0, 0.4]], np.float32)
    assert occupancy_percent(odds).tolist() == [[255, 1], [99, 60]]


def test_recording_is_cheap(tmp_path: Path) -> None:
    """A high limit, for gross errors only, such as one call of the library for each message."""
    import time

    messages = list(SyntheticRun(MODEL, SECONDS).messages())
    costs = []
    for attempt in range(3):
        recorder = recorder_to(tmp_path / f"{attempt}.rrd")
        began = time.process_time()
        for message in messages:
            recorder.offer(message)
        costs.append((time.process_time() - began) / SECONDS)
        recorder.close()
    assert sum(isinstance(m, Truth) for m in messages) == 501
    assert min(costs) < 0.060
