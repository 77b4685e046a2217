"""The BARN benchmark: reading worlds, the referee, the figures."""

from __future__ import annotations

import gzip
import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import barn
import barn_worlds

from simloop.common.errors import InputError

WORLD = {
    "cyl": [[-2.2, 5.0], [-1.0, 6.0]],
    "radius": 0.075,
    "start": [-2.25, 3.0, 1.5708],
    "goal": [-2.25, 6.0],
    "path_len": 3.1,
}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "worlds.json.gz"
    path.write_bytes(gzip.compress(json.dumps({"7": WORLD}).encode()))
    return path


def test_a_world_is_driven_and_judged(file):
    course = barn_worlds.read_worlds(file)["7"]
    run = barn.run_one(course, (), 0)
    assert run.outcome == "reached" and 3.0 < run.time_s < 10.0
    assert run.time_over_limit == pytest.approx(run.time_s / (3.1 / 0.47))
    assert run.score == pytest.approx(1.55 / min(max(run.time_s, 3.1), 12.4))
    assert barn.run_one(course, (), 0) == run


def test_the_clock_starts_after_a_tenth_of_a_metre_and_the_first_event_counts(file, monkeypatch):
    monkeypatch.setattr(barn, "Truth", SimpleNamespace)
    course = barn_worlds.read_worlds(file)["7"]

    def at(t_s, y, contacts=0):
        return SimpleNamespace(
            t_ns=round(t_s * 1e9), pose_xyyaw=np.array([-2.25, y, 0.0]), contact_count=contacts
        )

    def end(*messages):
        referee = barn.Referee(course)
        for message in messages:
            referee.offer(message)
        return referee.outcome, referee.time_s

    assert end(at(5, 3.05), at(6, 3.11), at(9, 4.99)) == ("", 3.0)
    assert end(at(6, 3.11), at(9, 5.01), at(10, 5.5, 1)) == ("reached", 3.0)
    assert end(at(6, 3.11), at(9, 4.0, 1), at(10, 5.5)) == ("collision", 3.0)
    assert end(at(6, 3.11), at(106, 4.0)) == ("timeout", 100.0)


def test_figures_are_rates_over_all_runs_and_means_over_those_that_arrived():
    runs = [
        barn.Run("1", 0, "reached", 10.0, 0.5, 0.8),
        barn.Run("1", 1, "collision", 4.0, 0, 0.3),
        barn.Run("2", 0, "stuck", 9.0, 0.0, 0.7),
        barn.Run("2", 1, "reached", 20.0, 0.3, 1.2),
    ]
    found = barn.figures(runs)
    assert (found["success_rate"], found["collision_rate"], found["timeout_rate"]) == (
        0.5, 0.25, 0.25,
    )  # fmt: skip
    assert found["time_mean_s"] == 15.0 and found["time_over_limit"] == pytest.approx(1.0)
    assert found["score_official"] == pytest.approx(0.2)
    assert [world["world"] for world in found["per_world"]] == ["1", "2"]


@pytest.mark.parametrize("text", ["", "[]", "{", '{"1": {}}', '{"1": 3}'])
def test_a_file_that_holds_no_worlds_is_refused(tmp_path, text):
    path = tmp_path / "rubbish.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"rubbish\.json: not a file of BARN worlds"):
        barn_worlds.read_worlds(path)


SDF = """<sdf version="1.6"><world name="w">{}</world></sdf>"""
POST = (
    '<model name="unit_cylinder_{}"><pose>{} {} 0.4 0 0 0</pose><link name="l"><collision name="c">'
    "<geometry><cylinder><radius>0.075</radius><length>0.8</length></cylinder></geometry>"
    "</collision></link></model>"
)


def test_a_folder_of_gazebo_worlds_gives_the_same_courses_as_json(tmp_path):
    posts = "".join(POST.format(k, x, y) for k, (x, y) in enumerate(WORLD["cyl"]))
    (tmp_path / "world_12.world").write_text(SDF.format(posts))
    course = barn_worlds.read_worlds(tmp_path)["12"]
    assert course.cylinders_m == ((-2.2, 5.0), (-1.0, 6.0)) and course.radius_m == 0.075
    assert course.path_length_m == pytest.approx(10.0, abs=0.2)  # around one post
    np.save(tmp_path / "path_12.npy", np.array([[24, 0], [24, 10]]))
    corners = [[-2.25, 3.0], [-0.975, 5.075], [-0.975, 6.575], [-2.25, 13.0]]
    length = float(np.hypot(*np.diff(corners, axis=0).T).sum())
    assert barn_worlds.read_worlds(tmp_path)["12"].path_length_m == pytest.approx(length)


def folder_of_worlds(folder, names=("12",)):
    folder.mkdir(parents=True, exist_ok=True)
    posts = "".join(POST.format(k, x, y) for k, (x, y) in enumerate(WORLD["cyl"]))
    for name in names:
        (folder / f"world_{name}.world").write_text(SDF.format(posts))


