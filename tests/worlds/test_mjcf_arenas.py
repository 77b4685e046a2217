"""Arenas that others wrote: neither the arena nor the vehicle changes the other."""

from __future__ import annotations

import os
import shutil

import mujoco
import numpy as np
import pytest
from helpers.shared_cases import shared_case

from simloop.common.errors import InputError
from simloop.config import Config
from simloop.physics.plant import Plant
from simloop.worlds.arena import arena_names, arena_path, assemble_with_notes, build, compile_spec
from simloop.worlds.cross_section import floor_plan
from simloop.worlds.layout import Layout
from simloop.worlds.obstacles import Obstacle
from simloop.worlds.terrain import Loose

PLANE = '<geom name="floor" type="plane" pos="2 0 0" size="4 3 0.1"/>'
WALL = '<geom name="w" type="box" pos="1 0 0.3" size="0.1 2 0.3"/>'
MESH = "0 0 0 1 0 0 1 1 0 0 1 0 0 0 1 1 0 1 1 1 1 0 1 1"
CHEETAH = """
<compiler angle="radian" coordinate="local" inertiafromgeom="true" settotalmass="14"/>
<default><joint armature=".1" damping=".01" limited="true" stiffness="8"/>
  <geom conaffinity="0" condim="3" contype="1" friction=".4 .1 .1" solref=".02 1" margin=".1"/>
  <motor ctrllimited="true" ctrlrange="-1 1"/></default>
<size nstack="300000" nuser_geom="1"/><option gravity="0 0 -9.81" timestep="0.01"/>
<asset><texture builtin="gradient" height="100" rgb1="1 1 1" rgb2="0 0 0" type="skybox"
  width="100"/><texture builtin="checker" height="100" name="steel" type="2d" width="100"/>
  <material name="steel" reflectance="0.5" texture="steel"/></asset>"""


def room(extra="", geoms=WALL, floor=PLANE, bounds="-2 -3 6 3"):
    """An arena, with things in its sections."""
    numeric = f'<custom><numeric name="bounds" data="{bounds}"/></custom>' if bounds else ""
    inside = f"{extra}{numeric}<worldbody>{floor}{geoms}</worldbody>"
    return f'<mujoco model="room">{inside}</mujoco>'


@pytest.fixture
def read(tmp_path):
    """Compile an arena; return the model and what was said of it."""

    def read_text(text: str, **more):
        (tmp_path / "room.xml").write_text(text)
        spec, notes = assemble_with_notes(Layout(arena=str(tmp_path / "room.xml"), **more))
        return compile_spec(spec), " | ".join(notes)

    return read_text


def vehicle_of(model: mujoco.MjModel) -> dict[str, list]:
    """All physics of the vehicle and of the world as a whole."""
    base = model.body("base_link").id
    bodies = np.flatnonzero(model.body_rootid == base)
    of = {
        "geom_": np.flatnonzero(np.isin(model.geom_bodyid, bodies)),
        "dof_": np.flatnonzero(np.isin(model.dof_bodyid, bodies)),
        "jnt_": np.flatnonzero(np.isin(model.jnt_bodyid, bodies)),
        "body_": bodies,
        "actuator_": np.arange(model.nu),
    }
    rows = "margin gap solref solimp solmix contype conaffinity friction condim priority size pos "
    rows += "quat damping armature frictionloss stiffness range limited inertia ipos mass gravcomp "
    rows += "gear ctrlrange ctrllimited forcerange"
    found = {
        kind + row: getattr(model, kind + row)[numbers].tolist()
        for kind, numbers in of.items()
        for row in rows.split()
        if hasattr(model, kind + row)
    }
    options = [name for name in dir(model.opt) if not name.startswith("_")]
    found |= {name: np.array(getattr(model.opt, name)).tolist() for name in options}
    return found | {"more": [model.nexclude, model.neq, model.npair, model.ntendon, model.nkey]}


