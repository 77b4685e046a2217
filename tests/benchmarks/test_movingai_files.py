"""Maps from files: valid files are read, everything else is refused in one line."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from helpers.shared_cases import shared_case
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageOps

from simloop.benchmarks.planners.judge import clearance
from simloop.benchmarks.planners.map_files import (
    CELL_M,
    load_file,
    parse_map,
    parse_scenario,
    read_image,
)
from simloop.benchmarks.planners.trials import settings as trial_settings
from simloop.benchmarks.planners.trials import try_once
from simloop.cli.main import main
from simloop.common.errors import InputError

MAP = "type octile\nheight 4\nwidth 6\nmap\n......\n.@@T..\n.@..W.\n......\n"
SCEN = "version 1\n0\tm.map\t6\t4\t0\t0\t5\t3\t8.5\n1\tm.map\t6\t4\t0\t3\t2\t2\t4.0\n"


def text_of(blocked):
    rows = ["".join("@" if cell else "." for cell in row) for row in blocked]
    return f"type octile\nheight {len(rows)}\nwidth {len(rows[0])}\nmap\n" + "\n".join(rows) + "\n"


@given(
    st.integers(1, 8).flatmap(
        lambda w: st.lists(st.lists(st.booleans(), min_size=w, max_size=w), min_size=1, max_size=8)
    )
)
def test_a_written_map_is_read_back(cells):
    blocked = np.array(cells)
    assert np.array_equal(parse_map(text_of(blocked), "m.map"), blocked)


@settings(max_examples=300)
@given(st.text(max_size=200) | st.binary(max_size=200).map(lambda b: b.decode("latin-1")))
def test_arbitrary_text_is_refused_in_one_line(text):
    for parse in (parse_map, parse_scenario):
        with pytest.raises(InputError) as error:
            parse(text, "x")
        assert "\n" not in str(error.value)


@settings(max_examples=300)
@given(at=st.integers(0, len(MAP) - 1), char=st.characters(max_codepoint=300))
def test_a_map_with_one_changed_character_is_read_or_refused(at, char):
    try:
        found = parse_map(MAP[:at] + char + MAP[at + 1 :], "m.map")
    except InputError as error:
        assert str(error).startswith("m.map: ") and "\n" not in str(error)
    else:
        assert found.dtype == bool and found.ndim == 2


@settings(max_examples=300)
@given(at=st.integers(0, len(SCEN) - 1), char=st.characters(max_codepoint=300))
def test_a_scenario_with_one_changed_character_is_read_or_refused(at, char):
    try:
        found = parse_scenario(SCEN[:at] + char + SCEN[at + 1 :], "m.scen")
    except InputError as error:
        assert str(error).startswith("m.scen: ") and "\n" not in str(error)
    else:
        assert all(min(*task.start, *task.goal) >= 0 for task in found)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (MAP.replace("height 4", "height x"), "line 2: expected one whole number"),
        (MAP.replace("height 4", "height 9"), "4 rows, but its height is 9"),
        (MAP.replace(".@..W.", ".@..W"), "line 7: 5 cells, but the width is 6"),
        (MAP.replace("T", "x"), "line 6: unknown cell 'x'"),
        (MAP.replace("width 6", "width 9999999"), "not between"),
    ],
)
def test_a_wrong_map_is_refused_with_the_line_and_the_reason(text, message):
    with pytest.raises(InputError, match=message):
        parse_map(text, "m.map")


def test_a_map_with_its_scenario_gives_tasks_in_the_right_place_and_scale(tmp_path):
    (tmp_path / "m.map").write_text(MAP)
    (tmp_path / "m.map.scen").write_text(SCEN)
    first, second = load_file(tmp_path / "m.map")
    assert np.allclose(first.start[:2], [0.5 * CELL_M, 3.5 * CELL_M])
    assert np.allclose(first.goal, [5.5 * CELL_M, 0.5 * CELL_M])
    assert np.allclose(second.goal, [2.5 * CELL_M, 1.5 * CELL_M])
    # The centre of the first cell is half a cell from the wall around the map.
    assert clearance(first, np.array([first.start[:2]] * 2)) == pytest.approx(0.5 * CELL_M)
    rows, cols = np.array(first.start[1::-1] - first.world.origin_m[::-1]) // (CELL_M / 4)
    field = first.world.distance_m[int(rows), int(cols)]
    assert field == pytest.approx(0.5 * CELL_M, abs=CELL_M / 4)
    assert len(load_file(tmp_path / "m.map.scen")) == 2


def test_a_scenario_names_its_map_in_a_column(tmp_path):
    """As those of the MAPF benchmark do: empty-8-8-random-1.scen is on empty-8-8.map."""
    (tmp_path / "m.map").write_text(MAP)
    (tmp_path / "m-random-1.map").write_text(MAP.replace("@", "."))
    for name in ("m.map", "maps/m.map", "..\\\\up\\\\m.map", "/far/m.map"):
        (tmp_path / "m-random-1.scen").write_text(SCEN.replace("m.map", name))
        one, _ = load_file(tmp_path / "m-random-1.scen")
        assert len(one.boxes_m) == len(load_file(tmp_path / "m.map")[0].boxes_m)
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "m.map").write_text(MAP.replace("T", "."))
    (tmp_path / "m-random-1.scen").write_text(SCEN.replace("m.map", "maps/m.map"))
    inside = load_file(tmp_path / "m-random-1.scen")[0]
    assert len(inside.boxes_m) == len(one.boxes_m)
    assert not np.array_equal(inside.boxes_m, one.boxes_m)


@pytest.mark.parametrize(
    ("scenario", "said"),
    [
        (SCEN.replace("m.map", "other.map"), "line 2: its tasks are on other.map, not on"),
        (SCEN.replace("1\tm.map", "1\to.map"), "line 3: is on o.map, the ones before on m.map"),
        (
            SCEN.replace("\t6\t4", "\t12\t8"),
            "task 1 is on a map of 12 x 8 cells, but m.map has 6 x 4",
        ),
        (SCEN.replace("8.5", "nan"), "line 2: column 9 must be a length"),
        (SCEN.replace("\t5\t3", "\t5\t1_0"), "line 2: columns 3 to 8 must be whole numbers"),
        (SCEN.replace("\t5\t3", "\t5\t" + "9" * 5000), "columns 3 to 8 must be whole numbers"),
        (SCEN + "2\tm.map\t6\t4\t0\t3\t2\t2\t4\n" * 100_000, "more than 100,000 tasks"),
    ],
)
def test_a_scenario_that_does_not_fit_its_map_is_refused(tmp_path, scenario, said):
    (tmp_path / "m.map").write_text(MAP)
    (tmp_path / "m.map.scen").write_text(scenario)
    with pytest.raises(InputError, match=said) as error:
        load_file(tmp_path / "m.map")
    assert "\n" not in str(error.value) and len(str(error.value)) <= 1000


def test_a_scenario_without_its_map_is_refused(tmp_path):
    (tmp_path / "a.scen").write_text(SCEN)
    (tmp_path / "a.map").write_text(MAP)
    with pytest.raises(InputError, match=r"its map m\.map is neither at "):
        load_file(tmp_path / "a.scen")


def test_a_map_of_one_long_lane_is_no_long_wait(tmp_path):
    blocked = np.zeros((601, 600), dtype=bool)
    blocked[1::4, 1:] = blocked[3::4, :-1] = True
    (tmp_path / "lane.map").write_text(text_of(blocked))
    (one,) = load_file(tmp_path / "lane.map")
    assert abs(one.start[1] - one.goal[1]) == pytest.approx(600 * CELL_M)


def test_the_pictures_of_the_case_are_read_as_by_pillow():
    """See the README of the case: composed on white, turned as EXIF says."""
    seen = 0
    for file in sorted(shared_case("16-image-scenes").glob("*.*")):
        if file.suffix == ".py" or file.name == "x.png":
            continue
        image = Image.open(file)
        if image.mode in ("I;16", "F"):
            grey = np.asarray(image) * (255.0 if image.mode == "F" else 255.0 / 65535.0)
        else:
            image = ImageOps.exif_transpose(image).convert("RGBA")
            white = Image.new("RGBA", image.size, (255, 255, 255, 255))
            grey = np.asarray(Image.alpha_composite(white, image).convert("RGB")).mean(axis=2)
        np.testing.assert_array_equal(read_image(file), grey < 128, err_msg=file.name)
        seen += 1
    assert seen == 13


def test_a_task_in_a_wall_is_refused(tmp_path):
    (tmp_path / "m.map").write_text(MAP)
    (tmp_path / "m.map.scen").write_text(SCEN.replace("\t0\t0\t5", "\t1\t1\t5"))
    with pytest.raises(InputError, match="column 1, row 1 is not a free cell"):
        load_file(tmp_path / "m.map")


@pytest.mark.parametrize("name", ["tlbo", "theta_star", "ga"])
def test_planners_find_a_path_on_a_map_that_the_judge_accepts(tmp_path, name):
    blocked = np.zeros((20, 30), dtype=bool)
    blocked[5:, 10] = blocked[:15, 20] = True
    (tmp_path / "walls.map").write_text(text_of(blocked))
    (one,) = load_file(tmp_path / "walls.map")
    trial = try_once(name, one, 0, trial_settings(name, one, 3000, 100))
    assert trial.verdict.success


def test_dark_pixels_of_an_image_are_blocked(tmp_path):
    image = np.full((12, 16), 255, dtype=np.uint8)
    image[3:9, 7] = 0
    cv2.imwrite(str(tmp_path / "room.png"), image)
    assert np.array_equal(read_image(tmp_path / "room.png"), image == 0)
    (one,) = load_file(tmp_path / "room.png")
    assert one.world.bounds_m[2] == pytest.approx(16 * CELL_M)
    clear = np.zeros((4, 4, 4), dtype=np.uint8)  # black, but fully transparent
    cv2.imwrite(str(tmp_path / "clear.png"), clear)
    assert not read_image(tmp_path / "clear.png").any()


@settings(max_examples=60)
@given(st.binary(max_size=300))
def test_a_file_that_is_not_an_image_is_refused(tmp_path_factory, data):
    file = tmp_path_factory.mktemp("rubbish") / "x.png"
    file.write_bytes(data)
    with pytest.raises(InputError, match=r"not a picture|not a PGM|cut off|pixels"):
        read_image(file)


def test_a_missing_file_and_a_map_without_free_cells_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_file(tmp_path / "none.map")
    (tmp_path / "full.map").write_text(text_of(np.ones((3, 3), dtype=bool)))
    with pytest.raises(InputError, match="contains no free cell"):
        load_file(tmp_path / "full.map")


def test_no_output_replaces_a_map_or_a_scenario(tmp_path, monkeypatch, capsys):
    blocked = np.zeros((6, 6), dtype=bool)
    (tmp_path / "room.map").write_text(text_of(blocked))
    lines = "version 1\n0\troom.map\t6\t6\t0\t0\t5\t5\t7.0\n"
    for name in ("room-random-1.scen", "room.map.scen"):
        (tmp_path / name).write_text(lines)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for command in (("planners", "--scenes"), ("weights", "--scene")):
        for scene, written in (
            ("room-random-1.scen", "room.map"),
            ("room-random-1.scen", "room-random-1.scen"),
            ("room.map", "room.map.scen"),
            ("room.map", "room.map"),
        ):
            arguments = [*command, tmp_path / scene, "--json", tmp_path / written]
            monkeypatch.setattr("sys.argv", ["simloop", "bench", *map(str, arguments)])
            with pytest.raises(SystemExit) as ended:
                main()
            assert ended.value.code == 2 and "would overwrite" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
