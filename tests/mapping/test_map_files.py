"""Maps to and from map_server's files, the grid's bound, and what is no map."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.config import SlamConfig
from simloop.mapping.grid_map import BYTES_A_CELL, GridMap
from simloop.mapping.map_files import load_map, save_map
from simloop.scenario.load import load

CONFIG = SlamConfig()
seeds = st.integers(0, 2**32 - 1)


@given(
    seed=seeds,
    rows=st.integers(1, 90),
    cols=st.integers(1, 90),
    x=st.floats(-1e3, 1e3),
    y=st.floats(-1e3, 1e3),
    resolution=st.sampled_from([0.02, 0.05, 0.1]),
)
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_map_comes_back_as_it_was_saved(tmp_path, seed, rows, cols, x, y, resolution):
    rng = np.random.default_rng(seed)
    odds = rng.choice([-2.0, 0.0, 2.0], (rows, cols)).astype(np.float32)
    config = replace(CONFIG, resolution_m=resolution)
    saved = GridMap.of(config, np.array([x, y]), odds)
    save_map(saved, tmp_path / "map.yaml")
    read = load_map(tmp_path / "map.yaml", CONFIG)
    assert read.resolution_m == resolution
    np.testing.assert_array_equal(read.origin_m, saved.origin_m)
    for name in ("log_odds", "occupied", "hits"):
        np.testing.assert_array_equal(getattr(read, name), getattr(saved, name))
    np.testing.assert_array_equal(read.log_odds[:rows, :cols], odds)
    np.testing.assert_allclose(
        np.sort(read.surfaces(), axis=0),
        np.sort([[x + (c + 0.5) * resolution, y + (r + 0.5) * resolution]
                 for r, c in zip(*np.nonzero(odds > 0), strict=True)] or np.empty((0, 2)), axis=0),
        atol=1e-9,
    )  # fmt: skip


def write(folder, body, yaml="image: m.pgm\nresolution: 0.1\norigin: [1.0, 2.0, 0.0]\n"):
    (folder / "m.pgm").write_bytes(body)
    (folder / "m.yaml").write_text(yaml)
    return folder / "m.yaml"


def test_a_picture_by_another_hand_is_read_the_right_way_up(tmp_path):
    """Plain numbers, comments, a lesser maximum, a list in lines of its own."""
    body = b"P2\n# one\n3 # two\n2\n# three\n100\n0 100 80\n 100 0 80\n"
    yaml = "image: 'm.pgm'\nresolution: 0.1\norigin:\n- 1.0\n- 2.0\n- 0.0\nnegate: 0\n"
    read = load_map(write(tmp_path, body, yaml), CONFIG)
    np.testing.assert_array_equal(
        read.occupied[:2, :3], [[False, True, False], [True, False, False]]
    )
    np.testing.assert_array_equal(read.log_odds[:2, :3] < 0, [[1, 0, 0], [0, 1, 0]])
    np.testing.assert_allclose(read.origin_m, [1.0, 2.0])
    negated = load_map(write(tmp_path, body, yaml.replace("negate: 0", "negate: 1")), CONFIG)
    np.testing.assert_array_equal(negated.occupied[:2, :3], [[1, 0, 1], [0, 1, 1]])


def test_scale_keeps_what_is_between_free_and_occupied(tmp_path):
    yaml = "image: m.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nmode: scale\n"
    yaml += "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    read = load_map(write(tmp_path, b"P5 4 1 255\n" + bytes([0, 255, 120, 180]), yaml), CONFIG)
    taken, free, likely, unlikely = read.log_odds[0, :4]
    assert taken > likely > 0.0 > unlikely > free


@pytest.mark.parametrize(
    ("body", "yaml", "said"),
    [
        (b"P6 1 1 255\n\0\0\0", None, "not a picture that can be read"),
        (b"P5 3 3 255\n\0", None, "cut off"),
        (b"P2 2 1 255\n1 x\n", None, "cut off"),
        (b"P5 99999 99999 255\n", None, "99999 x 99999 pixels; 1 to 50,000,000 are allowed"),
        (b"P5 1 1 255\n\0", "image: m.pgm\nresolution: 0.1\n", "origin is missing; required: "),
        (b"P5 1 1 255\n\0", "rubbish", "no 'key: value' of a map"),
        (b"P5 1 1 255\n\0", "image: m.pgm\nresolution: x\norigin: [0, 0, 0]\n", "not a number"),
        (b"P5 1 1 255\n\0", "image: m.pgm\nresolution: 0.1\norigin: [0]\n", "origin"),
        (b"P5 1 1 255\n\0", "image: m.pgm\nresolution: 9\norigin: [0, 0, 0]\n", "resolution"),
        (b"P5 1 1 255\n\0", "image: no.pgm\nresolution: 0.1\norigin: [0, 0, 0]\n", "no.pgm"),
    ],
)
def test_what_is_no_map_is_said_in_one_line(tmp_path, body, yaml, said):
    path = write(tmp_path, body, yaml) if yaml else write(tmp_path, body)
    with pytest.raises(InputError, match=said) as error:
        load_map(path, CONFIG)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("yaw", [0.3, math.pi / 2, math.pi, -2.5])
def test_a_map_with_a_yaw_is_turned_about_its_origin(tmp_path, yaw):
    """A wall of one cell along the rows stays a thin, straight line, in the right place."""
    picture = np.full((60, 80), 254, np.uint8)
    picture[20, 5:75] = 0  # row 39 from below
    yaml = f"image: m.pgm\nresolution: 0.05\norigin: [-1.0, 2.0, {yaw!r}]\n"
    read = load_map(write(tmp_path, b"P5 80 60 255\n" + picture.tobytes(), yaml), CONFIG)
    along = np.array([math.cos(yaw), math.sin(yaw)])
    middle = [-1.0, 2.0] + 39.5 * 0.05 * np.array([-along[1], along[0]])
    off = read.surfaces() - middle
    across = off @ [-along[1], along[0]]
    assert np.abs(across).max() < 0.025 and np.sqrt(np.mean(across**2)) < 0.008
    places = np.sort(off @ along)
    assert places[0] == pytest.approx(5.5 * 0.05, abs=0.06)
    assert places[-1] == pytest.approx(74.5 * 0.05, abs=0.06)
    assert np.diff(places).max() < 0.11  # no hole
    free = (read.log_odds < 0).sum() * 0.05**2
    assert free == pytest.approx((60 * 80 - 70) * 0.05**2, rel=0.02)


def test_the_grid_does_not_grow_beyond_its_bound_and_keeps_what_fits():
    config = replace(CONFIG, max_cells=40_000)
    grid = GridMap(config)
    near = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]])
    for k in range(200):
        pose = np.array([0.1 * k, 0.0, 0.0])
        grid.insert(np.vstack([near, [[6.0, 3.0]]]), np.zeros((4, 2)), pose)
    assert grid.log_odds.size <= 40_000
    held = sum(a.nbytes for a in (grid.log_odds, grid.hits, grid.occupied))
    assert held < BYTES_A_CELL * 40_000
    assert grid.occupied.any()
    assert np.all(grid.surfaces() >= grid.origin_m)


@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_only_the_known_part_of_a_large_map_counts(tmp_path, yaw):
    small = replace(CONFIG, max_cells=10_000)
    cells = np.full((300, 300), 205, np.uint8)
    cells[200:260, 40:90] = 254
    cells[210, 50:80] = 0
    text = f"image: m.pgm\nresolution: 0.1\norigin: [1, 2, {yaw}]\nnegate: 0\n"
    path = write(tmp_path, b"P5 300 300 255\n" + cells.tobytes(), text)
    whole, read = load_map(path, CONFIG), load_map(path, small)
    assert read.log_odds.size <= 20_000 < whole.log_odds.size  # padded to whole chunks
    apart = whole.surfaces()[:, None] - read.surfaces()[None]
    apart = np.hypot(apart[..., 0], apart[..., 1])
    # A turned map is sampled on another grid: a wall of one cell can lose some of its points.
    assert min(apart.shape) >= 25
    assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < (0.15 if yaw else 1e-9)
    cells[0, 0] = cells[-1, -1] = 254
    path = write(tmp_path, b"P5 300 300 255\n" + cells.tobytes(), text)
    for reading in (
        lambda: load_map(path, small),
        lambda: load("open", [f'slam.prior_map="{path}"', "slam.max_cells=10000"]),
    ):
        with pytest.raises(InputError, match=r"slam\.max_cells\): 90,000; at most 10,000"):
            reading()


def test_a_large_map_of_which_nothing_is_known_is_one_cell(tmp_path):
    text = "image: m.pgm\nresolution: 0.1\norigin: [1, 2, 0]\nnegate: 0\n"
    path = write(tmp_path, b"P5 300 300 255\n" + bytes([205]) * 90_000, text)
    assert not load_map(path, replace(CONFIG, max_cells=10_000)).log_odds.any()