@pytest.mark.parametrize(
    ("worlds", "paths"),
    [
        (".", "."),
        (".", "path_files"),
        ("world_files", "path_files"),  # the data set
        ("jackal_helper/worlds/BARN", "jackal_helper/worlds/BARN/path_files"),  # the challenge
    ],
)
def test_worlds_and_paths_are_found_in_the_organisers_layouts(tmp_path, worlds, paths):
    folder_of_worlds(tmp_path / worlds)
    (tmp_path / paths).mkdir(exist_ok=True)
    np.save(tmp_path / paths / "path_12.npy", np.array([[24, 0], [24, 10]]))
    course = barn_worlds.read_worlds(tmp_path)["12"]
    assert course.yardstick == barn_worlds.ORGANISERS
    assert course.path_length_m == pytest.approx(10.4857, abs=1e-4)
    assert barn.yardsticks([course]) == ["yardstick of 1 of 1 worlds: the organisers' own paths"]


def test_without_the_organisers_path_the_other_yardstick_is_said(tmp_path):
    folder_of_worlds(tmp_path)
    course = barn_worlds.read_worlds(tmp_path)["12"]
    assert course.yardstick == barn_worlds.SHORTEST
    (line,) = barn.yardsticks([course])
    assert "shortest path for this robot" in line and "not comparable" in line
    np.save(tmp_path / "path_12.npy", np.array([[24, 0], [24, 10]]))
    other = tmp_path / "elsewhere"
    other.mkdir()
    assert barn_worlds.read_worlds(tmp_path, paths=other)["12"] == course


def test_only_the_chosen_worlds_are_computed(tmp_path, monkeypatch):
    folder_of_worlds(tmp_path, [str(k) for k in range(30)])
    made, told = [], []
    monkeypatch.setattr(
        barn_worlds, "_shortest_length_m", lambda course: made.append(course.name) or 10.0
    )
    found = barn_worlds.read_worlds(
        tmp_path, ["7", "3"], progress=lambda done, count: told.append((done, count))
    )
    assert list(found) == made == ["7", "3"] and told == [(1, 2), (2, 2)]
    with pytest.raises(InputError, match="--indices 30: no such world"):
        barn_worlds.read_worlds(tmp_path, ["30"])


def lying_npy(shape):
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".encode()
    head = head.ljust(118 - 10) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"rubbish",
        lying_npy("(999999999999, 2)"),
        lying_npy("(10, 2)"),
        lying_npy("(3,)") + bytes(24),
        lying_npy("(1, 2)") + np.array([np.nan, 1.0]).tobytes(),
        lying_npy("(1, 2)") + np.array([1e300, 1.0]).tobytes(),
    ],
)
def test_a_path_that_is_none_is_refused(tmp_path, data):
    folder_of_worlds(tmp_path)
    (tmp_path / "path_12.npy").write_bytes(data)
    with pytest.raises(InputError, match=r"path_12\.npy: not an array of cells"):
        barn_worlds.read_worlds(tmp_path)


@pytest.mark.parametrize(
    "change",
    [
        {"cyl": [[1]]},
        {"cyl": [[1, "x"]]},
        {"radius": -1},
        {"radius": float("nan")},
        {"start": [1, 2]},
        {"goal": [float("inf"), 2]},
        {"path_len": 0},
        {"cyl": 3},
    ],
)
def test_a_world_of_wrong_values_is_refused(tmp_path, change):
    path = tmp_path / "wrong.json"
    path.write_text(json.dumps({"7": {**WORLD, **change}}))
    with pytest.raises(InputError, match=r"not a file of BARN worlds: world 7"):
        barn_worlds.read_worlds(path)


def test_a_packed_file_is_not_unpacked_without_end(tmp_path):
    path = tmp_path / "bomb.json.gz"
    path.write_bytes(gzip.compress(bytes(70 * 2**20)))
    with pytest.raises(InputError, match=r"bomb\.json\.gz: size, unpacked"):
        barn_worlds.read_worlds(path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InputError, match="not a file of BARN worlds"):
        barn_worlds.read_worlds(path)


def test_the_script_reports_wrong_input_in_one_line(tmp_path):
    script = Path(barn.__file__)
    (tmp_path / "none.json").write_text("{}")
    for args in (["--worlds", tmp_path], ["--worlds", tmp_path / "none.json"], ["--wurlds", "x"]):
        ran = subprocess.run([sys.executable, script, *args], capture_output=True, text=True)
        assert ran.returncode == 2 and len(ran.stderr.strip().splitlines()) == 1, ran.stderr


@pytest.mark.parametrize("paths", [".", "path_files", "elsewhere"])
def test_no_output_replaces_a_world_or_a_path(tmp_path, paths):
    folder_of_worlds(tmp_path, ("0", "1"))
    (tmp_path / paths).mkdir(exist_ok=True)
    np.save(tmp_path / paths / "path_1.npy", np.array([[24, 0], [24, 10]]))
    given = tmp_path / paths if paths == "elsewhere" else None
    for file in (tmp_path / "world_1.world", tmp_path / paths / "path_1.npy"):
        before = file.read_bytes()
        with pytest.raises(InputError, match=r"--json .* would overwrite"):
            barn.main(tmp_path, indices=["0"], paths=given, json_file=file)
        assert file.read_bytes() == before
