"""Logs whose first scans see nothing or something wrong, and results that are of no use."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from helpers.relations import format_relations
from helpers.rooms import ANGLES, Room, box
from helpers.shared_cases import shared_case
from typer.testing import CliRunner

from simloop.cli.main import app
from simloop.common.errors import InputError
from simloop.replay import session
from simloop.replay.carmen import parse_carmen
from simloop.replay.laser_log import ScanReader
from simloop.replay.read_log import read_log

ROOM = Room(*box(-2.0, -1.5, 3.0, 2.0), *box(1.5, 1.2, 2.0, 2.0))
FRONT = np.abs(ANGLES) <= 0.5 * math.pi


def line(ranges, x=0.0, t=0.0):
    text = " ".join(f"{r:.3f}" for r in ranges)
    return f"FLASER {len(ranges)} {text} {x} 0 0 {x} 0 0 {t} h {t}"


def room_lines(count, step, first):
    seen = (ROOM.ranges(np.array([step * k, 0.0, 0.0]))[FRONT] for k in range(first, count))
    return [line(r, step * k, k) for k, r in enumerate(seen, first)]


def mapped(lines):
    return session.run(parse_carmen(lines), None)


# Among equal hits that move with the robot, its turns are unknown, and the room is seen turned.
@pytest.mark.parametrize(
    ("value", "step"), [(81.91, 0.0), (81.91, 0.15), (9.0, 0.0), (9.0, 0.15), (0.8, 0.0)]
)
@pytest.mark.parametrize("blind", [1, 4])
def test_the_map_shows_the_room_whatever_the_first_scans_are(step, value, blind):
    count = 14
    first = [line([value] * int(FRONT.sum()), step * k, k) for k in range(blind)]
    replay = mapped([*first, *room_lines(count, step, blind)])
    x = replay.map.surfaces()[:, 0]
    assert np.count_nonzero(np.abs(x - 3.0) < 0.05) > 30  # the room's front wall
    np.testing.assert_allclose(replay.trajectory[-1, 0], step * (count - 1), atol=0.05)
    assert len(replay.trajectory) == count and replay.figures["worthless"] is None


def test_a_round_room_is_mapped():
    replay = mapped([line([4.0] * 181, t=k) for k in range(5)])
    np.testing.assert_allclose(np.hypot(*replay.map.surfaces().T), 4.0, atol=0.01)
    assert replay.figures["notes"] == [
        "5 of 5 scans have one range in all directions: how the robot turns cannot be told from "
        "them"
    ]


def replay_command(path, *lines):
    path.write_text("\n".join(lines))
    return CliRunner().invoke(app, ["replay", str(path), "--json", "-"], standalone_mode=False)


def test_a_log_that_sees_nothing_is_worthless(tmp_path):
    done = replay_command(tmp_path / "x.log", *[line([81.91] * 181, 0.1 * k, k) for k in range(6)])
    assert done.return_value == 1 and json.loads(done.stdout)["scans_blind"] == 6
    assert "the result is worthless: the map is empty: 6 of 6 scans" in done.stderr


def test_a_log_of_scans_that_fit_nowhere_is_worthless(tmp_path):
    rng = np.random.default_rng(5)
    done = replay_command(
        tmp_path / "x.log",
        *[line(rng.uniform(1.0, 25.0, 181), 3.0 * k, k) for k in range(8)],
    )
    assert done.return_value == 1 and "scans fitted nowhere" in done.stderr
    assert json.loads(done.stdout)["worthless"]


def test_what_was_assumed_is_said_on_stderr_and_in_the_figures(tmp_path):
    done = replay_command(tmp_path / "x.log", *[line([2.0] * 77, t=0.0)] * 5)
    assert done.return_value == 0
    figures = json.loads(done.stdout)
    assert len(figures["notes"]) == 3 and figures["log_time_s"] is None
    for note in figures["notes"]:
        assert note in done.stderr
    assert "77 beams" in done.stderr and "stamps do not rise" in done.stderr


def test_relations_of_another_log_are_refused_before_the_replay(tmp_path):
    lines, log, rows = room_lines(5, 0.1, 0), tmp_path / "x.log", tmp_path / "r.relations"
    log.write_text("\n".join(lines))
    rows.write_text(format_relations([[90.0, 91.0, 0.0, 0.0, 0.0]]))
    with pytest.raises(InputError, match="another log"):
        session.load(log, rows)


def test_odometry_that_leaps_breaks_nothing():
    rng = np.random.default_rng(2)
    ranges = ROOM.ranges(np.zeros(3))[FRONT]
    replay = mapped([line(ranges, rng.choice([0.0, 4e4, -9e4]), k) for k in range(25)])
    assert np.isfinite(replay.trajectory).all()
    assert any("outside the largest map" in note for note in replay.figures["notes"])


@pytest.mark.parametrize("offset", ["nan", "1e18", "-1e300"])
def test_a_laser_that_is_nowhere_is_refused_before_anything_runs(tmp_path, offset):
    lines = [f"PARAM robot_front_laser_offset {offset} h 0", *room_lines(5, 0.1, 0)]
    done = replay_command(tmp_path / "x.log", *lines)
    assert isinstance(done.exception, InputError) and "robot_front_laser_offset" in str(
        done.exception
    )


# ---- public reports


@pytest.mark.parametrize("name", ["rising", "zero", "rounded", "backwards", "loggerclock"])
def test_stamps_that_do_not_rise_drop_no_scan(name):
    folder = shared_case("01-carmen-equal-stamps")
    replay = session.run(read_log(folder / f"{name}.log"), None)
    assert replay.figures["scans"] == 8
    np.testing.assert_allclose(replay.trajectory[-1], [1.4, 0.0, 0.35], atol=0.02)
    assert bool(replay.figures["notes"]) == (name != "rising")


@pytest.mark.parametrize("name", ["sick_181", "hokuyo_683", "utm_541", "sick_401"])
def test_beams_lie_on_the_walls(name):
    log = read_log(shared_case("03-carmen-beam-counts") / f"{name}.log")
    x, y = (ScanReader(log, 30.0).points(0)[0] + [0.5, 0.2]).T
    off = np.min(np.abs([x - 2.5, x + 2.0, y - 2.0, y + 1.5]), axis=0)
    assert off.max() < 0.01


@pytest.mark.parametrize("name", ["glitch", "noglitch", "glitch_robotlaser"])
def test_no_ring_of_ranges_without_an_echo(name):
    folder = shared_case("05-carmen-glitch-above-code")
    replay = session.run(read_log(folder / f"{name}.log"), None)
    x, y = replay.map.surfaces().T
    assert x.max() < 4.05 and np.abs(y).max() < 2.05 and replay.figures["occupied_cells"] > 200


@pytest.mark.parametrize(
    ("name", "way_m"),
    [("plain_3", 1.0), ("plain_fine_6", 2.5), ("plain_noise_60", 5.9), ("aces_12", 10.7)],
)
def test_the_way_along_a_plain_corridor_is_that_of_the_odometry(name, way_m):
    path = shared_case("02-carmen-thinned-corridor") / f"{name}.log"
    if not path.exists():
        pytest.skip(f"{path} is not on this machine")
    poses = session.run(read_log(path), None).trajectory
    assert math.hypot(*(poses[-1] - poses[0])[:2]) == pytest.approx(way_m, rel=0.01)
    if name != "aces_12":  # the others go straight on
        np.testing.assert_allclose(poses[:, 1:], 0.0, atol=0.02)


def surfaces(name):
    replay = session.run(read_log(shared_case("18-carmen-equal-ranges") / f"{name}.log"), None)
    assert replay.figures["worthless"] is None
    return replay.map.surfaces(), replay


# The rooms' front walls and the ways that the odometry has; the side walls are at 2 m.
ROOMS = {
    "standing": (4.0, 0.0),
    "moving": (4.0, 1.8),
    "first_scan_blind_standing": (4.0, 0.0),
    "first_scan_blind_moving": (4.0, 1.8),
    "then_room": (3.0, 0.0),
}


@pytest.mark.parametrize(("name", "room"), ROOMS.items())
def test_walls_are_in_the_map_after_blind_scans(name, room):
    (front, way), (points, replay) = room, surfaces(name)
    x, y = points.T
    on_front, on_sides = np.abs(x - front) < 0.03, np.abs(np.abs(y) - 2.0) < 0.03
    assert (on_front | on_sides).all()
    assert np.ptp(y[on_front]) > 3.8
    for side in (y > 1.97, y < -1.97):
        assert np.ptp(x[side]) > front - 0.4
    np.testing.assert_allclose(replay.trajectory[-1], [way, 0.0, 0.0], atol=0.02)


@pytest.mark.parametrize("name", ["standing", "moving"])
def test_a_blind_first_scan_changes_no_wall(name):
    plain, blind = surfaces(name)[0], surfaces(f"first_scan_blind_{name}")[0]
    apart = np.linalg.norm(plain[:, None] - blind[None], axis=2)
    assert apart.min(axis=0).max() < 0.05  # nothing is there that is not in the plain map
    # What only the first scan saw, close beside the robot's first place, may be missing.
    assert apart.min(axis=1)[plain[:, 0] > 0.3].max() < 0.05


def test_a_round_room_is_round():
    """A half circle by the case's README, or a message: its turns cannot be told."""
    points, replay = surfaces("round_room")
    np.testing.assert_allclose(np.hypot(*points.T), 5.0, atol=0.01)
    assert np.ptp(np.degrees(np.arctan2(*points.T[::-1]))) > 178.0
    assert "one range in all directions" in replay.figures["notes"][0]
