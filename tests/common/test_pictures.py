"""Pictures: the same pixels as by Pillow alone, sizes checked before decoding, damage refused."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import pytest
from helpers.mutate import mutated
from helpers.shared_cases import shared_case
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from simloop.common.errors import InputError
from simloop.common.grey_image import read_grey
from simloop.common.pictures import read_picture

GREY = np.array([[0, 128, 255], [3, 250, 7]], np.uint8)


def saved(folder, image, name, **options):
    image.save(folder / name, **options)
    return folder / name


def png_header(columns, rows):
    """A PNG that says that it is large, and holds a row of nothing."""
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(bytes(1000))),
        (b"IEND", b""),
    ]
    body = b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + body


@pytest.mark.parametrize("name", ["a.png", "a.bmp", "a.tif", "a.pgm"])
def test_grey_of_8_bits(tmp_path, name):
    read = read_picture(saved(tmp_path, Image.fromarray(GREY), name))
    np.testing.assert_array_equal(read.levels, GREY)
    assert (read.white, read.opacity) == (255, None)


def test_grey_of_16_bits(tmp_path):
    deep = GREY.astype(np.uint16) * 257 - 1
    deep[0, 0] = 0
    (tmp_path / "a.pgm").write_bytes(b"P5 3 2 65535\n" + deep.astype(">u2").tobytes())
    saved(tmp_path, Image.fromarray(deep), "a.png")
    for name in ("a.pgm", "a.png"):
        read = read_picture(tmp_path / name)
        np.testing.assert_array_equal(read.levels, deep)
        assert read.white == 65535
    np.testing.assert_allclose(read_grey(str(tmp_path / "a.png")), deep[::-1] / 65535.0)


@pytest.mark.parametrize("white", [1, 100, 255, 1000, 65535])
@pytest.mark.parametrize("kind", [b"P2", b"P5"])
def test_a_pgm_is_scaled_by_its_own_white(tmp_path, white, kind):
    values = np.linspace(0, white, 12).astype(int)
    big = ">u2" if white > 255 else "u1"
    body = values.astype(big).tobytes()
    if kind == b"P2":
        body = b"# one\n" + b" # two\n".join(b"%d" % v for v in values)
    (tmp_path / "a.pgm").write_bytes(kind + b"\r\n# x\n 4\n#y\n3 %d\n" % white + body)
    read = read_picture(tmp_path / "a.pgm")
    np.testing.assert_allclose(
        read.levels.ravel() / read.white, values / white, atol=0.51 / read.white
    )
    by_pillow = np.asarray(Image.open(tmp_path / "a.pgm")).astype(int)
    assert np.abs(by_pillow - read.levels).max() <= 1  # halves are rounded either way


def test_transparency_of_all_kinds(tmp_path):
    opacity = np.array([[255, 0, 255], [255, 255, 60]], np.uint8)
    colours = np.dstack([GREY, GREY, GREY, opacity])
    saved(tmp_path, Image.fromarray(colours), "rgba.png")
    saved(tmp_path, Image.fromarray(np.dstack([GREY, opacity])), "la.png")
    for name, white in (("rgba.png", 765), ("la.png", 255)):
        read = read_picture(tmp_path / name)
        np.testing.assert_array_equal(read.opacity, opacity)
        np.testing.assert_array_equal(read.levels / read.white, GREY / 255.0)
        assert read.white == white
    # One level of grey, or of a palette, that stands for nothing.
    for name, image in (
        ("l.png", Image.fromarray(GREY)),
        ("i.png", Image.fromarray(GREY.astype(np.uint16))),
        ("p.png", Image.fromarray(GREY).convert("P")),
    ):
        read = read_picture(saved(tmp_path, image, name, transparency=3))
        assert read.opacity.tolist() == [[255, 255, 255], [0, 255, 255]], name
    assert read_picture(saved(tmp_path, Image.fromarray(colours[..., :3]), "o.png")).opacity is None


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("alpha", [False, True])
def test_a_picture_is_turned_as_its_exif_says(tmp_path, orientation, alpha):
    clear = np.array([[255, 0, 255], [255, 255, 255]], np.uint8)
    image = Image.fromarray(np.dstack([GREY, clear]) if alpha else GREY)
    exif = Image.Exif()
    exif[274] = orientation
    file = saved(tmp_path, image, "a.png", exif=exif)
    turned = {
        1: GREY, 2: GREY[:, ::-1], 3: GREY[::-1, ::-1], 4: GREY[::-1],
        5: GREY.T, 6: np.rot90(GREY, -1), 7: GREY[::-1, ::-1].T, 8: np.rot90(GREY),
    }  # fmt: skip
    np.testing.assert_array_equal(read_picture(file).levels, turned[orientation])
    np.testing.assert_array_equal(read_picture(file, as_shown=False).levels, GREY)
    if alpha:
        shown = read_picture(file)
        assert shown.levels[shown.opacity == 0].tolist() == [128]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (png_header(60_000, 60_000), "pixels"),
        (png_header(12_000, 12_000), "12000 x 12000 pixels; 1 to 100,000,000"),
        (b"P5 99999 99999 255\n", "99999 x 99999 pixels"),
        (b"P5 99999999999 2 255\n", "not a PGM"),
        (b"P5 0 1 255\n\0", "0 x 1 pixels"),
        (b"P5 1 1 0\n\0", "white is 0"),
        (b"P5 1 1 65536\n\0\0", "white is 65536"),
        (b"P5 2 1 100\n\1\145", "cut off, or values that are not 2 x 1 numbers of 0 to 100"),
        (b"P5 2 1 255\n\1", "cut off"),
        (b"P2 2 1 255\n1 -1", "cut off, or values"),
        (b"P2 2 1 255\n1 x", "cut off, or values"),
        (b"P2 2 1 255\n1 " + b"9" * 5000, "cut off, or values"),
        (b"P5" + b" " * 10_000_000 + b"x", "header ends"),
        (b"P5\n" + b"# a comment\n\n" * 100_000, "header ends"),
        (b"", "not a picture"),
        (b"GIF89a", "not a picture"),
        (png_header(30, 40)[:-30], "damaged or cut off"),
    ],
)
def test_what_is_no_picture_is_refused_in_one_line(tmp_path, data, said):
    (tmp_path / "a.png").write_bytes(data)
    with pytest.raises(InputError, match=said) as error:
        read_picture(tmp_path / "a.png")
    assert "\n" not in str(error.value)


def test_the_headers_of_the_case_are_read_or_refused():
    folder = shared_case("07-pgm-header-hang")
    read = read_picture(folder / "ok.pgm")  # after 200 comments
    np.testing.assert_array_equal(read.levels, [[0, 254], [254, 0]])
    for name in ("s.pgm", "cut.pgm"):
        with pytest.raises(InputError, match="header ends"):
            read_picture(folder / name)


def test_a_cut_picture_is_refused(tmp_path):
    noise = np.random.default_rng(0).integers(0, 255, (50, 50), np.uint8)
    for kind in ("PNG", "JPEG", "BMP", "TIFF", "PPM"):
        whole = io.BytesIO()
        Image.fromarray(noise).save(whole, kind)
        (tmp_path / "a").write_bytes(whole.getvalue()[: len(whole.getvalue()) * 2 // 3])
        with pytest.raises(InputError):
            read_picture(tmp_path / "a")


def test_the_ground_from_a_picture_too_large_or_none_is_refused(tmp_path):
    (tmp_path / "a.png").write_bytes(png_header(9000, 9000))
    with pytest.raises(InputError, match="9000 x 9000 pixels"):
        read_grey(str(tmp_path / "a.png"))


SEEDS = [
    b"P5\n# c\n3 2\n255\n" + GREY.tobytes(),
    b"P2 # c\n3 2 15\n1 2 3\n4 5 15\n",
    b"P5 3 2 1000\n" + GREY.astype(">u2").tobytes(),
]
for options in ({}, {"bits": 2}):
    made = io.BytesIO()
    Image.fromarray(GREY).convert("P").save(made, "PNG", transparency=3, **options)
    SEEDS.append(made.getvalue())


@pytest.mark.parametrize("number", range(len(SEEDS)))
@given(seed=st.integers(0, 2**32))
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_damage_breaks_the_reader(tmp_path, number, seed):
    (tmp_path / "a").write_bytes(mutated(SEEDS[number], np.random.default_rng(seed)))
    try:
        read = read_picture(tmp_path / "a", 10_000)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert read.levels.ndim == 2 and read.levels.max() <= read.white


@pytest.mark.parametrize("levels", [[0.0, 3.0, 255.0], [0.0, 1.0, 1.01], [-0.5, 0.0, 1.0]])
def test_floats_beyond_0_to_1_are_refused(tmp_path, levels):
    Image.fromarray(np.array([levels], np.float32)).save(tmp_path / "f.tif")
    with pytest.raises(InputError, match=r"f.tif: floating-point pixels from .*only 0 .* to 1"):
        read_picture(tmp_path / "f.tif")


def test_floats_of_0_to_1_are_shares_of_white(tmp_path):
    Image.fromarray(np.array([[0.0, 0.5, 1.00001]], np.float32)).save(tmp_path / "f.tif")
    picture = read_picture(tmp_path / "f.tif")
    assert picture.levels.tolist() == [[0, 32768, 65535]] and picture.white == 65535
