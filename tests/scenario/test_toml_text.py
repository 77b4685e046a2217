"""Long dotted keys are refused before the parser sees them, and nothing else is."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from simloop.common.errors import InputError
from simloop.scenario.load import apply_override, load
from simloop.scenario.toml_text import parse_toml

LONG = ".".join(["a"] * 20_000)
DOTS = "a." * 200


@pytest.mark.parametrize(
    "text",
    [
        f"{LONG} = 1",
        f"[{LONG}]",
        f"[[ {LONG} ]]",
        f"x = {{ {LONG} = 1 }}",
        f"x = [{{ y = 1, {LONG} = 1 }}]",
        f"{LONG.replace('.', ' . ')} = 1",
        f"{LONG.replace('a', chr(34) + 'a.' + chr(34))} = 1",
        "\"'''\".".join(["a."] * 100) + "b = 1",
    ],
)
def test_a_key_of_many_parts_is_refused_with_its_line(tmp_path, text):
    (tmp_path / "x.toml").write_text(f'y = """\n{DOTS}"""\n{text}\n')
    with pytest.raises(InputError, match=r"x\.toml, line 3: a key has more than 64 parts"):
        load(tmp_path / "x.toml")


@pytest.mark.parametrize(
    "text",
    [
        f'x = "{DOTS}"',
        f"x = '{DOTS}'",
        f'x = """\n{DOTS}\n\\"""{DOTS}"""""',
        f"x = '''\n{DOTS}\n''{DOTS}'''''",
        f"x = 1 # {DOTS}",
        f'"{DOTS}" = 1',
        "x = [" + "1.5, " * 200 + "]",
        "x = [" + "1.5\n," * 200 + "]",
        ".".join("abcdefgh" * 8) + " = 1",
    ],
)
def test_dots_elsewhere_are_no_parts_of_a_key(text):
    assert parse_toml(text) == tomllib.loads(text)


def test_many_keys_of_many_parts_are_refused():
    key = ".".join("a" * 60)
    with pytest.raises(
        InputError, match=r"line 339: all keys together have more than 20,000 parts"
    ):
        parse_toml("".join(f"[x{number}.{key}]\n" for number in range(7500)))
    assert len(parse_toml("".join(f"x{number}.y = 1.5\n" for number in range(30_000)))) == 30_000


@pytest.mark.parametrize("text", [f"{LONG}=1", f"x={{{LONG} = 1}}", f"x=1\n{LONG} = 1"])
def test_an_override_has_no_long_keys_either(text):
    with pytest.raises(InputError, match="more than 64 parts"):
        apply_override({}, text)


@given(st.text(alphabet="a.='\"\\#\n [{", max_size=60).map(lambda text: text.replace("a", "a.b")))
def test_what_toml_accepts_is_parsed_in_the_same_way(text):
    try:
        expected = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        with pytest.raises(ValueError):
            parse_toml(text)
    else:
        assert parse_toml(text) == expected
