"""What a campaign refuses before anything runs, and the names of what it writes."""

from __future__ import annotations

import shlex
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest

from simloop.campaign import closer_look, execute, journal, junit, summary, thresholds
from simloop.campaign.spec import Request, RunSpec
from simloop.campaign.sweeps import parse_seeds, sweep_values
from simloop.campaign.work import check_worlds, do_run, row_of
from simloop.cli import runs
from simloop.cli.apart import check_apart
from simloop.cli.main import main
from simloop.common.data_files import models_dir
from simloop.common.errors import InputError
from simloop.common.pool import Workers

ROOM = 'start = [0.0, 0.0, 0.0]\ngoal = [3.0, 0.0]\narena = "open"\n'


def spec(seed=0, **changes):
    given_ = {"scenario": "open", "planner": None, "sweep": (), "overrides": (), "seed": seed}
    return RunSpec(**{**given_, **changes})


@pytest.mark.parametrize(
    ("request_", "match"),
    [
        (Request(("open", "open"), (0, 2)), "SCENARIO open: given twice"),
        (Request(("open",), (0, 2), ("tlbo", "exact", "tlbo")), "--planner tlbo: given twice"),
        (Request(("open",), (0, 2), (), (), ("time_limit_s=1,2,1.0",)), r"1\.0 is given twice"),
        (Request(("open",), (0, 2), (), (), ("goal=[1,0],[1.0,0]",)), "given twice"),
        (Request(("open",), (0, 2), (), (), ("planner.name=tlbo,\"tlbo\"",)), "given twice"),
        (Request(("open",), (0, 2), (), (), ("seed=1,2",)), "seed is already given by --seeds"),
        (Request(("open",), (0, 2), (), ("seed=1",)), "seed is already given by --seeds"),
        (Request(("open",), (0, 2), ("tlbo",), (), ("planner.name=exact",)), "by --planner"),
        (Request(("open",), (0, 2), ("tlbo",), ("planner.name=exact",)), "by --planner"),
        (Request(("open",), (0, 2), (), (), ("goal.0=1,2", "goal.0=3")), "by --sweep goal.0=1,2"),
        (Request(("open",), (0, 2), (), (), ("goal.0=1", "goal=[1,2]")), "by --sweep goal.0=1"),
        (Request(("open",), (0, 2), (), ("goal.0=1",), ("goal=[1,2]",)), "by --sweep goal="),
        (Request(("open\udcff",), (0, 2)), "not text in UTF-8"),
        (Request(("open",), (0, 2), (), (), ("a=0:999:1", "b=0:999:1")), "too many"),
        (Request(("nowhere",), (0, 2)), "unknown scenario"),
    ],
)  # fmt: skip
def test_what_doubles_or_contradicts_is_refused(request_, match):
    with pytest.raises(InputError, match=match):
        request_.check()


def test_a_sweep_may_refine_what_is_set():
    Request(("open",), (0, 2), (), ("goal=[1.0,2.0]",), ("goal.0=1.0,2.0",)).check()


def test_one_file_by_two_names_is_one_scenario(tmp_path):
    (tmp_path / "one.toml").write_text(ROOM)
    (tmp_path / "two.toml").symlink_to(tmp_path / "one.toml")
    both = tuple(str(tmp_path / name) for name in ("one.toml", "two.toml"))
    with pytest.raises(InputError, match=r"two\.toml: the same file as .*one\.toml"):
        Request(both, (0, 1)).check()


def test_a_count_beyond_64_bits_is_too_many():
    # 2^64 combinations: a product of 64 bits is 0.
    request = Request(("open",), (0, 1), (), (), tuple(f"k{i}=0:255:1" for i in range(8)))
    with pytest.raises(InputError, match="18,446,744,073,709,551,616 runs are too many"):
        request.runs()


@pytest.mark.parametrize("text", ["-1:3", "0:9223372036854775809", "9" * 5000, "0:" + "9" * 400])
def test_seeds_outside_64_bits_are_refused(text):
    with pytest.raises(InputError, match="--seeds"):
        parse_seeds(text)


def test_the_largest_seed_has_a_result():
    from simloop.campaign.journal import parquet_of

    first, last = parse_seeds("9223372036854775807:9223372036854775808")
    assert last - first == 1
    row = do_run(spec(first, overrides=("time_limit_s=0.1",)))
    assert row["outcome"] == "timeout" and parquet_of([row])


