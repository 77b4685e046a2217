"""Reading what others made: regular files only, up to a limit."""

from __future__ import annotations

import os

import pytest

from simloop.common.errors import InputError
from simloop.common.input_files import read_bytes, read_text
from simloop.common.limits import check_limit


def test_a_file_is_read_whole_up_to_the_limit(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"x" * 10)
    assert read_bytes(path, 10) == b"x" * 10
    with pytest.raises(InputError, match=r"a\.bin: larger than"):
        read_bytes(path, 9)


def test_what_is_no_regular_file_is_refused_at_once(tmp_path):
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    for path, reason in (
        (fifo, "not a regular file"),
        (tmp_path, "folder"),
        (tmp_path / "none", "no such file"),
        (type(tmp_path)("/dev/zero"), "not a regular file"),
        (tmp_path / ("n" * 300), "cannot be read"),
        (type(tmp_path)("a\0b"), "cannot be read"),
    ):
        with pytest.raises(InputError, match=reason):
            read_bytes(path)


def test_text_may_have_a_byte_order_mark_and_must_be_utf_8(tmp_path):
    path = tmp_path / "a.txt"
    path.write_bytes(b"\xef\xbb\xbfh\xc3\xa9")
    assert read_text(path) == "hé"
    path.write_bytes(b"ab\xff")
    with pytest.raises(InputError, match=r"UTF-8 \(byte 2\)"):
        read_text(path)


def test_a_size_above_its_limit_is_refused_in_words():
    check_limit(5, 5, "a.pgm: pixels")
    for size in (6, float("nan")):
        with pytest.raises(InputError, match=r"a\.pgm: pixels: (6|nan) px; at most 5 px"):
            check_limit(size, 5, "a.pgm: pixels", "px")
