"""Output files: checked beforehand, never over an input, and written as a whole or not at all."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from simloop.common import files as files_module
from simloop.common.errors import InputError
from simloop.common.files import (
    FilePlan,
    check_directory,
    check_file,
    folder_lock,
    make_directory,
    temporary_name,
    write_text,
    written_together,
)


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


def refusal(**named):
    """Check a plan of one input and outputs; the names are those of the options."""
    plan = FilePlan()
    for name, path in named.items():
        if name == "source":
            plan.reads(path, "the source")
        elif name == "folder":
            plan.writes_into(path, "--folder", ["picture.png"])
        else:
            plan.writes(path, f"--{name}")
    try:
        plan.check()
    except InputError as error:
        return str(error)
    return None


def test_no_output_is_an_input_by_any_name(tmp_path, monkeypatch):
    source = tmp_path / "source.toml"
    source.write_text("mine")
    (tmp_path / "soft").symlink_to(source)
    os.link(source, tmp_path / "hard")
    (tmp_path / "dir").mkdir()
    (tmp_path / "dirlink").symlink_to(tmp_path)
    monkeypatch.chdir(tmp_path)
    same = ["source.toml", "soft", "hard", "dir/../source.toml", "dirlink/source.toml"]
    for name in same:
        assert "would overwrite the source" in refusal(source=source, json=Path(name)), name
        assert "would overwrite the source" in refusal(source=Path(name), json=source), name
    assert "is not a directory" in refusal(source=source, json=source / "x.json")
    assert "is not a directory" in refusal(source=source, folder=source)
    assert refusal(source=source, json=Path("other.json")) is None
    # A file that does not exist yet, and one that a folder's pictures would replace.
    assert "would overwrite" in refusal(source=Path("new"), json=Path("dirlink/new"))
    assert "would overwrite" in refusal(source=Path("dir/picture.png"), folder=Path("dir"))
    assert source.read_text() == "mine"


def test_no_output_is_another_output_or_below_it(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "a")
    assert "--record" in refusal(record=tmp_path / "a", json=tmp_path / "a")
    assert "--record" in refusal(record=tmp_path / "a", json=tmp_path / "link")
    assert "lies below the file of --record" in refusal(
        record=tmp_path / "a", json=tmp_path / "a/b"
    )
    assert "--record" in refusal(record=tmp_path / "a", folder=tmp_path / "a")
    assert "below" in refusal(record=tmp_path / "a", folder=tmp_path / "a" / "b")
    assert refusal(record=tmp_path / "a", json=tmp_path / "b", folder=tmp_path / "c") is None
    assert refusal(record=Path("/dev/null"), json=Path("/dev/null")) is None


def test_links_that_lead_nowhere_and_odd_names_are_one_line(tmp_path):
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    (tmp_path / "lost").symlink_to(tmp_path / "missing" / "x")
    (tmp_path / "fine").symlink_to(tmp_path / "x")
    assert "levels of symbolic links" in refusal(json=tmp_path / "a")
    assert "levels of symbolic links" in refusal(json=tmp_path / "a" / "x")
    assert "levels of symbolic links" in refusal(folder=tmp_path / "a")
    assert "which is missing" in refusal(json=tmp_path / "lost")
    assert "not writable" in refusal(json=tmp_path / "lost" / "below")
    assert refusal(json=tmp_path / "fine") is None
    assert "null byte" in refusal(json=Path("a\0b")) and "null byte" in refusal(folder=Path("a\0b"))
    assert "name too long" in refusal(json=tmp_path / ("n" * 300)).lower()
    assert "name too long" in refusal(folder=tmp_path / ("n" * 300)).lower()


def test_files_that_belong_together_all_appear_or_none(tmp_path, monkeypatch):
    first, second = tmp_path / "map.pgm", tmp_path / "map.yaml"
    first.write_text("old")
    with pytest.raises(InputError, match="second"), written_together() as files:
        files.write_text(first, "new")
        files.write_text(tmp_path / "missing" / "second", "new")
    assert first.read_text() == "old" and list(tmp_path.iterdir()) == [first]
    with pytest.raises(KeyboardInterrupt), written_together() as files:
        files.write_text(first, "new")
        raise KeyboardInterrupt
    assert first.read_text() == "old" and list(tmp_path.iterdir()) == [first]

    def full(handle):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(files_module.os, "fsync", full)
        with pytest.raises(InputError, match=r"map\.yaml: cannot be written: No space left"):
            write_text(second, "new")
    assert list(tmp_path.iterdir()) == [first]
    with written_together() as files:
        files.write_text(first, "new")
        files.write_text(second, "new")
        assert first.read_text() == "old"
    assert first.read_text() == second.read_text() == "new"
    assert sorted(tmp_path.iterdir()) == [first, second]


def test_links_and_permissions_of_a_replaced_file_are_kept(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_text("old")
    target.chmod(0o640)
    link.symlink_to(target)
    write_text(link, "new")
    assert link.is_symlink() and target.read_text() == "new"
    assert target.stat().st_mode & 0o777 == 0o640
    fresh = tmp_path / "fresh"
    write_text(fresh, "x")
    umask = os.umask(0)
    os.umask(umask)
    assert fresh.stat().st_mode & 0o777 == 0o666 & ~umask


def test_temporary_names_cannot_be_foreseen_and_follow_no_link(tmp_path, monkeypatch):
    victim = tmp_path / "victim"
    victim.write_text("mine")
    monkeypatch.setattr(files_module.secrets, "token_hex", lambda count: "guessed")
    (tmp_path / ".x.guessed.partial").symlink_to(victim)
    with pytest.raises(InputError, match="File exists"):
        write_text(tmp_path / "x", "theirs")
    assert victim.read_text() == "mine"
    monkeypatch.undo()
    one, two = temporary_name(tmp_path / "run.rrd"), temporary_name(tmp_path / "run.rrd")
    assert one != two and one.suffix == ".rrd" and one.name.startswith("run.partial-")
    long = tmp_path / ("é" * 120)
    write_text(long, "x")
    assert long.read_text() == "x"


def test_one_folder_belongs_to_one_process_at_a_time(tmp_path):
    code = (
        "import sys; from pathlib import Path\n"
        "from simloop.common.files import folder_lock\n"
        "with folder_lock(Path(sys.argv[1])): print('got it')"
    )
    other = [sys.executable, "-c", code, str(tmp_path)]
    with folder_lock(tmp_path, None, tmp_path):
        done = subprocess.run(other, capture_output=True, text=True, check=False)
    assert "another process is writing there" in done.stderr
    done = subprocess.run(other, capture_output=True, text=True, check=False)
    assert done.stdout == "got it\n" and list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be created"):
        make_directory(tmp_path / "file" / "x")