def test_a_sweep_of_values_that_are_no_toml_is_refused_at_once():
    with pytest.raises(InputError, match="not a TOML value"):
        sweep_values("goal=[1,2],[3,4")


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("colision_rate<=0", "did you mean 'collision_rate'"),
        ("sim_tims_mean<4", "did you mean 'sim_time_s'"),
        ("outcome_mean<4", "unknown figure"),
        ("sim_time_s<4", "unknown"),
        ("collision_rate<=5", "not in percent"),
        ("success_rate>=-1", "not in percent"),
        ("sim_time_s_max<=1e999", "not finite"),
    ],
)
def test_a_threshold_that_says_nothing_is_refused(text, match):
    with pytest.raises(InputError, match=match):
        thresholds.parse(text)


def test_the_figures_that_thresholds_know_are_those_of_a_run():
    row = do_run(spec(overrides=("goal=[0.6,0.0]",)))
    texts = {name for name, value in row.items() if isinstance(value, str | bool)}
    assert texts == {"scenario", "planner", "sweep", "outcome", "success", "error", "state_hash"}
    assert set(row) - texts == set(summary.NUMBERS)


def test_every_cell_is_checked_before_any_run():
    cells = Request(("open",), (0, 2), (), (), ("goal=[1.0,0.0],[99.0,0.0]",)).cells()
    checked = []
    with pytest.raises(InputError, match=r"goal \(99, 0\) is outside .*\(goal=\[99"):
        check_worlds(cells, (0, 2), checked.append)
    assert checked == [1]


def test_a_world_that_only_some_seeds_can_draw_is_no_wrong_input(monkeypatch):
    from simloop.campaign import work

    real = work.build_world

    def without_zero(scenario):
        if scenario.seed == 0:
            raise InputError("no room for seed 0")
        return real(scenario)

    monkeypatch.setattr(work, "build_world", without_zero)
    check_worlds([spec(scenario="clutter")], (0, 9))
    with pytest.raises(InputError, match="no room"):
        check_worlds([spec(scenario="clutter")], (0, 1))


@pytest.mark.parametrize("name", ["a b;rm -rf $(x).toml", "it's.toml", '"`x`.toml', "ä\n.toml"])
def test_the_command_of_a_run_survives_a_shell(name):
    one = spec(3, scenario=f"/tmp/{name}", planner="tlbo", sweep=("goal=[1,2]",))
    assert shlex.split(one.command()) == [
        "simloop", "run", f"/tmp/{name}", "--seed", "3", "--planner", "tlbo", "--set", "goal=[1,2]",
    ]  # fmt: skip


def test_runs_never_share_a_file_and_no_name_is_too_long():
    several = [
        spec(),
        spec(1),
        spec(scenario="/a/room.toml"),
        spec(scenario="/b/room.toml"),
        spec(sweep=("a=1; b=2",)),
        spec(sweep=("a=1", "b=2")),
        spec(sweep=("goal=[1,2]",)),
        spec(sweep=("goal=[1;2]",)),
        spec(overrides=("goal=[1,2]",)),
        spec(sweep=(f"planner.name={'x' * 5000}1",)),
        spec(sweep=(f"planner.name={'x' * 5000}2",)),
        spec(scenario="/c/.\x1b\udcff.toml"),
    ]
    names = [closer_look.file_name(one) for one in several]
    assert len(set(names)) == len(several) and names[:2] == ["open_seed0", "open_seed1"]
    assert all(len(name) < 140 and name.isascii() and name[0].isalnum() for name in names)


def test_junit_holds_any_text(tmp_path):
    wild = "bad \x00\x1b[31m \ud800 \uffff & < ä\n"
    one = spec(scenario=f"/a/{wild}.toml")
    file = tmp_path / "x.xml"
    junit.write_junit(file, [(one, row_of(one, "error", wild))], [])
    (error,) = Xml.parse(file).getroot().iter("error")
    assert "bad \\x00\\x1b[31m \\ud800 \\uffff & < ä" in error.text


def test_outputs_and_inputs_are_told_apart_through_links(tmp_path):
    room, link = tmp_path / "room.toml", tmp_path / "link.json"
    room.write_text(ROOM)
    link.symlink_to(room)
    check_apart({"--json": tmp_path / "new.json", "--junit": None}, [room])
    for wrong in (room, link, tmp_path / "." / "room.toml"):
        with pytest.raises(InputError, match=r"--json .*overwrite the input"):
            check_apart({"--json": wrong}, [room, tmp_path / "missing.toml"])
    check_apart({"--json": Path("/dev/null"), "--junit": Path("/dev/null")}, [])
    same = {"--json": tmp_path / "new", "--junit": tmp_path / "x" / ".." / "new"}
    with pytest.raises(InputError, match="would overwrite the output of --json"):
        check_apart(same, [])


ARENA = models_dir() / "arenas" / "clutter.xml"


