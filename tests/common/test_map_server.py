"""map_server's YAML files as people and programs write them: read alike, or refused in one line."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
import yaml
from helpers.mutate import mutated
from helpers.shared_cases import shared_case
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from simloop.common.errors import InputError
from simloop.common.map_server import picture_of, read_cells
from simloop.scenario.build import build_world
from simloop.scenario.load import load
from simloop.worlds.map_server_world import read_map_world

PICTURE = np.array([[0, 254, 205], [254, 254, 0]], np.uint8)
BASE = (
    "image: m.png\nresolution: 0.05\norigin: [-1.0, -2.0, 0.0]\nnegate: 0\n"
    "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
)
TERNARY = np.array([[-1, -1, 1], [1, -1, 0]])  # of PICTURE, the first row below


def write(folder, yaml=BASE, picture=PICTURE):
    Image.fromarray(picture).save(folder / "m.png")
    (folder / "m.yaml").write_bytes(yaml.encode())
    return folder / "m.yaml"


@pytest.mark.parametrize(
    "yaml",
    [
        BASE,
        "\ufeff" + BASE,
        BASE.replace("\n", "\r\n"),
        "%YAML 1.1\n---\n" + BASE + "...\n",
        BASE.replace("negate: 0", "negate: 0.0"),
        BASE.replace("negate: 0", 'negate: "0"'),
        BASE.replace("negate: 0", "negate: off"),
        BASE.replace("negate: 0", "negate: False"),
        BASE.replace("negate: 0", "negate: &no 0   # 1 inverts"),
        BASE.replace("negate: 0\n", ""),
        BASE.replace("image:", "'image':").replace("origin:", '"origin":'),
        BASE.replace("m.png", "./m.png"),
        BASE.replace("m.png", '"m.png"'),
        BASE.replace("0.05\n", "5.0e-2\n"),
        BASE.replace("0.05\n", "5e-2\n"),
        BASE.replace("0.05\n", "'+.05'\n"),
        BASE.replace("[-1.0, -2.0, 0.0]", "\n- -1.0\n- -2.0\n- 0.0"),
        BASE.replace("[-1.0, -2.0, 0.0]", "[-1,\n   -2,\n 6.283185307179586]"),
        BASE.replace("[-1.0, -2.0, 0.0]", "[-1.0, -2.0]"),
        BASE + "mode: Trinary\n",
        BASE + "zones:\n  image: other.png\n  negate: 1\n  mode: raw\n",
        BASE.replace("0.65", "&high 0.65") + "levels: {high: *high, <<: *high}\n",
        '{"image": "m.png", "resolution": 0.05, "origin": [-1, -2, 0], "free_thresh": 0.19}',
    ],
)
def test_one_map_in_many_dialects(tmp_path, yaml):
    cells = read_cells(write(tmp_path, yaml))
    np.testing.assert_array_equal(np.sign(cells.log_odds), TERNARY)
    assert cells.resolution_m == 0.05 and cells.yaw_rad == 0.0
    assert cells.origin_m.tolist() == [-1.0, -2.0]
    assert picture_of(tmp_path / "m.yaml") == tmp_path / "m.png"


@pytest.mark.parametrize("word", ["1", "1.0", "'1'", "true", "'true'", "yes", "On"])
def test_negate_in_all_its_ways(tmp_path, word):
    cells = read_cells(write(tmp_path, BASE.replace("negate: 0", f"negate: {word}")))
    np.testing.assert_array_equal(np.sign(cells.log_odds), [[1, 1, -1], [-1, 1, 1]])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("negate: 0", "negate: 0.5", "line 4: negate: '0.5' is not 0 or 1"),
        ("negate: 0", "negate: maybe", "is not 0 or 1"),
        ("negate: 0", "negate: ~", "is not 0 or 1"),
        ("negate: 0", "negat: 1", "unknown key 'negat' .did you mean 'negate'"),
        ("free_thresh", "free_threshold", "did you mean 'free_thresh'"),
        ("negate: 0", "<<: {negate: 1}", "<< is not supported"),
        ("negate: 0", "image: b.png", "image is given twice"),
        ("negate: 0", "mode: cost", "unknown mode 'cost'"),
        ("m.png", "", "line 1: image: '' is not a text"),
        ("m.png", "[m.png]", "is not a text"),
        ("m.png", "{a: m.png}", "nested values"),
        ("m.png", "none.png", "none.png: no such file"),
        ("m.png", '"m\\0.png"', "cannot be read"),
        ("m.png", "x" * 5000, "cannot be read"),
        ("0.05\n", "1" * 5000 + "\n", "is not a number|not between"),
        ("0.05\n", "0x5\n", "is not a number"),
        ("0.05\n", "1:30\n", "is not a number"),
        ("0.05\n", ".nan\n", "is not a number"),
        ("0.05\n", "-0.05\n", "not between 0.005 and 1"),
        ("0.05\n", "2.5\n", "not between 0.005 and 1"),
        ("0.05\n", "0.05: 1\n", "not YAML"),
        ("-2.0", "-nan", "is not .x, y, yaw. in m and rad"),
        ("-2.0", "1e9", "at most 10,000"),
        ("[-1.0, -2.0, 0.0]", "(-1.0, -2.0, 0.0)", "is not .x, y, yaw."),
        ("[-1.0, -2.0, 0.0]", "[1, 2, 3, 4]", "is not .x, y, yaw."),
        ("0.65", "65", "must be 0 to 1"),
        ("0.65", "0.1", "the first not above the second"),
        ("image", "\timage", "not YAML"),
        ("image", "- image", "not YAML|no 'key"),
        ("image", "imag\x07e", "not YAML"),
    ],
)
def test_what_could_be_meant_otherwise_is_refused_in_one_line(tmp_path, old, new, said):
    with pytest.raises(InputError, match=said) as error:
        read_cells(write(tmp_path, BASE.replace(old, new, 1)))
    assert "\n" not in str(error.value) and len(str(error.value)) < 1100


@pytest.mark.parametrize(
    "yaml",
    [
        "a: " + "[" * 3000,
        "a: " + "{b: " * 3000,
        "".join(f"{' ' * i}k:\n" for i in range(300)),
        "a: &a [x, x]\n" + "".join(f"b{i}: &a [*a, *a]\n" for i in range(200)) + "image: *a\n",
        "a: &a {x: 1}\n" + "".join(f"b{i}: &a {{<<: [*a, *a]}}\n" for i in range(200)) + BASE,
        BASE + "- a\n" * 100_000,
        BASE + "x: [" + "1," * 400_000 + "]\n",
        "#" * 2_000_000,
        "? " * 5000,
    ],
)
def test_deep_long_and_multiplying_files_end_at_once(tmp_path, yaml):
    began = time.process_time()
    try:
        read_cells(write(tmp_path, yaml))
    except InputError as error:
        assert "\n" not in str(error)
    assert time.process_time() - began < 5.0


def test_transparent_pixels_are_unknown_and_opaque_black_is_black(tmp_path):
    """The opacity is no fourth colour (so navigation2 reads it). The mode raw does not use it."""
    opacity = np.array([[255, 255, 255], [0, 254, 255]], np.uint8)
    rgba = np.dstack([PICTURE, PICTURE, PICTURE, opacity])
    high = BASE.replace("0.65", "0.9")
    odds = read_cells(write(tmp_path, high, rgba)).log_odds
    np.testing.assert_array_equal(np.sign(odds), [[0, 0, 1], [1, -1, 0]])
    odds = read_cells(write(tmp_path, BASE + "mode: scale\n", rgba)).log_odds
    np.testing.assert_array_equal(np.sign(odds), [[0, 0, 1], [1, -1, -1]])
    odds = read_cells(write(tmp_path, BASE + "mode: raw\n", rgba)).log_odds
    np.testing.assert_array_equal(np.sign(odds), [[0, 0, -1], [-1, 0, 0]])


def test_colours_are_averaged_and_16_bits_are_finer(tmp_path):
    rgb = np.array([[[255, 0, 0], [255, 255, 0], [90, 90, 90]]], np.uint8)
    odds = read_cells(write(tmp_path, BASE, rgb)).log_odds
    np.testing.assert_array_equal(np.sign(odds), [[1, 0, 0]])
    # 0.35 of white is the limit: 22937.25 of 65535.
    deep = np.array([[22937, 22938, 0]], np.uint16)
    odds = read_cells(write(tmp_path, BASE, deep)).log_odds
    np.testing.assert_array_equal(np.sign(odds), [[1, 0, 1]])


def test_a_world_with_a_yaw_stands_where_map_server_puts_it(tmp_path):
    """Each occupied cell's centre is inside a box, each free one's outside."""
    picture = np.where(np.random.default_rng(1).random((9, 14)) < 0.4, 0, 254).astype(np.uint8)
    for yaw in (0.0, 1.56, -0.7, math.pi):
        yaml = BASE.replace("0.0]", f"{yaw!r}]").replace("0.05", "0.5")
        layout = read_map_world(write(tmp_path, yaml, picture))
        outlines = [one.sections()[0].vertices_m for one in layout.obstacles]
        for (j, i), value in np.ndenumerate(picture[::-1]):
            x, y = 0.5 * (i + 0.5), 0.5 * (j + 0.5)
            place = [
                -1.0 + math.cos(yaw) * x - math.sin(yaw) * y,
                -2.0 + math.sin(yaw) * x + math.cos(yaw) * y,
            ]
            inside = any(_holds(outline, place) for outline in outlines)
            assert inside == (value == 0)
            x_min, y_min, x_max, y_max = layout.bounds_m
            assert x_min < place[0] < x_max and y_min < place[1] < y_max


def _holds(outline, place):
    ahead = np.roll(outline, -1, axis=0) - outline
    off = np.array(place) - outline
    return bool(np.all(ahead[:, 0] * off[:, 1] - ahead[:, 1] * off[:, 0] > 0.0))


def test_a_yml_file_is_a_world_too(tmp_path):
    empty = np.full((60, 60), 254, np.uint8)
    write(tmp_path, BASE.replace("-1.0, -2.0", "0, 0"), empty).rename(tmp_path / "m.yml")
    (tmp_path / "s.toml").write_text('arena = "m.yml"\nstart = [1, 1, 0]\ngoal = [2, 2]\n')
    assert build_world(load(tmp_path / "s.toml")).floor.bounds_m.tolist() == [0, 0, 3, 3]


def test_a_world_of_a_kilometre_is_refused_before_it_is_made(tmp_path):
    file = write(tmp_path, BASE.replace("0.05", "1.0"), np.full((3, 1000), 254, np.uint8))
    with pytest.raises(InputError, match="a side of the floor: 1,000 m; at most 500 m"):
        read_map_world(file)


def test_a_map_of_noise_is_refused(tmp_path):
    noise = np.where(np.random.default_rng(0).random((600, 600)) < 0.5, 0, 254).astype(np.uint8)
    with pytest.raises(InputError, match="more than 20,000 boxes"):
        read_map_world(write(tmp_path, BASE, noise))


@given(seed=st.integers(0, 2**32))
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_damage_breaks_the_reader(tmp_path, seed):
    file = write(tmp_path)
    file.write_bytes(mutated((BASE + "mode: trinary\n").encode(), np.random.default_rng(seed)))
    try:
        cells = read_cells(file)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert cells.log_odds.shape == (2, 3)


# Of the case's files, those that are refused, and why. All others have one picture and one place.
REFUSED = {
    "dup_key": "image is given twice",
    "image_subdir_twice": "no such file",
    "image_tilde": "no such file",
    "inline_comment_nospace": "m.pgm#x: no such file",
    "negate_comment_tab": "not YAML",
    "origin_nan": "-nan.* is not",  # a text to PyYAML
    "origin_tuple": "is not",  # a text too
    "res_big": "resolution 2.5 m",  # no robot drives in cells of this size
}
CASE = np.array(
    [[0, 254, 254, 254, 205], [0, 0, 254, 254, 254], [254, 254, 254, 0, 254], [254] * 5]
)
SURE = 2.0


def expected_odds(mode, negate, free_below):
    """The rules of map_server for the case's picture, level by level."""
    by_level = {}
    for level in (0, 205, 254):
        chance = level / 255.0 if negate else 1.0 - level / 255.0
        if mode == "raw":
            by_level[level] = -SURE if level == 0 else 0.0  # 0 %; beyond 100 it is unknown
        elif chance > 0.65:
            by_level[level] = SURE
        elif chance < free_below:
            by_level[level] = -SURE
        else:  # 205 only, 0.00008 above the lower threshold
            by_level[level] = -SURE if mode == "scale" else 0.0
    return np.vectorize(by_level.get)(CASE[::-1])