@pytest.mark.parametrize(
    ("extra", "says"),
    [
        (CHEETAH, "compiler settotalmass"),
        ('<option gravity="0 0 -1.62" timestep=".01" solver="PGS"/>', "option gravity"),
        ('<option><flag contact="disable" gravity="disable"/></option>', "option flag contact"),
        ('<option o_margin="1"><flag override="enable"/></option>', "option flag override"),
        ('<option wind="3 0 0" density="1.2" viscosity="1"/>', "option density"),
        ('<compiler boundmass="5" boundinertia="1" balanceinertia="true"/>', "boundmass"),
        ('<compiler fusestatic="true" discardvisual="true"/>', "fusestatic"),
        ('<compiler inertiafromgeom="true" inertiagrouprange="0 1" autolimits="false"/>', ""),
        ('<compiler meshdir="nowhere" eulerseq="ZYX" conflict="error"/>', ""),
        ('<visual><map znear=".3"/></visual><statistic meaninertia="1e9" extent="3"/>', ""),
        ('<size memory="900G"/>', "size memory"),
        ('<size njmax="2000000000" nconmax="2"/>', "size njmax"),
        ('<size nkey="2000000000" nuserdata="2000000000"/>', "size nkey"),
        ('<default class="main"><default class="tracked_ugv"/></default>', ""),
        ('<default><geom priority="9" gap="1"/><site size="9"/></default>', "priority not used"),
        ('<default><geom surfacevel="0 1 0 0 0 0"/></default>', "surfacevel not used"),
        ('<contact><exclude body1="world" body2="base_link"/></contact>', "exclusions"),
        ('<equality><weld body1="base_link" body2="world"/></equality>', "equalities"),
        ('<keyframe><key name="home" time="0"/></keyframe>', "keyframes"),
        ('<sensor><clock/></sensor><actuator><motor joint="root"/></actuator>', "sensors"),
        ('<asset><material name="steel"/><material name="oak"/></asset>', ""),
    ],
)
def test_nothing_of_an_arenas_file_reaches_the_vehicle(read, extra, says):
    model, notes = read(room(extra))
    assert vehicle_of(model) == vehicle_of(build("open"))
    assert model.body("base_link").subtreemass == pytest.approx(10.0)
    assert says in notes
    assert [s.name for s in floor_plan(model, 0.1).sections] == ["w"]


def test_names_equal_to_the_vehicles_or_a_layouts_are_no_clash(read):
    geoms = "".join(
        f'<geom name="{name}" size=".1" pos="4 {y} 1"/>'
        for y, name in enumerate(["hull_body", "road_left_6", "obstacle_drawn_01", "payload"])
    )
    body = '<body name="{}" pos="4 -1 .2">{}<geom name="{}" size=".1"/>{}</body>'
    geoms += body.format("base_link", "", "visual_hull", '<site name="lidar"/>')
    geoms += body.format("loose_01", '<freejoint name="root"/>', "loose_01", "")
    geoms += '<camera name="front"/><light mode="targetbody" target="loose_01"/>'
    mesh = f'<asset><mesh name="hull" vertex="{MESH}"/></asset>'
    model, _ = read(
        room(mesh, f'{geoms}<geom type="mesh" mesh="hull" pos="1 1 0"/>'),
        obstacles=(Obstacle("box", (2.0, 2.5), (0.2, 0.2)),),
        loose=(Loose("box", (0.0, -1.0), (0.2, 0.2), 1.0, pushable=True),),
    )
    assert vehicle_of(model) == vehicle_of(build("open"))
    assert model.geom("obstacle_drawn_01").pos[:2] == pytest.approx([2.0, 2.5])
    plant = Plant(model, Config())
    assert plant.reset(np.zeros(3)).contact_count == 0
    assert plant.loose_truth().bodies == ("loose_01_", "loose_01")


