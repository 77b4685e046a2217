"""The journal: what it refuses, what it repairs, and whose runs it takes for its own."""

from __future__ import annotations

import json
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simloop.campaign import journal, journal_lines
from simloop.campaign.spec import Request, RunSpec
from simloop.campaign.work import row_of
from simloop.common.errors import InputError

REQUEST = Request(("open",), (0, 9))


def spec(seed=0, **changes):
    given_ = {"scenario": "open", "planner": None, "sweep": (), "overrides": (), "seed": seed}
    return RunSpec(**{**given_, **changes})


def row(one, outcome="reached", **figures):
    return row_of(one, outcome) | {"sim_time_s": 2.5, "contact_count": 0, **figures}


def line(seed, **figures):
    one = spec(seed)
    return json.dumps({"key": one.key, "row": row(one, **figures)}).encode() + b"\n"


@pytest.fixture
def folder(tmp_path):
    """A campaign's folder with four finished runs."""
    with journal.Journal(tmp_path, REQUEST) as kept:
        for seed in range(4):
            kept.add(spec(seed), row(spec(seed)))
    assert (tmp_path / "journal.jsonl").read_bytes() == b"".join(map(line, range(4)))
    return tmp_path


def seeds_in(folder, **options):
    with journal.Journal(folder, REQUEST, **options) as kept:
        return sorted(one["seed"] for one in kept.rows.values()), kept.notes


def changed(seed, /, **changes):
    """The line of a run with another value at these places of its row."""
    entry = json.loads(line(seed))
    entry["row"].update(changes)
    return json.dumps(entry).encode() + b"\n"


DAMAGES = {
    "a null": b"null\n",
    "a number": b"7\n",
    "a list": b"[1, 2]\n",
    "a text": b'"text"\n',
    "no row": b'{"key": "x"}\n',
    "a row of null": json.dumps({"key": spec(7).key, "row": None}).encode() + b"\n",
    "a row that is a list": json.dumps({"key": spec(7).key, "row": [1]}).encode() + b"\n",
    "a key of null": json.dumps({"key": None, "row": {}}).encode() + b"\n",
    "a key that is a list": json.dumps({"key": [1], "row": {}}).encode() + b"\n",
    "a key of another form": json.dumps({"key": '["open"]', "row": {}}).encode() + b"\n",
    "an empty line": b"\n",
    "another seed than the key's": changed(7, seed=8),
    "a seed that is a truth value": changed(7, seed=True),
    "another scenario": changed(7, scenario="trap"),
    "an unknown outcome": changed(7, outcome="well"),
    "an outcome that is a list": changed(7, outcome=["reached"]),
    "a success that is none": changed(7, success=False),
    "a success that is a number": changed(7, success=1),
    "an error that is a number": changed(7, error=3),
    "a time that is a text": changed(7, sim_time_s="2.5"),
    "a count that is a table": changed(7, contact_count={}),
    "a number of 100 digits": changed(7, contact_count=10**100),
    "half a character": changed(7, error="\ud800"),
    "a number of 5000 digits": line(7).replace(b"2.5", b"1" * 5000),
    "a list of 500 levels": changed(7, path_m=json.loads("[" * 500 + "]" * 500)),
    "100,000 levels": b"[" * 100_000 + b"]" * 100_000 + b"\n",
    "zeros": bytes(4096) + b"\n",
    "zeros before a line": bytes(4096) + line(7),
    "Latin-1": line(7).replace(b'"error": ""', b'"error": "caf\xe9"'),
    "half a line": line(7)[:60] + b"\n",
    "half a line without its line break": line(6)[:60] + line(7),
    "two lines in one": line(6)[:-1] + line(7),
    "another file": b"%PDF-1.7\n",
}
WHOLE = {"zeros before a line": [7], "half a line without its line break": [7],
         "two lines in one": [6, 7]}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGES)
def test_a_damaged_line_is_named_by_its_byte_and_a_repair_keeps_the_others(folder, name):
    file = folder / "journal.jsonl"
    start = len(line(0) + line(1))
    damaged = line(0) + line(1) + DAMAGES[name] + line(2) + line(3)
    file.write_bytes(damaged)
    with pytest.raises(InputError, match=r"journal\.jsonl, byte \d+: .*--repair keeps") as caught:
        seeds_in(folder)
    byte = int(str(caught.value).partition("byte ")[2].partition(":")[0])
    assert start <= byte <= start + len(DAMAGES[name])
    assert file.read_bytes() == damaged  # untouched

    found, (note,) = seeds_in(folder, repair=True)
    assert found == [0, 1, 2, 3, *WHOLE.get(name, [])]
    assert "journal.jsonl.damaged" in note and f"byte {byte}" in note
    assert (folder / "journal.jsonl.damaged").read_bytes() == damaged
    assert seeds_in(folder) == (found, [])  # and it goes on from there


