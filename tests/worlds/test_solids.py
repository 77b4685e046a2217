"""Geoms read before compilation are those that MuJoCo compiles."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from simloop.common.data_files import models_dir
from simloop.scenario.build import build_world
from simloop.scenario.load import load
from simloop.worlds.arena import (
    arena_names,
    arena_path,
    assemble,
    bounds_of,
    bounds_of_spec,
    compile_spec,
)
from simloop.worlds.cross_section import floor_plan, sections_of_spec
from simloop.worlds.floor_plan import rasterise
from simloop.worlds.layout import Layout
from simloop.worlds.obstacles import Obstacle
from simloop.worlds.solids import solid_of_model, solids_of_spec
from simloop.worlds.terrain import Loose, Step, Terrain

ODD = """<mujoco><compiler angle="degree" eulerseq="ZYX"/>
<default><default class="turned"><geom size=".2 .1 .05" euler="10 20 30"/></default></default>
<asset>
  <mesh name="scaled" vertex="0 0 0 1 0 0 0 1 0 0 0 1" scale="1 -2 .5"/>
  <mesh name="moved" vertex="0 0 0 1 0 0 0 1 0 0 0 1" refpos=".1 0 0" refquat="1 1 0 0"/>
  <mesh name="file" file="belt.obj"/>
</asset>
<worldbody>
  <frame pos="1 2 0" euler="0 0 90"><frame pos=".3 0 0" axisangle="1 0 0 30">
    <body name="outer" pos="1 0 0" xyaxes="0 1 0 -1 0 0">
      <geom name="between" type="capsule" size=".1" fromto="0 .2 0 1 0 .3"/>
      <geom name="class" type="box" class="turned"/>
      <body name="inner" pos=".1 .2 .3" quat="1 2 3 4">
        <geom name="z" type="cylinder" size=".1 .3" zaxis="1 1 1"/>
        <geom name="mesh" type="mesh" mesh="scaled" pos="1 2 3" euler="5 6 7"/>
      </body>
    </body>
  </frame></frame>
  <replicate count="3" offset="1 0 0" euler="0 0 20">
    <geom name="many" size=".1" pos="0 1 0"/>
  </replicate>
  <geom name="box_between" type="box" size=".1" fromto="0 .2 0 1 0 .3"/>
  <geom name="egg_between" type="ellipsoid" size=".1" fromto="0 .2 0 1 0 .3"/>
  <geom name="down" type="cylinder" size=".1" fromto="0 0 1 0 0 0"/>
  <geom name="up" type="cylinder" size=".1" fromto="0 0 0 0 0 1"/>
  <geom name="moved" type="mesh" mesh="moved" pos="1 2 3" euler="5 6 7"/>
  <geom name="fitted" type="box" mesh="file" pos="1 2 3" euler="5 6 7"/>
  <geom name="read" type="mesh" mesh="file" pos="1 2 3" euler="5 6 7"/>
  <body name="free" pos="2 2 1" euler="1 2 3"><freejoint/>
    <geom name="loose" type="box" size=".1 .1 .2"/>
    <geom name="loose_mesh" type="mesh" mesh="moved"/>
  </body>
</worldbody></mujoco>"""


def test_solids_reach_as_far_as_in_the_compiled_model():
    mesh = (models_dir() / "assets" / "belt.obj").read_bytes()
    spec = mujoco.MjSpec.from_string(ODD, assets={"belt.obj": mesh})
    read = {solid.name: solid for solid in solids_of_spec(spec, spec.worldbody, jointed=True)}
    fixed = solids_of_spec(spec, spec.worldbody, jointed=False, skip="inner")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    directions = np.random.default_rng(0).standard_normal((100, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    assert len(read) == model.ngeom
    for geom in range(model.ngeom):
        built = solid_of_model(model, data, geom)
        for direction in directions:
            reach = read[built.name].reach_m(direction)
            assert reach == pytest.approx(built.reach_m(direction), abs=1e-6), built.name
    assert set(read) - {solid.name for solid in fixed} == {"z", "mesh", "loose", "loose_mesh"}


def test_a_mesh_file_beside_an_arena_is_read_for_clutter_to_keep_clear_of(tmp_path):
    room = arena_path("clutter").read_text()
    look = arena_path("clutter").parent / "assets" / "look.xml"
    mesh = '<asset><mesh name="hill" file="hill.obj"/></asset>'
    geom = '<geom name="obstacle_hill" type="mesh" mesh="hill" pos="2 2 0" contype="1"/>'
    room = room.replace("assets/look.xml", str(look)).replace("</worldbody>", f"{geom}</worldbody>")
    (tmp_path / "room.xml").write_text(room.replace("</mujoco>", f"{mesh}</mujoco>"))
    corners = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 0.4)]
    hill = "".join(f"v {x} {y} {z}\n" for x, y, z in corners)
    faces = ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
    (tmp_path / "hill.obj").write_text(hill + "".join(f"f {face}\n" for face in faces))
    text = 'arena = "room.xml"\nstart = [0, 0, 0]\ngoal = [3.6, 3.9]\n[clutter]\ncount = 6\n'
    (tmp_path / "mine.toml").write_text(text)
    floor = build_world(load(tmp_path / "mine.toml")).floor
    (stands,) = [s for s in floor.sections if s.name == "obstacle_hill"]
    assert sorted(map(tuple, np.round(stands.vertices_m, 6))) == [
        (1.5, 1.5), (1.5, 2.5), (2.5, 1.5), (2.5, 2.5)
    ]  # fmt: skip
    alone = rasterise([stands], floor.bounds_m, 1.0)
    drawn = [s for s in floor.sections if s.name.startswith("obstacle_drawn_")]
    assert len(drawn) >= 6
    for section in drawn:
        assert alone.clearance_m(section.vertices_m).min() - section.radius_m > 0.0


LAYOUTS = [Layout(arena=name) for name in arena_names()] + [
    Layout(
        obstacles=(
            Obstacle("ell", (1.0, 1.5), (0.6, 0.5, 0.1), 2.0),
            Obstacle("ellipse", (2.0, 1.5), (0.6, 0.3), -0.4),
            Obstacle("box", (3.0, 1.5), (0.6, 0.3), -0.4, 0.3, bottom_m=0.3),
        ),
        arena="trap",
        terrain=Terrain(steps=(Step((1.0, -1.0), (0.3, 1.0), 0.1),)),
        loose=(Loose("box", (0.0, -1.0), (0.2, 0.3), 1.0),),
    )
]


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda one: one.arena)
def test_an_arena_that_is_read_has_the_floor_plan_of_the_compiled_one(layout):
    world = assemble(layout)
    sections, bounds = sections_of_spec(world, loose=False), bounds_of_spec(world)
    with_loose = sections_of_spec(world, loose=True)
    model = compile_spec(world)
    floor = floor_plan(model)
    assert sorted(s.name for s in sections) == sorted(s.name for s in floor.sections)
    assert len(with_loose) == len(sections) + len(layout.loose)
    assert np.array_equal(bounds, bounds_of(model))
    points = np.random.default_rng(1).uniform(bounds[:2], bounds[2:], (300, 2))
    read = rasterise(sections, bounds, 1.0)
    assert read.clearance_m(points) == pytest.approx(floor.clearance_m(points), abs=1e-6)
