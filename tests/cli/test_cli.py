"""The command line from outside: exit codes, one-line errors, output files, Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rich.console import Console

from simloop import __version__
from simloop.cli.outputs import choose
from simloop.cli.tables import print_result
from simloop.common.errors import InputError

SHORT = ("--set", "goal=[0.5, 0.0]")


def simloop(*arguments, cwd=None, **kwargs):
    command = [sys.executable, "-m", "simloop.cli", *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=300, cwd=cwd, check=False, **kwargs
    )


def test_list_names_everything_that_can_be_chosen():
    out = simloop("list").stdout
    for name in ("scenarios", "experiment", "clutter", "corridor", "trap", "planners", "tlbo"):
        assert name in out
    assert "\x1b" not in out  # nobody is at a terminal: no colours


@pytest.mark.parametrize("argument", ["list", "--help"])
def test_nothing_slow_is_imported_for_help_and_list(argument):
    code = (
        f"import sys; sys.argv = ['simloop', {argument!r}]\n"
        "from simloop.cli.main import main\n"
        "try: main()\nexcept SystemExit: pass\n"
        "print([m for m in ('numpy', 'numba', 'mujoco', 'cv2', 'rerun') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_version():
    assert simloop("--version").stdout.strip() == f"simloop {__version__}"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run", "experimnt"], "did you mean 'experiment'?"),
        (["run", "none.toml"], "none.toml: no such file"),
        (["run", "experiment", "--planner", "rrt"], "unknown planner 'rrt'; choices: abc, "),
        (["run", "experiment", "--set", "goal=[2.05,0.55]"], "inside obstacle_02"),
        (["run", "experiment", "--set", "goal=[50,50]"], "outside the arena"),
        (["run", "experiment", "--set", "rates.lidar_s=-1"], "must be greater than"),
        (["run", "experiment", "--set", "rates.lidar_s=0.105"], "not a whole multiple"),
        (["run", "experiment", "--set", "goal=[nan,1]"], "must be a finite number"),
        (["run", "experiment", "--seed", "x"], "--seed"),
        (["run", "experiment", "--sed", "1"], "--sed"),
        (["run"], "error:"),
        (["bench", "loop", "--scenario", "opn"], "did you mean 'open'?"),
        (["frobnicate"], "frobnicate"),
    ],
)
def test_wrong_input_is_one_line_exit_2_and_nothing_written(tmp_path, arguments, expected):
    outputs = ["--json", tmp_path / "r" / "x.json", "--record", tmp_path / "r" / "x.rrd"]
    done = simloop(*arguments, *(outputs if arguments[:1] == ["run"] else []))
    assert done.returncode == 2
    assert expected in done.stderr and len(done.stderr.strip().splitlines()) == 1
    assert done.stdout == "" and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", ["--json", "--record", "--snapshots", "--out"])
def test_an_output_that_cannot_be_written_is_refused_before_the_run(tmp_path, option):
    (tmp_path / "file").write_text("mine")
    began = time.perf_counter()
    done = simloop("run", "experiment", option, tmp_path / "file" / "below")
    assert done.returncode == 2 and time.perf_counter() - began < 10
    assert f"error: {option}" in done.stderr and "is not a directory" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_no_output_takes_the_place_of_another_or_of_the_scenario(tmp_path):
    mine = tmp_path / "mine.config.toml"
    mine.write_text("mine")
    for outputs, what in (
        (choose(None, None, None, tmp_path / "mine.json"), "the scenario itself"),
        (choose(None, None, None, mine), "the scenario itself"),
        (choose(None, mine, None, None), "the scenario itself"),
        (choose(None, tmp_path / "x", None, tmp_path / "x"), "the output of --record"),
    ):
        with pytest.raises(InputError, match=f"would overwrite {what}"):
            outputs.check(mine)
    choose(None, tmp_path / "y", None, tmp_path / "x").check(mine)
    with pytest.raises(InputError, match="not a file"):
        choose(None, None, None, Path(""))


def test_a_device_or_a_pipe_gets_no_config_beside_it(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(os.devnull)
    for result in (Path(os.devnull), tmp_path / "pipe", tmp_path / "link"):
        assert choose(None, None, None, result).config is None
        assert choose(tmp_path, None, None, result).config == tmp_path / "config.toml"
    assert choose(None, None, None, tmp_path / "x.json").config == tmp_path / "x.config.toml"


def test_a_graphics_back_end_that_cannot_be_loaded_is_one_line(tmp_path):
    done = simloop("run", "open", "--json", tmp_path / "x", env=os.environ | {"MUJOCO_GL": "none"})
    assert done.returncode == 2 and done.stderr.startswith("error: MUJOCO_GL=none: cannot be")
    assert len(done.stderr.splitlines()) == 1 and list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_a_recording_that_cannot_begin_leaves_nothing(tmp_path):
    done = simloop("run", "open", *SHORT, "--record", "/dev/full", "--json", tmp_path / "x.json")
    assert done.returncode == 2 and "cannot record to /dev/full" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_checking_outputs_leaves_no_trace(tmp_path):
    outputs = choose(tmp_path / "a" / "b", None, None, None)
    outputs.check()
    assert list(tmp_path.iterdir()) == []
    outputs.prepare()
    assert outputs.snapshots.is_dir() and outputs.config == tmp_path / "a" / "b" / "config.toml"


def test_a_run_gives_figures_and_a_config_that_gives_the_same_run(tmp_path):
    first = simloop("run", "open", *SHORT, "--json", tmp_path / "a.json", cwd=tmp_path)
    assert first.returncode == 0, first.stderr
    assert "goal reached" in first.stdout and "\x1b" not in first.stdout
    again = simloop("run", tmp_path / "a.config.toml", "--json", tmp_path / "b.json", "--quiet")
    assert again.returncode == 0 and again.stdout == "" and again.stderr == ""
    a, b = (json.loads((tmp_path / name).read_text()) for name in ("a.json", "b.json"))
    assert a["outcome"] == "reached" and a["state_hash"] == b["state_hash"]
    for figures in (a, b):
        for measured in ("wall_time_s", "real_time_factor", "plan_ms_p50", "plan_ms_p99"):
            assert figures.pop(measured) > 0.0
    assert a == b


def test_another_seed_is_another_run(tmp_path):
    hashes = set()
    for seed in (0, 1):
        file = tmp_path / f"{seed}.json"
        simloop("run", "open", *SHORT, "--seed", seed, "--json", file)
        hashes.add(json.loads(file.read_text())["state_hash"])
    assert len(hashes) == 2


def test_a_robot_that_fails_is_exit_code_1(tmp_path):
    done = simloop("run", "open", "--set", "time_limit_s=0.5", "--json", tmp_path / "x.json")
    assert done.returncode == 1 and "out of time" in done.stdout
    assert json.loads((tmp_path / "x.json").read_text())["outcome"] == "timeout"


def test_a_second_process_compiles_nothing():
    arguments = ("run", "open", "--set", "time_limit_s=0.1")
    assert simloop(*arguments).returncode == 1  # compiles whatever there is to compile
    done = simloop(*arguments)
    assert done.returncode == 1 and "compiling" not in done.stderr


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_keeps_what_there_is(tmp_path, sent):
    command = [sys.executable, "-m", "simloop.cli", "run", "open", "--json", tmp_path / "x.json"]
    command += ["--set", "rates.physics_s=0.00002"]  # a hundred times the work: slow enough
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while not (tmp_path / "x.config.toml").exists() and process.poll() is None:
        time.sleep(0.05)
    time.sleep(1.0)
    process.send_signal(sent)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "interrupted" in out and "Traceback" not in err
    assert json.loads((tmp_path / "x.json").read_text())["outcome"] == "interrupted"


METRICS = {
    "outcome": "reached", "sim_time_s": 20.0, "wall_time_s": 0.5, "real_time_factor": 40.0,
    "path_length_m": 5.5, "shortest_path_m": 5.0, "spl": 0.909, "min_clearance_m": 0.12,
    "contact_count": 0, "ate_rmse_m": 0.01, "yaw_rmse_rad": 0.0174533, "nees_mean": 2.9,
    "replans": 12, "plan_ms_p50": 1.5, "plan_ms_p99": 4.0, "plan_evaluations": 123456,
    "energy_j": 321.0, "state_hash": "0123456789abcdef", "seed": 3, "scenario": "[odd] name",
    "planner": "tlbo",
}  # fmt: skip


def printed(draw):
    console = Console(width=40, force_terminal=False)
    with console.capture() as capture:
        draw(console)
    return capture.get()


def test_the_table_of_results_reads_well():
    text = printed(lambda console: print_result(console, METRICS))
    assert text.startswith("[odd] name, seed 3, planner tlbo: goal reached")
    assert "shortest safe path 5.00 m (1.10 x)" in text and "1.000 deg" in text
    assert "123,456 evaluations" in text and "\x1b" not in text


def test_the_table_of_results_bears_missing_figures():
    missing = dict.fromkeys(
        ("real_time_factor", "shortest_path_m", "min_clearance_m", "ate_rmse_m", "yaw_rmse_rad",
         "nees_mean", "plan_ms_p50", "plan_ms_p99")
    )  # fmt: skip
    assert "none" in printed(lambda console: print_result(console, METRICS | missing))


def test_the_benchmark_of_the_loop(tmp_path):
    done = simloop(
        "bench", "loop", "--scenario", "open", "--repeats", 1, *SHORT, "--json", tmp_path / "b.json"
    )
    assert done.returncode == 0, done.stderr
    figures = json.loads((tmp_path / "b.json").read_text())
    for name in ("real_time_factor", "real_time_factor_recording", "step_us", "lidar_scan_us"):
        assert figures[name] > 0.0
    assert figures["plant_only_ratio"] > 1.0
    assert sum(stage["share"] for stage in figures["stages"].values()) < 1.1
    for stage in figures["stages"].values():
        assert 0.0 < stage["mean_ms"] <= stage["worst_ms"]
    assert figures["stages"]["plant"]["calls"] > 0 and figures["outcome"] == "reached"


def test_standard_output_is_refused_where_it_is_not_supported(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = simloop("run", "open", "--json", "-")
    assert done.returncode == 2
    assert "--json -: standard output is not supported here" in done.stderr
    assert list(tmp_path.iterdir()) == []