def test_damage_in_two_places_is_repaired_at_once_and_no_copy_is_overwritten(folder):
    file = folder / "journal.jsonl"
    for copy in ("journal.jsonl.damaged", "journal.jsonl.damaged-2"):
        damaged = line(0)[:50] + b"\n" + line(1) + bytes(99) + line(2)[9:] + line(3)
        file.write_bytes(damaged)
        found, (note,) = seeds_in(folder, repair=True)
        assert found == [1, 3] and "2 damaged lines" in note
        assert (folder / copy).read_bytes() == damaged


@pytest.mark.parametrize("end", [line(4)[:30], line(4)[:3], bytes(512), line(4)[:30] + bytes(99)])
def test_a_cut_off_end_is_dropped_and_said(folder, end):
    file = folder / "journal.jsonl"
    whole = file.read_bytes()
    file.write_bytes(whole + end)
    found, (note,) = seeds_in(folder)
    assert found == [0, 1, 2, 3] and f"byte {len(whole)}: the last line is cut off" in note
    assert file.read_bytes() == whole


def test_a_last_line_that_lacks_only_its_line_break_is_kept(folder):
    file = folder / "journal.jsonl"
    whole = file.read_bytes()
    file.write_bytes(whole[:-1])
    assert seeds_in(folder) == ([0, 1, 2, 3], []) and file.read_bytes() == whole


def test_another_file_of_that_name_is_not_taken_for_a_cut_off_line(folder):
    (folder / "journal.jsonl").write_text("my own notes")
    with pytest.raises(InputError, match="byte 0"):
        seeds_in(folder)
    assert (folder / "journal.jsonl").read_text() == "my own notes"


@pytest.mark.parametrize(
    "text", ["", "null", "[]", "3", '{"seeds": 3}', '{"seeds": [0, 9], "scenarios": 3}',
             '{"seeds": ["0", 9], "scenarios": []}', "[" * 100_000, "\x00" * 99]
)  # fmt: skip
def test_a_damaged_request_is_one_line_and_made_anew_if_the_runs_are_its_own(folder, text):
    asked = folder / "campaign.json"
    asked.write_text(text)
    with pytest.raises(InputError, match=r"campaign\.json: cannot be read as a campaign's request"):
        seeds_in(folder)
    assert asked.read_text() == text
    with (
        pytest.raises(InputError, match="runs of another campaign"),
        journal.Journal(folder, Request(("trap",), (0, 9)), repair=True),
    ):
        pass
    found, notes = seeds_in(folder, repair=True)
    assert found == [0, 1, 2, 3] and "made anew" in notes[0]
    assert seeds_in(folder) == (found, [])


def test_runs_without_a_request_are_not_taken_over_unasked(folder):
    (folder / "campaign.json").unlink()
    with pytest.raises(InputError, match="missing, although there are runs"):
        seeds_in(folder)
    assert seeds_in(folder, repair=True)[0] == [0, 1, 2, 3]


ROOM = 'start = [0.0, 0.0, 0.0]\ngoal = [3.0, 0.0]\narena = "open"\n'


def test_an_edited_scenario_is_another_campaign_but_a_comment_is_none(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(ROOM)
    request, out = Request((str(file),), (0, 2)), tmp_path / "out"
    with journal.Journal(out, request):
        pass
    file.write_text("# a comment\n" + ROOM)
    with journal.Journal(out, request):
        pass
    file.write_text(ROOM.replace("3.0", "3.5"))
    with (
        pytest.raises(InputError, match=r"changed since then: .*mine\.toml, so give another --out"),
        journal.Journal(out, request),
    ):
        pass


def test_another_version_is_another_campaign(folder):
    asked = folder / "campaign.json"
    table = json.loads(asked.read_text())
    asked.write_text(json.dumps({**table, "versions": {**table["versions"], "numpy": "0.1"}}))
    with pytest.raises(InputError, match="another version now: numpy"):
        seeds_in(folder)
    del table["versions"]
    asked.write_text(json.dumps(table))
    with pytest.raises(InputError, match="not recorded then"):
        seeds_in(folder)


def test_errors_can_be_done_again(tmp_path):
    specs = [spec(seed) for seed in range(3)]
    with journal.Journal(tmp_path, REQUEST) as kept:
        for one in specs:
            kept.add(one, row(one, "error" if one.seed == 1 else "timeout"))
    with journal.Journal(tmp_path, REQUEST) as kept:
        assert kept.missing(specs) == []
        assert kept.forget_errors(specs) == 1 and kept.missing(specs) == [specs[1]]
    with journal.Journal(tmp_path, REQUEST) as kept:  # stopped before: the old row is still there
        assert kept.missing(specs) == [] and kept.forget_errors(specs) == 1
        kept.add(specs[1], row(specs[1]))
    with journal.Journal(tmp_path, REQUEST) as kept:
        assert kept.forget_errors(specs) == 0 and kept.rows[specs[1].key]["success"]


def test_nothing_is_left_of_a_campaign_that_never_began(tmp_path):
    place = tmp_path / "a" / "b"
    with pytest.raises(InputError, match="later"), journal.Journal(place, REQUEST):
        raise InputError("found later")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "mine.txt").touch()
    with pytest.raises(InputError, match="later"), journal.Journal(tmp_path / "a", REQUEST):
        raise InputError("found later")
    assert [one.name for one in (tmp_path / "a").iterdir()] == ["mine.txt"]