def command_line(monkeypatch, capsys, *arguments):
    """Run the command in this process; return its exit code and its error line."""
    monkeypatch.setattr("sys.argv", ["simloop", "campaign", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code, capsys.readouterr().err


def test_wrong_input_leaves_nothing_behind(tmp_path, monkeypatch, capsys):
    room, out = tmp_path / "room.toml", tmp_path / "out"
    room.write_text(ROOM)
    quick = (room, "--seeds", "1", "--out", out, "--no-report")
    for arguments, match in (
        ((*quick, "--require", "colision_rate<=0"), "did you mean"),
        ((*quick, "--set", "goal=[99.0,0.0]"), "outside the arena"),
        ((*quick, "--set", "start=[99.0,0.0,0.0]"), "outside the arena"),
        ((*quick, "--json", room), "overwrite the input"),
        ((*quick, "--junit", out / "journal.jsonl"), "journal.jsonl"),
        (
            (*quick, "--junit", tmp_path / "x", "--json", tmp_path / "x"),
            "overwrite the output of --junit",
        ),
        ((*quick, "--junit", ARENA), "overwrite a file of simloop itself"),
        ((*quick, "--redo", "all"), "--redo errors"),
        ((*quick, "--compare", out, out), "--compare runs nothing"),
        ((*quick, "--dask", "nonsense://here"), "--dask"),
    ):
        code, error = command_line(monkeypatch, capsys, *arguments)
        assert code == 2 and match in error and error.count("\n") == 1, error
        assert [one.name for one in tmp_path.iterdir()] == ["room.toml"]
        assert room.read_text() == ROOM


@pytest.mark.parametrize(
    "more",
    ["--seeds 0:20", "--sweep seed=1", "--planner tlbo", "--set goal=[1,1]", "--workers 2",
     "--dask tcp://x", "--record-failures 3", "--no-report", "--repair", "open"],
)  # fmt: skip
def test_a_comparison_goes_with_json_only(tmp_path, monkeypatch, capsys, more):
    words = ["--compare", tmp_path, tmp_path, "--json", tmp_path / "x.json", *more.split()]
    code, error = command_line(monkeypatch, capsys, *words)
    what = "SCENARIO" if more == "open" else more.split()[0].replace("--no-", "--")
    assert code == 2 and f"not with {what}" in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("workers", ["-1", "257", "100000000"])
def test_the_number_of_workers_has_bounds(tmp_path, monkeypatch, capsys, workers):
    words = ("open", "--out", tmp_path / "out", "--workers", workers)
    code, error = command_line(monkeypatch, capsys, *words)
    assert code == 2 and "--workers" in error
    assert list(tmp_path.iterdir()) == []


def test_a_comparison_replaces_no_file_of_either_campaign(tmp_path, monkeypatch, capsys):
    one = spec()
    folders = [tmp_path / "o1", tmp_path / "o2"]
    names = ("journal.jsonl", "campaign.json", "report.html", "failures/open.rrd")
    for folder in folders:
        (folder / "failures").mkdir(parents=True)
        for name in names:
            (folder / name).write_text("kept")
        journal.write_results(folder, [row_of(one, "reached")])
    for folder in folders:
        for name in (*names, "results.parquet"):
            for given in (folders, [each / "results.parquet" for each in folders]):
                before = (folder / name).read_bytes()
                code, error = command_line(
                    monkeypatch, capsys, "--compare", *given, "--json", folder / name
                )
                assert code == 2 and "would overwrite" in error
                assert (folder / name).read_bytes() == before


def test_a_campaign_tells_its_errors_and_does_them_again(tmp_path, monkeypatch, capsys):
    real, wrong = execute.run_all, [1]

    def sometimes(one, observe=None):
        row = row_of(one, "error", "lightning") if one.seed in wrong else row_of(one, "reached")
        return row | {"sim_time_s": 1.0}

    here = Workers(lambda: ThreadPoolExecutor(1), 1)
    monkeypatch.setattr(runs, "local_workers", lambda count: here)
    monkeypatch.setattr(
        runs.execute,
        "run_all",
        lambda specs, where, stop, work: real(specs, where, stop, sometimes),
    )
    arguments = ("open", "--seeds", "3", "--out", tmp_path / "out", "--no-report")
    monkeypatch.setattr("sys.argv", ["simloop", "campaign", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().out
    assert ended.value.code == 1 and "1 runs ended in an error" in said and "lightning" in said
    wrong.clear()
    for more, code in ((), 1), (("--redo", "errors"), 0):
        ended = command_line(monkeypatch, capsys, *arguments, *more)
        assert ended[0] == code


def test_recordings_are_whole_or_missing(tmp_path):
    done = [(spec(overrides=("time_limit_s=0.3",)), {})]
    assert list(closer_look.record(done, tmp_path, lambda: True)) == []
    assert list(tmp_path.iterdir()) == []
    (file,) = closer_look.record(done, tmp_path)
    assert [one.name for one in tmp_path.iterdir()] == [file.name]
