"""The edge of the command line: surprises, streams, surroundings, and files to keep."""

from __future__ import annotations

import io
import json
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from simloop.cli import edge, main
from simloop.cli.kernel_cache import prepare_kernel_cache
from simloop.common.errors import InputError

SHORT = ("--set", "goal=[0.5, 0.0]")


def simloop(*arguments, shell="", **kwargs):
    command = [sys.executable, "-m", "simloop.cli", *map(str, arguments)]
    if shell:
        command = ["bash", "-c", f'"$@" {shell}', "bash", *command]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **kwargs)


def ended(command, monkeypatch, capsys, *arguments, in_test=False):
    """Run a function as the only command; return its exit code and what is on stderr."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command()(command)
    monkeypatch.setattr(sys, "argv", ["simloop", *arguments])
    if not in_test:
        monkeypatch.delenv("PYTEST_CURRENT_TEST", raising=False)
    with pytest.raises(SystemExit) as done:
        edge.run_at_edge(app)
    return done.value.code, capsys.readouterr().err


def endless():
    return endless()


def no_memory():
    raise MemoryError


def strange():
    raise ValueError("a\x1b[31m" + "b" * 5000 + "\nc")


@pytest.mark.parametrize("command", [endless, no_memory, strange])
def test_a_surprise_is_one_line_with_a_way_to_report_it(command, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(edge.tempfile, "tempdir", str(tmp_path))
    code, text = ended(command, monkeypatch, capsys)
    assert code == 70 and len(text.splitlines()) == 1 and text.strip().isprintable()
    assert "fault of simloop" in text and "report it" in text and len(text) <= 1001
    (report,) = tmp_path.iterdir()
    assert str(report) in text
    assert "Traceback" in report.read_text() and f"simloop {edge.__version__}" in report.read_text()


def test_a_surprise_shows_its_traceback_on_request_and_in_tests(monkeypatch, capsys):
    with pytest.raises(ValueError, match="bbb"):
        ended(strange, monkeypatch, capsys, in_test=True)
    with pytest.raises(ValueError, match="bbb"):
        ended(strange, monkeypatch, capsys, "--debug")
    monkeypatch.setenv("SIMLOOP_DEBUG", "1")
    with pytest.raises(ValueError, match="bbb"):
        ended(strange, monkeypatch, capsys)


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (("run", "open", "--out", ""), "--out"),
        (("run", "open", "--out="), "--out"),
        (("run", "open", "--model-path", ""), "--model-path"),
        (("run", "open", "--quiet", "--json", ""), "--json"),
        (("replay", "", "--out", "x"), "command line"),
        (("campaign", "--compare", "x", ""), "--compare"),
        (("campaign", "open", "--out", ""), "--out"),
        (("bench", "planners", "--report", ""), "--report"),
    ],
)
def test_an_empty_path_is_not_the_current_folder(tmp_path, monkeypatch, capsys, arguments, option):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["simloop", *arguments])
    with pytest.raises(SystemExit) as done:
        main.main()
    assert done.value.code == 2
    assert capsys.readouterr().err == f"error: {option}: an empty value; give a name or a path\n"
    assert list(tmp_path.iterdir()) == []


def test_errors_are_one_line_without_control_characters(monkeypatch, capsys):
    def refuse(name: str) -> int:
        raise OSError(28, "No space left on device", name)

    code, text = ended(refuse, monkeypatch, capsys, "a\x1b[2Jb")
    assert (code, text) == (2, "error: a\\x1b[2Jb: No space left on device\n")
    code, text = ended(refuse, monkeypatch, capsys, "a", "--x\x1b[2J\ny")
    assert code == 2 and len(text.splitlines()) == 1 and "\x1b" not in text

    def kept() -> int:
        error = InputError("broke")
        error.add_note("the rest is kept in x.rrd")
        raise error

    assert ended(kept, monkeypatch, capsys) == (2, "error: broke; the rest is kept in x.rrd\n")


def test_the_exit_code_is_that_of_the_run_whoever_reads(tmp_path):
    reached = ("run", "open", *SHORT, "--json", tmp_path / "a.json")
    done = simloop(*reached, shell="| true; exit ${PIPESTATUS[0]}")
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads((tmp_path / "a.json").read_text())["outcome"] == "reached"
    done = simloop("run", "open", "--set", "time_limit_s=0.2", shell=">&- 2>&- <&-")
    assert done.returncode == 1
    if os.path.exists("/dev/full"):
        done = simloop("list", shell="> /dev/full")
        assert done.returncode == 2
        assert done.stderr == "error: standard output: cannot be written: No space left on device\n"
        assert simloop("list", "--x", shell="2> /dev/full").returncode == 2


@pytest.mark.parametrize(
    "surroundings",
    [
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "TERM": "dumb"},
        {"PYTHONIOENCODING": "ascii", "NO_COLOR": "1"},
    ],
)
def test_names_beyond_ascii_in_any_surroundings(tmp_path, surroundings):
    source = Path(__file__).parents[2] / "scenarios" / "open.toml"
    scenario = tmp_path / "zürich.toml"
    shutil.copy(source, scenario)
    done = simloop(
        "run", scenario, *SHORT, "--json", tmp_path / "ü.json", env=os.environ | surroundings
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "ü.json").exists() and "\x1b" not in done.stdout


def test_kernels_find_a_folder_where_home_cannot_be_written(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")  # so that it is restored at the end
    assert prepare_kernel_cache() is None  # this package can be written
    package = tmp_path / "package"
    (package / "common").mkdir(parents=True)
    (package / "common" / "__pycache__").write_text("no folder")
    (tmp_path / "home").write_text("no folder")
    monkeypatch.setattr("simloop.cli.kernel_cache._PACKAGE", package)
    monkeypatch.setattr("simloop.cli.kernel_cache.tempfile.tempdir", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    note = prepare_kernel_cache()
    folder = Path(os.environ["NUMBA_CACHE_DIR"])
    assert folder.parent == tmp_path and str(folder) in note
    assert folder.stat().st_mode & 0o777 == 0o700
    # A folder of that name that others can write is not trusted, as kernels in it are executed.
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    folder.chmod(0o777)
    prepare_kernel_cache()
    assert Path(os.environ["NUMBA_CACHE_DIR"]) != folder
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "home" / "x"))
    with pytest.raises(InputError, match=r"NUMBA_CACHE_DIR=.*cannot be written"):
        prepare_kernel_cache()


def ends_too_soon():
    pickle.loads(b"")


def asks():
    typer.prompt("sure")


def test_only_a_prompt_takes_the_end_of_its_input_for_ctrl_c(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(edge.tempfile, "tempdir", str(tmp_path))
    code, text = ended(ends_too_soon, monkeypatch, capsys)
    assert code == 70 and "EOFError" in text
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    code, text = ended(asks, monkeypatch, capsys)
    assert code == 130 and "interrupted" in text


KERNEL = """
from simloop.cli.main import run_command
def command() -> int:
    from kernels import twice
    return twice(2.0)