@pytest.mark.parametrize("says", ["", '<compiler angle="degree"/>', '<compiler angle="radian"/>'])
def test_angles_are_in_the_units_of_the_arenas_own_file(read, says):
    turn = "1.5707963" if "radian" in says else "90"
    geom = f'<geom name="w" type="box" pos="3 0 .3" size="1.5 .1 .3" euler="0 0 {turn}"/>'
    (section,) = floor_plan(read(room(says, geom))[0], 0.1).sections
    assert np.ptp(section.vertices_m, axis=0) == pytest.approx([0.2, 3.0], abs=1e-6)


@pytest.mark.parametrize(
    ("floor", "says"),
    [
        (PLANE.replace('"floor"', '"ground"'), "the floor is the geom ground"),
        ('<geom type="plane" size="0 0 1"/>', "the floor is the geom (no name)"),
        ('<geom name="slab" type="box" size="9 9 .1" pos="0 0 -.1"/>', "the geom slab"),
        (PLANE.replace("/>", ' contype="0" conaffinity="0"/>'), "touched, whatever"),
        (f'{PLANE}<geom type="plane" size="0 0 1" pos="0 0 -1"/>', ""),
    ],
)
def test_a_floor_is_known_by_its_place(read, floor, says):
    model, notes = read(room(floor=floor, geoms=""))
    assert says in notes
    plant = Plant(model, Config())
    assert abs(plant.reset(np.zeros(3)).position_m[2]) < 0.002


def hits(model: mujoco.MjModel) -> bool:
    """Whether the vehicle, driven straight on, has a contact within 4 s."""
    plant = Plant(model, Config())
    plant.reset(np.zeros(3))
    return any(plant.step(np.full(2, 12.0)).contact_count for _ in range(400))


@pytest.mark.parametrize(
    "wall",
    [
        WALL.replace("/>", ' contype="4"/>'),
        WALL.replace("/>", ' contype="0" conaffinity="1"/>'),
        WALL.replace('"w"', '"wall_w"').replace("/>", ' contype="0" conaffinity="0"/>'),
        WALL.replace('"w"', '"loose_w"'),
        WALL.replace("/>", ' priority="9" gap="5" solref="100 1" solimp="0 0 1"/>'),
        f'<body name="bb">{WALL}</body></worldbody><contact><exclude body1="bb" '
        'body2="base_link"/></contact><option><flag contact="disable"/></option><worldbody>',
    ],
)
def test_what_stands_is_touched_whatever_its_file_says(read, wall):
    assert hits(read(room(geoms=wall))[0])


def test_decoration_is_neither_seen_nor_touched(read):
    model, notes = read(room(geoms=WALL.replace("/>", ' contype="0" conaffinity="0"/>')))
    assert "decoration, neither seen nor touched (contype and conaffinity 0): w" in notes
    plant = Plant(model, Config())
    plant.reset(np.zeros(3))
    ray = np.array([[1.0, 0.0, 0.0]])
    assert plant.look(np.array([0.0, 0.0, 0.2]), ray, 5.0)[0] == -1.0
    assert floor_plan(model, 0.1).sections == ()


