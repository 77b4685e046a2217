"""CARMEN's text logs: beams, lasers, parameters, and lines that are wrong."""

from __future__ import annotations

import gzip
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.replay.beams import beam_angles, flaser_angles, robotlaser_angles
from simloop.replay.carmen import parse_carmen
from simloop.replay.read_log import read_log


def flaser(beams=181, x=0.0, t=0.0, laser_x=None, r=2.0):
    laser_x = x if laser_x is None else laser_x
    ranges = " ".join([f"{r}"] * beams)
    return f"FLASER {beams} {ranges} {laser_x} 0 0 {x} 0 0 {t} host {t}"


def robotlaser(kind="ROBOTLASER1", beams=5, start=-1.0, fov=2.0, step=0.5, most=20.0, x=0.0, t=0.0):
    ranges = " ".join(str(k + 1) for k in range(beams))
    tail = "" if kind == "RAWLASER1" else f"{x} 0 0 {x} 0 0 0 0 0 0 0 "
    return f"{kind} 0 {start} {fov} {step} {most} 0.01 0 {beams} {ranges} 0 {tail}{t} host {t}"


# ---- directions of the beams


@pytest.mark.parametrize(
    ("beams", "first", "last"),
    [
        (180, -90, 89), (181, -90, 90), (360, -90, 89.5), (361, -90, 90), (401, -50, 50),
        (201, -50, 50), (540, -135, 134.5), (541, -135, 135), (1081, -135, 135),
        (683, -119.883, 119.883), (769, -135, 135),
    ],
)  # fmt: skip
def test_the_number_of_beams_tells_the_laser(beams, first, last):
    angles, note = flaser_angles(beams, None, None)
    np.testing.assert_allclose(np.degrees(angles[[0, -1]]), [first, last], atol=1e-3)
    assert note == ""


@pytest.mark.parametrize(
    ("beams", "resolution", "fov", "first", "last", "said"),
    [
        (401, 0.25, 100.0, -50, 50, False),
        (77, 1.0, None, -38, 38, False),
        (77, None, 152.0, -76, 76, False),
        (360, 1.0, 360.0, -180, 179, False),  # a laser that looks all round
        (180, 1.0, 179.0, -89.5, 89.5, False),  # both ends are covered
        (180, 0.5, None, -90, 89, True),  # the number of beams is a known laser's
        (361, 1.0, None, -90, 90, True),
        (541, None, 180.0, -135, 135, True),
        (361, 1.0, 180.0, -90, 90, True),  # two of three
        (361, 0.5, 270.0, -90, 90, True),
        (361, 0.5, None, -90, 90, False),
        (683, 0.352, None, -120.032, 120.032, False),  # rounded
        (541, 0.5, 4.712389, -135, 135, True),  # radians
        (541, math.radians(0.5), None, -135, 135, True),
        (77, math.radians(2.0), None, -76, 76, True),
        (77, None, math.radians(152.0), -76, 76, True),
        (77, math.radians(2.0), math.radians(152.0), -76, 76, True),
        (5, 1.5, None, -3, 3, False),  # few beams, and no step in radians
        (541, 1.0, 180.0, -135, 135, True),  # CARMEN's default settings, another laser
        (77, 1.0, 180.0, -90, 90, True),
        (77, None, None, -90, 90, True),
        (400, 1.0, None, -90, 89.55, True),  # more than a full turn
    ],
)
def test_parameters_tell_the_directions(beams, resolution, fov, first, last, said):
    angles, note = flaser_angles(beams, resolution, fov)
    np.testing.assert_allclose(np.degrees(angles[[0, -1]]), [first, last], atol=1e-9)
    assert len(angles) == beams and bool(note) == said


def test_a_robotlaser_lines_sweep_is_used_if_it_is_one():
    angles, note = robotlaser_angles(541, -2.3562, 0.0087266, 4.7124)
    np.testing.assert_allclose(np.degrees(angles[[0, -1]]), [-135, 135], atol=0.01)
    assert note == ""
    angles, note = robotlaser_angles(181, math.nan, 0.0, math.pi)
    np.testing.assert_allclose(angles, beam_angles(181))
    assert "a resolution of 0;" in note and "180 degrees" in note
    assert robotlaser_angles(181, 0.0, -1.0, math.inf) is None


