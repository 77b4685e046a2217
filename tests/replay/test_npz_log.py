"""Logs as numpy arrays: what a header says is checked before memory is taken for it."""

from __future__ import annotations

import io
import math
import tracemalloc
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.replay.read_log import read_log


def table(n=4, beams=181):
    return {
        "scan_t_s": np.arange(float(n)),
        "scan_ranges_m": np.full((n, beams), 2.0, np.float32),
        "scan_odom_xyyaw": np.zeros((n, 3)),
        "fov_deg": np.float64(180.0),
        "laser_offset_x_m": 0.04,
        "ref_gmapping_xyyaw": np.zeros((n, 3)),
        "odom_t_s": np.arange(9.0),
        "odom_xyyaw": np.zeros((9, 3)),
    }


def member(shape="(4,)", descr="<f8", data=b"", fortran=False):
    """An array whose header says what it is told to."""
    header = f"{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}"
    header += " " * (63 - (len(header) + 10) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + data


def write(path, replaced, compression=zipfile.ZIP_DEFLATED):
    """An npz of ``table``, with some members given as bytes; None leaves one out."""
    with zipfile.ZipFile(path, "w", compression) as archive:
        for key, value in (table() | replaced).items():
            if isinstance(value, bytes):
                archive.writestr(f"{key}.npy", value)
            elif value is not None:
                out = io.BytesIO()
                np.save(out, value)
                archive.writestr(f"{key}.npy", out.getvalue())
    return path


def refused(path):
    """The error of a log; reading it takes little memory."""
    tracemalloc.start()
    try:
        with pytest.raises(InputError) as caught:
            read_log(path)
        assert tracemalloc.get_traced_memory()[1] < 2**26
    finally:
        tracemalloc.stop()
    return str(caught.value)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", ["<f8", "<f4", ">f4", "<f2", "<i4"])
def test_every_kind_of_numbers_is_read(tmp_path, order, kind):
    ranges = np.arange(1.0, 9.0).reshape(4, 2).astype(kind)
    log = read_log(
        write(tmp_path / "x.npz", {"scan_ranges_m": np.array(ranges, order=order), "more": "text"})
    )
    np.testing.assert_array_equal(log.ranges_m, ranges)


@pytest.mark.parametrize(
    ("key", "value", "word"),
    [
        ("scan_t_s", None, "missing"),
        ("scan_t_s", np.arange(3.0), "do not match"),
        ("scan_ranges_m", np.ones((4, 0)), "no beam"),
        ("scan_ranges_m", np.array(["a"] * 4), "type"),
        ("scan_ranges_m", np.ones((4, 2), complex), "type"),
        ("scan_odom_xyyaw", np.full((4, 3), math.nan), "odometry"),
        ("scan_odom_xyyaw", np.full((4, 3), 1e9), "odometry"),
        ("fov_deg", np.float64(math.nan), "fov_deg"),
        ("fov_deg", np.float64(361.0), "fov_deg"),
        ("fov_deg", np.ones(0), "fov_deg"),
        ("laser_offset_x_m", np.float64(1e300), "laser_offset_x_m"),
        ("laser_offset_x_m", np.float64(math.nan), "laser_offset_x_m"),
        ("laser_offset_x_m", np.float64(-10.5), "laser_offset_x_m"),
        ("ref_gmapping_xyyaw", np.zeros((3, 3)), "ref_gmapping_xyyaw"),
        ("ref_gmapping_xyyaw", np.zeros((4, 2)), "ref_gmapping_xyyaw"),
        ("odom_xyyaw", np.zeros((8, 3)), "odom_xyyaw"),
        ("odom_t_s", np.zeros((9, 1)), "odom_t_s"),
        ("relations_t1_t2_dx_dy_dyaw", np.ones((2, 4)), "relations"),
        ("relations_t1_t2_dx_dy_dyaw", np.full((2, 5), math.inf), "row 0"),
        ("relations_t1_t2_dx_dy_dyaw", np.full((2, 5), 1e300), "row 0"),
    ],
)
def test_arrays_that_are_wrong_are_named(tmp_path, key, value, word):
    text = refused(write(tmp_path / "x.npz", {key: value}))
    assert "x.npz" in text and word in text


@pytest.mark.parametrize(
    ("key", "shape", "descr", "word"),
    [
        ("scan_ranges_m", "(4, 10000000000)", "<f4", "are allowed"),
        ("scan_ranges_m", "(4, 181)", "<f4", "another size"),
        ("scan_ranges_m", "(-4, -181)", "<f4", "shape"),
        ("scan_ranges_m", "(4.0, 181)", "<f4", "npz"),
        ("scan_ranges_m", "(4, 181)", "|O", "type"),
        ("scan_ranges_m", "(4, 181)", "<U100000000", "type"),
        ("scan_ranges_m", "(" * 200 + ")" * 200, "<f4", "npz"),
        ("scan_ranges_m", "(4L, (181", "<f4", "npz"),
        ("scan_t_s", f"({2**63},)", "<f8", "are allowed"),
        ("fov_deg", "(9, 9)", "<f8", "are allowed"),
        ("relations_t1_t2_dx_dy_dyaw", "(99999999, 5)", "<f8", "are allowed"),
        ("ref_gmapping_xyyaw", "(99999999, 3)", "<f8", "are allowed"),
        ("odom_t_s", "(99999999,)", "<f8", "are allowed"),
    ],
)
def test_a_header_that_lies_takes_no_memory(tmp_path, key, shape, descr, word):
    assert word in refused(write(tmp_path / "x.npz", {key: member(shape, descr, b"\0" * 8)}))


def test_odometry_lines_that_cannot_be_used_are_told(tmp_path):
    path = write(tmp_path / "x.npz", {"odom_t_s": np.array([0, 1, 2, 1, 4, np.nan, 6, 7, 8.0])})
    log = read_log(path)
    assert "2 of 9 odometry lines are not used" in log.notes[0]
    assert len(log.odometry.usable(0).t_s) == 7
    log = read_log(write(tmp_path / "x.npz", {"odom_t_s": None}))
    assert log.odometry is None and "only one is there" in log.notes[0]
    assert not read_log(write(tmp_path / "x.npz", {"odom_t_s": None, "odom_xyyaw": None})).notes


def test_a_file_that_unpacks_to_more_than_is_allowed_is_not_unpacked(tmp_path):
    zeros = member("(900000, 100)", "|u1", bytes(90_000_000))
    assert "at most 80,000,000" in refused(write(tmp_path / "x.npz", {"scan_ranges_m": zeros}))


def test_files_that_are_broken_are_refused(tmp_path):
    path = tmp_path / "x.npz"
    good = write(path, {}).read_bytes()
    for data in (good[:-30], good[: len(good) // 2], b"", b"PK\x05\x06", good[:100] + good[160:]):
        path.write_bytes(data)
        assert "x.npz" in refused(path)
    write(path, {}, zipfile.ZIP_LZMA)
    assert "does not write" in refused(path)


@given(
    st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=8),
    st.booleans(),
)
@settings(max_examples=80)
def test_no_bytes_break_the_reader(tmp_path_factory, changes, stored):
    path = tmp_path_factory.mktemp("npz") / "x.npz"
    kind = zipfile.ZIP_STORED if stored else zipfile.ZIP_DEFLATED
    data = bytearray(write(path, {}, kind).read_bytes())
    for at, value in changes:
        data[at % len(data)] = value
    path.write_bytes(data)
    try:
        log = read_log(path)
    except InputError as error:
        assert "x.npz" in str(error)
    else:
        assert np.isfinite(log.odom).all() and not np.isnan(log.ranges_m).any()