def test_a_concave_mesh_is_named(read):
    ell = [(0, 0), (1, 0), (1, 0.3), (0.3, 0.3), (0.3, 1), (0, 1)]
    points = " ".join(f"{x} {y} {z}" for z in (0, 1) for x, y in ell)
    sides = [(i, (i + 1) % 6, i + 6, (i + 1) % 6 + 6) for i in range(6)]
    faces = [f"{a} {b} {d} {a} {d} {c}" for a, b, c, d in sides]
    faces += [f"0 {i + 1} {i} 6 {i + 6} {i + 7}" for i in range(1, 5)]
    mesh = f'<asset><mesh name="m" vertex="{points}" face="{" ".join(faces)}"/></asset>'
    _, notes = read(room(mesh, '<geom name="ell" type="mesh" mesh="m" pos="2 1 0"/>'))
    assert "concave: the robot touches the convex hull, its LiDAR sees the mesh: ell" in notes


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (room(bounds="-1e9 -1e9 1e9 1e9"), "a side: 2,000,000,000 m; at most 500 m"),
        (room(bounds="nan 0 1 1"), "nan is not a number"),
        (room(bounds="0 0 1"), "'bounds' of four numbers"),
        (room('<option gravity="0 0 nan"/>'), "gravity: nan is not a number"),
        (room(geoms='<geom size=".1" pos="inf 0 0"/>'), "pos: inf is not a number"),
        (room(geoms='<geom size="1e300"/>'), "at most 100,000 m"),
        (room('<asset><texture name="t" type="2d" builtin="flat" width="90000" height="90000"/>'
              "</asset>"), "pixels of textures: 8,100,000,000"),
        (room('<asset><hfield name="h" nrow="50000" ncol="50000" size="1 1 1 1"/></asset>'),
         "points of height fields"),
        (room(geoms='<replicate count="1000"><replicate count="1000"><geom size=".1"/></replicate>'
              "</replicate>"), "copies of an element: 1,000,000"),
        (room(geoms=f"{'<body>' * 999}{WALL}{'</body>' * 999}"), "depth of nested elements: 65"),
        (room(geoms='<flexcomp name="f" type="grid"/>'), "<flexcomp> cannot be used"),
        (room(geoms='<composite type="cable"/>'), "<composite> cannot be used"),
        (room('<extension><plugin plugin="mujoco.sdf.bolt"/></extension>'), "<extension> cannot"),
        (f"<!DOCTYPE m [<!ENTITY a 'b'>]>{room()}", "DOCTYPE"),
        (room(geoms='<geom name="p" type="plane" size="1 1 1" pos="0 0 .1"/>'), "planes have no"),
        (room('<include file="/etc/passwd"/>'), "outside the arena's folder"),
        (room('<include file="room.xml"/>'), "included twice"),
        (room('<include file="no.xml"/>'), "no file 'no.xml' to include"),
        (room('<asset><mesh name="m" file="/dev/zero"/></asset>'), "no file"),
        (room(geoms="<geom name='\x1b[31m' size='.1'/>"), "not XML"),
        ("", "not XML"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused_in_one_line(read, text, says):
    with pytest.raises(InputError) as error:
        read(text)
    assert says in str(error.value)
    assert str(error.value).isprintable()
    assert str(error.value).startswith("room.xml")


def test_xml_that_only_mujoco_accepts_is_read(read):
    text = f'<?xml version="1.0" encoding="latin1"?>\n<!-- a -- b -->\n{room()}'
    model, _ = read(text)
    assert model.geom("w").pos[0] == 1.0
    with pytest.raises(InputError, match="line 4"):
        read(text.replace(WALL, "\n<geom sise='1'/>"))


@pytest.mark.parametrize("name", arena_names())
def test_a_copied_arena_finds_what_it_includes_from_any_folder(tmp_path, monkeypatch, name):
    shutil.copy(arena_path(name), tmp_path / "copy.xml")
    monkeypatch.chdir(tmp_path)
    copy, own = build("copy.xml"), build(name)
    assert np.array_equal(copy.geom_pos, own.geom_pos)
    assert np.array_equal(copy.mesh_vert, own.mesh_vert)
    assert os.listdir(tmp_path) == ["copy.xml"]


def test_an_include_from_another_folder_must_be_named(tmp_path, monkeypatch):
    parts, arena = tmp_path / "parts", tmp_path / "arena"
    parts.mkdir()
    arena.mkdir()
    (parts / "wall.xml").write_text(f"<mujocoinclude>\n{WALL}\n</mujocoinclude>")
    (arena / "room.xml").write_text(room(geoms='<include file="../parts/wall.xml"/>'))
    with pytest.raises(InputError, match=r"outside the arena's folder.*SIMLOOP_MODEL_PATH"):
        build(arena / "room.xml")
    monkeypatch.setenv("SIMLOOP_MODEL_PATH", f"/nowhere{os.pathsep}{parts}")
    assert build(arena / "room.xml").geom("w").pos[0] == 1.0


def test_meshes_of_one_name_are_those_of_each_file(tmp_path, monkeypatch):
    (tmp_path / "m").mkdir()
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    (tmp_path / "m" / "hull.obj").write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners))
    text = '<compiler meshdir="m" strippath="true"/><asset><mesh file="/home/me/hull.obj"/></asset>'
    geom = '<geom name="w" type="mesh" mesh="hull" pos="3 0 0"/>'
    (tmp_path / "room.xml").write_text(room(text, geom))
    monkeypatch.chdir("/")
    model = build(tmp_path / "room.xml")
    (section,) = floor_plan(model, 0.1).sections
    assert np.ptp(section.vertices_m, axis=0) == pytest.approx([1.0, 1.0])
    assert vehicle_of(model) == vehicle_of(build("open"))


