"""Every file that a scenario is read from is listed, whatever its name and the way it is named."""

import pytest

from simloop.campaign.contents import digests
from simloop.campaign.spec import Request
from simloop.cli.apart import check_apart
from simloop.cli.campaign import _Outputs
from simloop.common.errors import InputError
from simloop.scenario.inputs import all_input_files, files_behind, input_files
from simloop.scenario.load import load, resolve

MAP = "image: {image}\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
TOML = 'start = [2.0, 2.0, 0.0]\ngoal = [3.0, 2.0]\narena = "hall.yaml"\n'


@pytest.fixture
def hall(tmp_path):
    (tmp_path / "hall.pgm").write_bytes(b"P5\n60 60\n255\n" + bytes([255]) * 3600)
    (tmp_path / "hall.yaml").write_text(MAP.format(image="hall.pgm"))
    (tmp_path / "hall.toml").write_text(TOML)
    return tmp_path / "hall.toml"


def names(found):
    return {path.name for path in found}


@pytest.mark.parametrize("option", ["junit", "json_file"])
@pytest.mark.parametrize("name", ["hall.pgm", "hall.yaml", "hall.toml"])
def test_a_campaign_replaces_no_file_that_its_scenarios_are_read_from(hall, option, name):
    request = Request((str(hall),), (0, 1))
    given = {"junit": None, "json_file": None, option: hall.parent / name}
    outputs = _Outputs(hall.parent / "out", **given, recorded_failures=0, report=False)
    with pytest.raises(InputError, match=rf"would overwrite the input .*{name}"):
        outputs.check(request)


def test_all_commands_have_the_same_list(hall):
    wanted = load(hall)
    found = input_files(wanted, resolve(hall))
    assert {"hall.pgm", "hall.yaml", "hall.toml", "tracked_ugv.xml"} <= names(found)
    assert all_input_files([wanted, wanted], [resolve(hall)]) == found
    assert set(digests([wanted])) == {str(hall.parent / one) for one in ("hall.pgm", "hall.yaml")}
    with pytest.raises(InputError, match="would overwrite"):
        check_apart({"--json": hall.parent / "hall.pgm"}, found)


@pytest.mark.parametrize(
    ("image", "name"),
    [
        (r'"caf\xE9.png"', "café.png"),
        (r'"a\tb.png"', "a\tb.png"),
        ('"a\\\n  b.png"', "ab.png"),
        ("'it''s, a [map].png'", "it's, a [map].png"),
        ("&name plain.png", "plain.png"),
        ("!!str tagged.png", "tagged.png"),
        (">-\n  folded.png", "folded.png"),
    ],
)
def test_the_picture_of_a_map_is_found_as_yaml_means_it(tmp_path, image, name):
    (tmp_path / name).write_bytes(b"")
    (tmp_path / "m.yaml").write_text(MAP.format(image=image))
    assert tmp_path / name in files_behind(tmp_path / "m.yaml", "the map")


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ('<mujoco><mesh file="caf&#xE9; &amp; bar.stl"/></mujoco>', "café & bar.stl"),
        ('<mujoco><mesh file="it\'s.stl"/></mujoco>', "it's.stl"),
        ("<mujoco><hfield file = 'a>b.png'/></mujoco>", "a>b.png"),
        ("<sdf><uri><![CDATA[ file://wall%201.stl ]]></uri></sdf>", "wall 1.stl"),
        ("<sdf><mesh><filename>old.stl</filename></mesh></sdf>", "old.stl"),
        ('<mujoco><compiler strippath="true"/><mesh file="x/y/z.stl"/></mujoco>', "z.stl"),
    ],
)
def test_a_file_is_found_as_xml_means_its_name(tmp_path, text, name):
    (tmp_path / name).write_bytes(b"")
    (tmp_path / "a.xml").write_text(text)
    assert tmp_path / name in files_behind(tmp_path / "a.xml", "the arena")


def test_an_encoding_that_an_xml_file_declares_is_used(tmp_path):
    (tmp_path / "é.stl").write_bytes(b"")
    text = '<?xml version="1.0" encoding="{}"?><mujoco><mesh file="é.stl"/></mujoco>'
    for code in ("latin-1", "utf-16", "utf-8", "no-such"):
        data = text.format(code).encode("utf-8" if code == "no-such" else code)
        (tmp_path / "a.xml").write_bytes(data)
        assert tmp_path / "é.stl" in files_behind(tmp_path / "a.xml", "the arena"), code


def test_a_folder_of_meshes_holds_for_included_files_too(tmp_path):
    for folder in ("meshes", "parts"):
        (tmp_path / folder).mkdir()
    (tmp_path / "meshes" / "wall.stl").write_bytes(b"")
    (tmp_path / "parts" / "part.xml").write_text('<mujoco><mesh file="wall.stl"/></mujoco>')
    include = '<include file="parts/part.xml"/>'
    for compiler in ('<compiler meshdir="meshes"/>', '<include file="setting.xml"/>'):
        (tmp_path / "setting.xml").write_text('<mujoco><compiler meshdir="meshes"/></mujoco>')
        (tmp_path / "a.xml").write_text(f"<mujoco>{include}{compiler}</mujoco>")
        assert "wall.stl" in names(files_behind(tmp_path / "a.xml", "the arena"))
