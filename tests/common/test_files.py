"""Output files: checked beforehand, and written as a whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from simloop.common.errors import InputError
from simloop.common.files import check_directory, check_file, write_text


def test_a_place_where_nothing_can_be_written_is_refused(tmp_path):
    with pytest.raises(InputError, match="is a directory"):
        check_file(tmp_path, "--json")
    with pytest.raises(InputError, match="not writable"):
        check_directory(Path("/proc/self/x"), "--out")


def test_a_check_leaves_nothing_behind(tmp_path):
    check_file(tmp_path / "a" / "x.json", "--json")
    check_directory(tmp_path / "b" / "c", "--out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_a_full_disk_is_one_line_that_names_the_file(tmp_path):
    with pytest.raises(InputError, match="/dev/full: cannot be written: No space left"):
        write_text(Path("/dev/full"), "x" * 100_000)


def test_writing_replaces_whole_files_only(tmp_path):
    target = tmp_path / "x.json"
    write_text(target, "old")
    write_text(target, "new")
    assert target.read_text() == "new" and list(tmp_path.iterdir()) == [target]