def test_broken_physics_is_said_and_leaves_no_file(read, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for through_bindings in (False, True):
        plant = Plant(read(room())[0], Config(), through_bindings)
        assert plant.reset(np.zeros(3)).unstable == ""
        plant.data.qvel[2] = np.nan
        assert plant.step(np.zeros(2)).unstable.startswith("MuJoCo warns: Nan, Inf or huge value")
        assert plant.step(np.zeros(2)).unstable  # it stays so
        assert plant.reset(np.zeros(3)).unstable == ""
        plant.data.qvel[0] = 1e4
        assert "the vehicle moves with more than" in plant.step(np.zeros(2)).unstable
    assert os.listdir(tmp_path) == ["room.xml"]


CASES = ["room", "room_radian", "room_says_degree", "room_zyx"]


@pytest.mark.parametrize("name", CASES)
def test_the_wall_of_the_case_stands_across(name):
    model = build(shared_case("12-mjcf-angle") / f"{name}.xml")
    (section,) = floor_plan(model, 0.1).sections
    assert np.ptp(section.vertices_m, axis=0) == pytest.approx([0.2, 3.0], abs=1e-6)
    assert section.vertices_m.mean(axis=0) == pytest.approx([3.0, 0.0], abs=1e-6)


def test_the_cases_leave_the_vehicle_as_it_is_or_are_refused():
    plain, refused = vehicle_of(build("open")), []
    for file in sorted(shared_case("13-mjcf-globals").glob("*.xml")):
        try:
            assert vehicle_of(build(file)) == plain, file.name
        except InputError:
            refused.append(file.stem)
    assert set(refused) <= {"free_body", "group3", "hfield", "mocap", "sdfplugin"}


WEDGE = ("obstacle_w", [3.0, 1.0], [4.0, 2.0])
FILES = {
    **dict.fromkeys(
        ("concave", "mesh_assets_hull", "mesh_assets_wheels", "mesh_dir", "mesh_dir_assets"), WEDGE
    ),
    **dict.fromkeys(("mesh_dir_hull", "mesh_rel", "mesh_rel_hull", "strippath"), WEDGE),
    "mesh_scale": ("obstacle_w", [3.0, 1.0], [3.5, 1.5]),
    "include": ("wall_east", [4.9, -2.0], [5.1, 2.0]),
}


@pytest.mark.parametrize(("name", "shape"), FILES.items())
def test_the_wedge_of_the_case_is_its_own(name, shape, monkeypatch):
    folder = shared_case("14-mjcf-files")
    assert {file.stem for file in folder.glob("*.xml")} == set(FILES)
    monkeypatch.chdir("/")
    (section,) = floor_plan(build(folder / f"{name}.xml"), 0.1, band_m=(0.0, 0.25)).sections
    called, low, high = shape
    assert section.name == called
    np.testing.assert_allclose(section.vertices_m.min(axis=0), low, atol=1e-6)
    np.testing.assert_allclose(section.vertices_m.max(axis=0), high, atol=1e-6)