@pytest.mark.parametrize(
    ("beams", "start", "step", "fov", "first", "last", "said"),
    [
        (361, -90, 1.0, 180, -90, 90, "a resolution of 0.01745; .* put on 180 degrees"),
        (361, -90, 0.5, 270, -90, 90, "a field of view of 4.712; .* put on 180 degrees"),
        (541, -135, 0.5, 180, -135, 135, "a field of view of 3.142; .* put on 270 degrees"),
        (541, -135, 0.0, 180, -135, 135, "a resolution of 0; .* put on 270 degrees"),
        (360, -180, 1.0, 360, -180, 179, ""),  # a laser that looks all round
        (360, -180, 1.0, 0, -180, 179, ""),  # its start says so too
        (77, 0, 1.0, 180, 0, 180, "field of view of 3.142; .* put on 180 degrees"),
        (77, -38, 1.0, 180, -38, 38, "put on 76 degrees, by the resolution and the start"),
        (361, math.nan, 0.5, 180, -90, 90, "a start of nan"),
    ],
)
def test_two_numbers_of_a_robotlaser_line_that_agree_win(
    beams, start, step, fov, first, last, said
):
    angles, note = robotlaser_angles(beams, *np.radians([start, step, fov]))
    np.testing.assert_allclose(np.degrees(angles[[0, -1]]), [first, last], atol=1e-6)
    assert re.search(said, note) if said else not note


def test_a_robotlaser_line_in_degrees_is_recognised():
    angles, note = robotlaser_angles(541, -135.0, 0.5, 270.0)
    np.testing.assert_allclose(np.degrees(angles[[0, -1]]), [-135, 135], atol=1e-9)
    assert "taken for degrees" in note


# ---- what is read


def test_a_log_of_another_laser_type_keeps_its_directions():
    log = parse_carmen(["PARAM laser_front_laser_resolution 0.25 h 0", flaser(401)])
    np.testing.assert_allclose(np.degrees(log.angles_rad[[0, -1]]), [-50, 50])


def test_a_log_of_robotlaser_lines_alone_is_read():
    log = parse_carmen([robotlaser(x=0.1 * k, t=float(k)) for k in range(4)])
    assert log.ranges_m.tolist() == [[1, 2, 3, 4, 5]] * 4
    np.testing.assert_allclose(log.odom[:, 0], [0.0, 0.1, 0.2, 0.3])
    assert log.stated_range_m == 20.0 and log.notes == ()


def test_one_laser_in_two_kinds_of_lines_is_read_once():
    lines = []
    for k in range(4):
        lines += [robotlaser("RAWLASER1", t=k), robotlaser(x=0.1 * k, t=k), flaser(5, t=k)]
        lines.append(robotlaser("ROBOTLASER2", t=k))
    log = parse_carmen(lines)
    assert len(log.t_s) == 4 and log.stated_range_m == 20.0
    assert sorted(log.notes) == ["4 FLASER lines are not used", "4 ROBOTLASER2 lines are not used"]


def test_raw_laser_lines_get_their_poses_from_odometry():
    lines = ["PARAM robot_front_laser_offset 0.2 h 0"]
    for k in range(4):
        lines += [f"ODOM {k} 0 {0.1 * k} 0 0 0 {k} h {k}", robotlaser("RAWLASER1", t=k + 0.5)]
    log = parse_carmen(lines)
    np.testing.assert_allclose(log.odom[:, 0], [0.5, 1.5, 2.5, 3.0])
    np.testing.assert_allclose(log.odom[:, 2], [0.05, 0.15, 0.25, 0.3])
    np.testing.assert_allclose(log.base_from_laser, [0.2, 0.0, 0.0])
    still = parse_carmen([robotlaser("RAWLASER1", t=k) for k in range(2)])
    assert not still.odom.any() and "stand still" in still.notes[0]


