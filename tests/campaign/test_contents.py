"""Which edited files make another campaign."""

from __future__ import annotations

import pytest

from simloop.campaign import journal
from simloop.campaign.contents import digests
from simloop.campaign.spec import Request
from simloop.common.errors import InputError
from simloop.scenario.load import load

ROOM = 'start = [0.0, 0.0, 0.0]\ngoal = [3.0, 0.0]\narena = "open"\n'

WORLD = """<sdf version="1.6"><world name="w"><model name="post"><pose>{x} 2 0.4 0 0 0</pose>
<link name="l"><collision name="c"><geometry><cylinder><radius>0.1</radius><length>0.8</length>
</cylinder></geometry></collision></link></model></world></sdf>"""


def test_an_edited_world_is_another_campaign_too(tmp_path):
    world = tmp_path / "posts.world"
    world.write_text(WORLD.format(x=2))
    (tmp_path / "mine.toml").write_text(ROOM.replace('"open"', '"posts.world"'))
    request, out = Request((str(tmp_path / "mine.toml"),), (0, 2)), tmp_path / "out"
    with journal.Journal(out, request):
        pass
    world.write_text(WORLD.format(x=3))
    with pytest.raises(InputError, match=r"posts\.world"), journal.Journal(out, request):
        pass


def test_a_picture_that_a_map_names_belongs_to_the_campaign(tmp_path):
    (tmp_path / "hall.pgm").write_bytes(b"P5\n60 60\n255\n" + bytes([255]) * 3600)
    (tmp_path / "hall.yaml").write_text(
        "image: hall.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    (tmp_path / "mine.toml").write_text(
        'start = [2.0, 2.0, 0.0]\ngoal = [3.0, 2.0]\narena = "hall.yaml"\n'
    )
    found = digests([load(tmp_path / "mine.toml")])
    mine = [name for name in found if name.startswith(str(tmp_path))]
    assert [name.rpartition("/")[2] for name in mine] == ["hall.pgm", "hall.yaml"]


POST = """<sdf version="1.6"><model name="post"><static>1</static><link name="l">
<collision name="c"><pose>0 0 0.4 0 0 0</pose><geometry><cylinder>
<radius>{}</radius><length>0.8</length></cylinder>
</geometry></collision></link></model></sdf>"""
INCLUDE = """<sdf version="1.6"><world name="w"><include><uri>model://post</uri>
<pose>2 2 0 0 0 0</pose></include></world></sdf>"""


def test_an_edited_model_of_the_model_path_is_another_campaign(tmp_path):
    model = tmp_path / "models" / "post" / "model.sdf"
    model.parent.mkdir(parents=True)
    (model.parent / "model.config").write_text("<model><sdf>model.sdf</sdf></model>")
    model.write_text(POST.format(0.1))
    (tmp_path / "scen").mkdir()
    (tmp_path / "scen" / "w.world").write_text(INCLUDE)
    scenario = tmp_path / "scen" / "mine.toml"
    scenario.write_text(
        'arena = "w.world"\nmodel_path = ["../models"]\nbounds_m = [-3, -3, 5, 5]\n'
        "start = [0, 0, 0]\ngoal = [1.5, 0.0]\n"
    )
    request, out = Request((str(scenario),), (0, 2)), tmp_path / "out"
    with journal.Journal(out, request):
        pass
    model.write_text(POST.format(0.3))
    with pytest.raises(InputError, match=r"model\.sdf"), journal.Journal(out, request):
        pass


@pytest.mark.parametrize(
    "image",
    [
        "image: my map.pgm",
        "image: 'my map.pgm'  # old",
        "image:\n  my map.pgm",
        r'image: "my\x20map.pgm"',
    ],
)
def test_an_edited_map_whose_name_holds_a_space_is_another_campaign(tmp_path, image):
    picture = tmp_path / "my map.pgm"
    picture.write_bytes(b"P5\n60 60\n255\n" + bytes([255]) * 3600)
    (tmp_path / "hall.yaml").write_text(
        f"{image}\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    scenario = tmp_path / "mine.toml"
    scenario.write_text('start = [2.0, 2.0, 0.0]\ngoal = [3.0, 2.0]\narena = "hall.yaml"\n')
    request, out = Request((str(scenario),), (0, 2)), tmp_path / "out"
    with journal.Journal(out, request):
        pass
    picture.write_bytes(b"P5\n60 60\n255\n" + bytes([254]) * 3600)
    with pytest.raises(InputError, match=r"my map\.pgm"), journal.Journal(out, request):
        pass