run_command(command)
"""


@pytest.mark.parametrize("damage", ["index empty", "kernel zeroed"])
def test_kernels_that_were_cut_short_are_compiled_again(tmp_path, damage):
    (tmp_path / "kernels.py").write_text(
        "from numba import njit\n@njit(cache=True)\ndef twice(x):\n    return int(2.0 * x)\n"
    )
    (tmp_path / "go.py").write_text(KERNEL)
    cache = tmp_path / "cache"

    def go():
        done = subprocess.run(
            [sys.executable, tmp_path / "go.py"],
            capture_output=True,
            text=True,
            timeout=300,
            env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        )
        return done.returncode, done.stderr

    assert go() == (4, "")
    what, how = damage.split()
    (path,) = cache.rglob("*.nbi" if what == "index" else "*.nbc")
    whole = path.read_bytes()
    path.write_bytes(b"" if how == "empty" else bytes(len(whole)))
    code, text = go()
    assert code == 4 and text.startswith("note: 1 damaged file") and str(cache) in text
    assert go() == (4, "")
    path.write_bytes(b"no pickle.")  # only numba can tell that this is damaged
    code, text = go()
    assert code == 70 and len(text.splitlines()) == 1 and str(cache) in text and "delete" in text


@pytest.mark.parametrize(
    "command", [("campaign", "open", "--out", "out"), ("certify",), ("bench", "faults")]
)
def test_every_command_names_an_off_screen_back_end_that_is_not_there(tmp_path, command):
    done = simloop(*command, cwd=tmp_path, env=os.environ | {"MUJOCO_GL": "foo"})
    assert done.returncode == 2 and done.stderr.startswith("error: MUJOCO_GL=foo: cannot be")


def test_no_output_replaces_a_file_that_the_run_reads(tmp_path):
    (tmp_path / "room.pgm").write_bytes(b"P5\n40 40\n255\n" + b"\xfe" * 1600)
    (tmp_path / "room.yaml").write_text(
        "image: room.pgm\nresolution: 0.1\norigin: [-1.0, -2.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    )
    (tmp_path / "s.toml").write_text('arena = "room.yaml"\nstart = [0, 0, 0]\ngoal = [1.0, 0.0]\n')
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    os.link(tmp_path / "room.pgm", tmp_path / "hard.json")
    (tmp_path / "soft.json").symlink_to("room.yaml")
    for option, name in (
        ("--json", "room.pgm"),
        ("--json", "hard.json"),
        ("--record", "soft.json"),
        ("--json", "s.toml"),
        ("--record", "room.yaml"),
    ):
        with pytest.raises(InputError, match="would overwrite"):
            main.run_scenario(
                str(tmp_path / "s.toml"), **{OPTIONS[option]: tmp_path / name}, quiet=True
            )
    assert all(path.read_bytes() == content for path, content in before.items())


OPTIONS = {"--json": "json_file", "--record": "record"}


def test_simloops_own_files_are_not_outputs(tmp_path):
    model = Path(__file__).parents[2] / "models" / "tracked_ugv.xml"
    before = model.read_bytes()
    for command in (("certify",), ("bench", "faults"), ("run", "open")):
        done = simloop(*command, "--json", model)
        assert done.returncode == 2 and "would overwrite" in done.stderr
    assert model.read_bytes() == before


def test_a_run_that_breaks_keeps_what_was_recorded_and_no_half(tmp_path, monkeypatch):
    from simloop.evaluation.metrics import RunMetrics

    def broken(self, **_):
        raise ZeroDivisionError("by surprise")

    (tmp_path / "result.json").write_text("of an earlier run")
    monkeypatch.setattr("simloop.loop.warm_up", lambda *_: 0)
    monkeypatch.setattr(RunMetrics, "result", broken)
    with pytest.raises(ZeroDivisionError) as caught:
        main.run_scenario("open", overrides=["time_limit_s=0.5"], out=tmp_path, quiet=True)
    (kept,) = tmp_path.glob("run.partial-*.rrd")
    assert str(kept) in caught.value.__notes__[0] and not (tmp_path / "run.rrd").exists()
    assert (tmp_path / "result.json").read_text() == "of an earlier run"
    assert not (tmp_path / "config.toml").exists()  # it would not belong to that result


def test_two_runs_into_one_folder_are_refused(tmp_path):
    from simloop.common.files import folder_lock

    with folder_lock(tmp_path):
        done = simloop("run", "open", *SHORT, "--out", tmp_path)
    assert done.returncode == 2 and "another process is writing there" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["snapshots"]


def test_ctrl_c_is_heard_while_exact_optima_are_computed(tmp_path, monkeypatch, capsys):
    from simloop.recording.watch import Watch

    compute = Watch.plan_figures

    def stopped(self, stop, show):
        assert self.plan_count[1] > 1

        def count(so_far):
            show(so_far)
            signal.raise_signal(signal.SIGINT)  # while the optima are computed, after the first

        return compute(self, stop, count)

    monkeypatch.setattr(Watch, "plan_figures", stopped)
    file = tmp_path / "x.json"
    shorter = ("--set", "time_limit_s=3")
    monkeypatch.setattr(sys, "argv", ["simloop", "run", "trap", *shorter, "--json", str(file)])
    with pytest.raises(SystemExit) as done:
        main.main()
    # The run had ended before, so that the exit code is its own, and its figures are kept.
    assert done.value.code == 1
    costs = [plan["exact_cost"] for plan in json.loads(file.read_text())["plans"]]
    assert costs[0] is not None and set(costs[1:]) == {None}
    assert f"1 of {len(costs)} plans are compared" in capsys.readouterr().err


def run_into(error):
    raise error


def test_a_script_ends_as_a_command_does(monkeypatch, capsys):
    for script, ends in ((lambda: 1, 1), (lambda: None, 0), (lambda: sys.exit(2), 2)):
        with pytest.raises(SystemExit) as done:
            edge.run_script(script)
        assert done.value.code == ends
    with pytest.raises(SystemExit) as done:
        edge.run_script(lambda: run_into(InputError("no such file")))
    assert done.value.code == 2 and capsys.readouterr().err == "error: no such file\n"


def test_every_script_that_imports_simloop_is_at_the_edge():
    scripts = Path(__file__).resolve().parents[2] / "scripts"
    for path in scripts.glob("*.py"):
        text = path.read_text(encoding="utf-8")
        if "__main__" in text and re.search(r"^\s*(from|import) simloop", text, re.MULTILINE):
            last = text.rpartition("__main__")[2]
            at_edge = re.search(r"run_script\(|run_command\(|run_at_edge\(", last)
            assert at_edge or "from simloop.cli.main import main\n" in text, path.name


@pytest.mark.slow
def test_a_run_without_compiled_kernels():
    done = simloop(
        "run",
        "experiment",
        "--set",
        "time_limit_s=0.3",
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
    )
    assert done.returncode == 1 and "out of time" in done.stdout, done.stderr