def test_odometry_lines_that_are_not_valid_are_counted():
    lines = []
    for k in range(4):
        lines += [f"ODOM {k} 0 0 0 0 0 {k} h {k}", robotlaser("RAWLASER1", t=k)]
    wrong = ["ODOM 1 2 0 0.1 0 3", "ODOM nan 0 0 0 0 0 3 h 3"]
    log = parse_carmen([*lines, *wrong])
    assert log.notes == ("2 of 6 ODOM lines are not valid, and not used (first at line 9)",)
    short = [line[:12] if line.startswith("ODOM") else line for line in lines]
    with pytest.raises(InputError, match=r"x.log: most .* odometry .* 4 of 4 .* at line 1"):
        parse_carmen(short, "x.log")
    unneeded = parse_carmen([flaser(t=0), *short], "x.log")  # poses are in the laser's lines
    assert "4 of 4 ODOM lines are not valid, and not used (first at line 2)" in unneeded.notes


def test_lines_of_another_kind_that_are_not_valid_are_counted():
    wrong = [robotlaser()[:40]] * 50 + [robotlaser("RAWLASER1")[:40]]
    notes = parse_carmen([flaser(t=k) for k in range(4)] + wrong).notes
    assert notes == (
        "50 ROBOTLASER1 lines are not valid, and not used (first at line 5)",
        "1 RAWLASER1 lines are not valid, and not used (first at line 55)",
    )


@pytest.mark.parametrize(
    ("unit", "in_a_second"), [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)]
)
def test_stamps_in_smaller_units_are_recognised(unit, in_a_second):
    stamps = [(1.7e9 + 0.5 * k) * in_a_second for k in range(6)]
    lines = [flaser(t=f"{t:.0f}") for t in stamps]
    lines.append(f"ODOM 0 0 0 0 0 0 {stamps[1]:.0f} h {stamps[1]:.0f}")
    log = parse_carmen(lines)
    np.testing.assert_allclose(np.diff(log.t_s), 0.5, atol=1e-6)
    assert log.measured and len(log.notes) == 1 and f"taken for {unit}" in log.notes[0]
    np.testing.assert_allclose(log.odometry.clocks_s[0], log.t_s[1])


def test_stamps_that_are_no_times_are_not_said_to_fall():
    log = parse_carmen([flaser(t=f"{10**25 + k * 10**20}") for k in range(4)])
    assert not log.measured and "no seconds since 1970" in log.notes[0]


def test_the_order_of_the_lines_counts_whatever_the_stamps_say():
    log = parse_carmen([flaser(x=0.1 * k, t=-k) for k in range(5)])
    np.testing.assert_allclose(log.odom[:, 0], 0.1 * np.arange(5))
    assert not log.measured and "stamps" in log.notes[0]


def test_a_second_laser_and_cut_lines_are_left_out_and_said():
    lines = [flaser(), flaser(x=0.1, t=1), flaser(361, x=0.2, t=2), flaser(x=0.3, t=3)[:-60]]
    lines += [flaser(x=0.1 * k, t=k) for k in range(4, 8)]
    log = parse_carmen(lines, "x.log")
    assert len(log.t_s) == 6 and log.skipped == 2
    assert any("line 3" in note and "181 beams" in note for note in log.notes)
    assert any("line 4" in note and "not a valid line" in note for note in log.notes)


def test_a_log_is_refused_if_most_of_it_cannot_be_used():
    with pytest.raises(InputError, match=r"x.log: most of the log .* 3 of 4 .* not a valid line"):
        parse_carmen([flaser(), *["FLASER 3 1 2"] * 3], "x.log")
    with pytest.raises(InputError, match=r"most of the log .* 2 of 3 .* odometry"):
        parse_carmen([flaser(), flaser(x=math.nan), flaser(x=math.inf)])


# ---- numbers that are not plausible