def test_a_full_disk_is_one_line_and_leaves_no_half_line(folder, monkeypatch):
    class Full:
        def __init__(self, file):
            self._file = file

        def __getattr__(self, name):
            return getattr(self._file, name)

        def write(self, data):
            if len(data) > 20:
                return self._file.write(data[:20])
            raise OSError(28, "No space left on device")

    before = (folder / "journal.jsonl").read_bytes()
    with journal.Journal(folder, REQUEST) as kept:
        monkeypatch.setattr(kept, "_file", Full(kept._file))
        with pytest.raises(InputError, match=r"journal\.jsonl: cannot be written: No space left"):
            kept.add(spec(5), row(spec(5)))
        assert spec(5).key not in kept.rows
    assert (folder / "journal.jsonl").read_bytes() == before


def test_a_journal_that_is_no_file_is_refused(tmp_path):
    import os

    os.mkfifo(tmp_path / "journal.jsonl")
    with pytest.raises(InputError, match="not a regular file"):
        seeds_in(tmp_path)


@pytest.mark.parametrize("wrong", [{"success": 1}, {"seed": None}, {"outcome": 3}, {"seed": 0.5}])
def test_results_of_wrong_types_are_refused(tmp_path, wrong):
    journal.write_results(tmp_path, [row(spec()) | wrong])
    with pytest.raises(InputError, match=r"results\.parquet: not a campaign's results"):
        journal.read_results(tmp_path)


@pytest.mark.parametrize("name", ["path_length_m", "shortest_path_m", "sim_time_s", "energy_j"])
@pytest.mark.parametrize("value", ["long", [1.0], True])
def test_results_with_a_figure_that_is_no_number_are_refused(tmp_path, name, value):
    journal.write_results(tmp_path, [row(spec()) | {name: value}])
    with pytest.raises(InputError, match=rf"results\.parquet: column {name}: not a number"):
        journal.read_results(tmp_path)


def mutate(random_, data):
    """Change a journal as disks, editors and kills do."""
    data = bytearray(data)
    for _ in range(random_.randint(1, 3)):
        at = random_.randrange(len(data) + 1)
        length = random_.choice((1, 2, 16, 100))
        change = random_.randrange(6)
        if change == 0:
            data[at : at + length] = b""
        elif change == 1:
            data[at : at + length] = bytes(min(length, len(data) - at))
        elif change == 2:
            data[at:at] = data[random_.randrange(len(data) + 1) :][:length]
        elif change == 3:
            data[at:at] = random_.choice(PIECES)
        elif change == 4 and at < len(data):
            data[at] = random_.randrange(256)
        elif change == 5:
            del data[at:]
    return bytes(data)


PIECES = (b"null", b"[" * 50, b"{", b'"', b"\n", b"\xe9", b"\\ud800", b"1e999", b"-", b"9" * 400,
          b'{"key"', b"NaN", b"true", b"\xef\xbb\xbf", b"\r\n", bytes(64), b"[]")  # fmt: skip


def survives(data, *, write=True):
    """Read a journal as the two modes do; whatever is kept is a whole row."""
    import io

    found = list(journal_lines.scan(io.BytesIO(data)))
    assert b"".join(one.line.data for one in found) == data
    rows = [entry for one in found for entry in one.entries]
    kept = b"".join(line for line, *_ in rows)
    again = list(journal_lines.scan(io.BytesIO(kept)))
    assert all(one.error is None for one in again)  # a repair leaves nothing to repair
    if write:
        journal.parquet_of([row for *_, row in rows])


@given(st.binary() | st.text().map(str.encode))
def test_no_bytes_end_in_anything_but_rows_and_errors(data):
    survives(data)


def test_no_mutation_of_a_journal_ends_in_a_traceback():
    fuzz(300)


@pytest.mark.slow
def test_no_mutation_of_a_journal_ends_in_a_traceback_however_many():
    fuzz(100_000)


def fuzz(count):
    random_ = random.Random(7)
    whole = b"".join(line(seed, path_m=[[0.1, 0.2]], health=None) for seed in range(3))
    for number in range(count):
        survives(mutate(random_, whole), write=number % 10 == 0)
