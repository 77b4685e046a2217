"""What was left out of a world or assumed is said by every command that builds it."""

import io

import numpy as np
import pytest
from rich.console import Console

from simloop.benchmarks import loop_speed
from simloop.campaign.spec import Request
from simloop.campaign.work import check_worlds
from simloop.cli import bench, campaign
from simloop.cli.runs import How
from simloop.cli.world import build_shown
from simloop.scenario.load import load
from simloop.worlds.map_server_world import read_map_world

NOTE = "hall.yaml: 100 % of the map is unknown: it counts as free"


def write_map(folder, unknown_rows, yaw=0.0):
    """Write a map of ten rows with some that are unknown, and a scenario in it."""
    cells = np.full((60, 60), 254, np.uint8)
    cells[: 6 * unknown_rows] = 205
    (folder / "hall.pgm").write_bytes(b"P5\n60 60\n255\n" + cells.tobytes())
    (folder / "hall.yaml").write_text(
        f"image: hall.pgm\nresolution: 0.1\norigin: [0, 0, {yaw}]\nnegate: 0\n"
    )
    (folder / "hall.toml").write_text(
        'start = [2.0, 2.0, 0.0]\ngoal = [3.0, 2.0]\narena = "hall.yaml"\n'
    )
    return folder / "hall.toml"


@pytest.mark.parametrize(("rows", "said"), [(0, None), (5, None), (6, "60 %"), (10, "100 %")])
@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_a_map_of_which_most_is_unknown_is_said(tmp_path, rows, said, yaw):
    write_map(tmp_path, rows, yaw)
    notes = read_map_world(tmp_path / "hall.yaml").notes
    told = () if said is None else (f"hall.yaml: {said} of the map is unknown: it counts as free",)
    assert notes == told


def test_run_and_bench_say_it(tmp_path, monkeypatch, capsys):
    scenario = write_map(tmp_path, 10)
    shown = io.StringIO()
    world = build_shown(load(scenario), Console(file=shown, width=20))
    assert shown.getvalue() == f"note: {NOTE}\n" and world.notes == (NOTE,)
    given = []
    monkeypatch.setattr(loop_speed, "run", lambda *args: given.append(args[-1]) or {})
    monkeypatch.setattr(loop_speed, "print_figures", lambda console, figures: None)
    bench.bench_loop(scenario=str(scenario), repeats=1)
    assert given[0].notes == (NOTE,)
    assert f"note: {NOTE}\n" in capsys.readouterr().err


def test_a_campaign_says_it_once_for_each_scenario(tmp_path, capsys):
    (tmp_path / "other").mkdir()
    names = tuple(str(write_map(one, 10)) for one in (tmp_path, tmp_path / "other"))
    request = Request(names, (0, 2), ("tlbo",), (), ("time_limit_s=5,6",))
    assert check_worlds(request.cells(), (0, 2)) == tuple(f"{name}: {NOTE}" for name in names)

    class Journal:
        notes = ()
        missing = staticmethod(lambda specs: specs)

    campaign._prepare(Journal(), request, request.runs(), How(1))
    said = capsys.readouterr().err.splitlines()
    assert [line for line in said if line.startswith("note:")] == [
        f"note: {name}: {NOTE}" for name in names
    ]