@pytest.mark.parametrize("name", ["robot_front_laser_offset", "robot_frontlaser_offset"])
@pytest.mark.parametrize("value", ["nan", "inf", "1e300", "-11", "x"])
def test_an_offset_that_no_robot_has_is_refused(name, value):
    with pytest.raises(InputError, match=rf"x.log, line 2: PARAM {name} {value}"):
        parse_carmen([flaser(), f"PARAM {name} {value} h 0"], "x.log")


@pytest.mark.parametrize("name", ["laser_front_laser_resolution", "laser_front_laser_fov"])
@pytest.mark.parametrize("value", ["nan", "0", "-1", "361", "x"])
def test_a_sweep_that_no_laser_has_is_refused(name, value):
    with pytest.raises(InputError, match=rf"line 1: PARAM {name} {value}"):
        parse_carmen([f"PARAM {name} {value} h 0", flaser()], "x.log")


def test_an_offset_that_is_not_used_is_said():
    log = parse_carmen([flaser(), "PARAM robot_frontlaser_angular_offset 3.14 h 0"])
    assert log.notes == ("PARAM robot_frontlaser_angular_offset is not used",)


@pytest.mark.parametrize("laser_x", [math.nan, 1e300, -1e9])
def test_a_wrong_laser_pose_gives_no_offset(laser_x):
    log = parse_carmen([flaser(x=0.1 * k, laser_x=laser_x, t=k) for k in range(3)])
    np.testing.assert_allclose(log.base_from_laser, 0.0)


# ---- files


def test_a_packed_log_is_read(tmp_path):
    text = "\n".join(flaser(x=0.1 * k, t=k) for k in range(30)).encode()
    path = tmp_path / "x.log.gz"
    path.write_bytes(gzip.compress(text))
    assert len(read_log(path).t_s) == 30
    path.write_bytes(gzip.compress(text)[:-40])
    cut = read_log(path)
    assert 20 <= len(cut.t_s) <= 30 and "cut off" in cut.notes[-1]
    path.write_bytes(gzip.compress(text)[:40])
    with pytest.raises(InputError, match=r"x\.log\.gz.*cut off"):
        read_log(path)
    wrong = bytearray(gzip.compress(text))
    wrong[-8] ^= 255
    path.write_bytes(wrong)
    with pytest.raises(InputError, match="not readable by gzip"):
        read_log(path)


def test_a_packed_file_that_grows_too_much_is_refused(tmp_path):
    path = tmp_path / "x.log.gz"
    path.write_bytes(gzip.compress(b"#  a comment\n" * 600_000))
    with pytest.raises(InputError, match="size up to here"):
        read_log(path)
    path.write_bytes(gzip.compress(b"#" * 5_000_000))
    with pytest.raises(InputError, match="line 1: length"):
        read_log(path)


words = st.sampled_from(
    ["FLASER", "ROBOTLASER1", "RAWLASER1", "ODOM", "PARAM", "robot_front_laser_offset", "0", "1",
     "2", "3", "0.5", "-1", "nan", "inf", "1e300", "x", "\n", "\n", "\x00", "h"]
)  # fmt: skip


@given(st.lists(words, max_size=60), st.integers(0, 10**9))
@settings(max_examples=60)
def test_no_text_breaks_the_reader(some, seed):
    rng = np.random.default_rng(seed)
    lines = [flaser(7, x=0.1, t=1), robotlaser(), robotlaser("RAWLASER1"), "ODOM 1 2 3 0 0 0 1 h 1"]
    for line in lines:
        parts = line.split()
        for at in rng.integers(0, len(parts), 2):
            if some:
                parts[at] = some[at % len(some)]
        some = [*some, "\n", *parts]
    try:
        log = parse_carmen(" ".join(some).split("\n"), "x.log")
    except InputError as error:
        assert "x.log" in str(error)
    else:
        assert np.isfinite(log.odom).all() and np.isfinite(log.base_from_laser).all()
        assert (np.diff(log.t_s) > 0.0).all()