def case_files():
    folder = shared_case("06-map-yaml-dialects")
    return sorted([*folder.glob("*.yaml"), *folder.glob("*.yml")])


def test_the_dialects_of_the_case_are_read_as_by_pyyaml_and_pillow():
    """See the README of the case: the same cells and place, or a refusal where it is right."""
    files = [file for file in case_files() if file.stem not in REFUSED]
    assert len(files) >= 35
    for file in files:
        cells, facts = read_cells(file), yaml.safe_load(file.read_bytes())
        grey = np.asarray(Image.open(file.parent / facts["image"])).astype(int)
        grey = grey // 257 if grey.max() > 255 else grey
        np.testing.assert_array_equal(grey[..., 0] if grey.ndim == 3 else grey, CASE)
        negate = facts.get("negate", 0) not in (0, False, "0")
        mode = facts.get("mode", "trinary").lower()
        odds = expected_odds(mode, negate, facts.get("free_thresh", 0.196))
        np.testing.assert_allclose(cells.log_odds, odds, atol=1e-6, err_msg=file.name)
        assert cells.resolution_m == 0.05, file.name
        assert cells.origin_m.tolist() == [-1.0, -2.0], file.name
        yaw = float(facts["origin"][2])
        assert yaw == {"origin_yaw": 1.56, "origin_yaw_tiny": 1e-17}.get(file.stem, 0.0)
        assert cells.yaw_rad == pytest.approx(yaw, abs=1e-12), file.name


@pytest.mark.parametrize(("name", "said"), REFUSED.items())
def test_files_of_the_case_that_are_no_map_are_refused(name, said):
    with pytest.raises(InputError, match=said):
        read_cells(shared_case("06-map-yaml-dialects") / f"{name}.yaml")


def test_what_is_between_the_thresholds_is_not_surer_than_what_is_beyond_them(tmp_path):
    picture = np.arange(256, dtype=np.uint8)[None]
    odds = read_cells(write(tmp_path, BASE + "mode: scale\n", picture)).log_odds[0]
    assert (np.diff(odds) <= 0.0).all()
    assert odds[0] == SURE and odds[-1] == -SURE
    assert 80 < np.count_nonzero(np.abs(odds) < SURE) < 117
