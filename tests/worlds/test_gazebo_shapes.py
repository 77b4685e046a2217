"""Shapes become obstacles by their outline at the robot's heights."""

from __future__ import annotations

import math
import struct

import mujoco
import numpy as np
import pytest
from helpers.gazebo import collision, model, plan_of, pose, read, world
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.path import Path as Outline
from scipy.spatial.transform import Rotation

from simloop.common.errors import InputError
from simloop.worlds.cross_section import section_of
from simloop.worlds.floor_plan import BAND_M
from simloop.worlds.gazebo.convex_parts import closed_edges, convex_parts
from simloop.worlds.solids import Solid

SIDE_M = 0.01
GRID = np.stack(np.meshgrid(*2 * [np.arange(-1.995, 2, SIDE_M)]), -1).reshape(-1, 2)


def filled(layout, points=GRID) -> np.ndarray:
    """Which points (N, 2) are inside an obstacle."""
    return plan_of(layout, 1.0).clearance_m(points) < 0.0


def _capsule(points):
    axis = np.zeros_like(points)
    axis[..., 2] = np.clip(points[..., 2], -0.4, 0.4)
    return np.linalg.norm(points - axis, axis=-1) <= 0.2


def _cone(points):
    radius = np.hypot(points[..., 0], points[..., 1])
    return (radius <= 0.4 * (0.5 - points[..., 2])) & (points[..., 2] >= -0.5)


INSIDE = {
    "box": lambda p: np.all(np.abs(p) <= [0.6, 0.2, 0.3], axis=-1),
    "cylinder": lambda p: (np.hypot(p[..., 0], p[..., 1]) <= 0.3) & (np.abs(p[..., 2]) <= 0.5),
    "sphere": lambda p: np.linalg.norm(p, axis=-1) <= 0.3,
    "ellipsoid": lambda p: np.linalg.norm(p / [0.5, 0.3, 0.4], axis=-1) <= 1.0,
    "capsule": _capsule,
    "cone": _cone,
}
ELEMENT = {
    "box": "<size>1.2 .4 .6</size>",
    "cylinder": "<radius>.3</radius><length>1</length>",
    "sphere": "<radius>.3</radius>",
    "ellipsoid": "<radii>.5 .3 .4</radii>",
    "capsule": "<radius>.2</radius><length>.8</length>",
    "cone": "<radius>.4</radius><length>1</length>",
}


@pytest.mark.parametrize("kind", sorted(INSIDE))
def test_a_shape_in_any_pose_stands_as_its_shadow_between_the_robots_heights(tmp_path, kind):
    """Against samples of the shape itself at many heights."""
    rng = np.random.default_rng(4)
    for height in (0.0, 0.3, 0.55):
        angles = rng.uniform(-math.pi, math.pi, 3)
        text = f"0 0 {height} " + " ".join(map(str, angles))
        shape = collision(f"<{kind}>{ELEMENT[kind]}</{kind}>", pose(text))
        layout = read(tmp_path, world(model("m", shape)))
        turned = Rotation.from_euler("xyz", angles).as_matrix()
        points = GRID[::7]
        hit = np.zeros(len(points), bool)
        for z in np.linspace(*BAND_M, 24):
            local = (np.column_stack([points, np.full(len(points), z - height)])) @ turned
            hit |= INSIDE[kind](local)
        wrong = filled(layout, points) != hit
        # Samples of heights miss a little of a leaning edge.
        assert wrong.sum() * 7 * SIDE_M**2 < 0.012, (kind, height, wrong.sum())


def test_an_upright_shape_keeps_its_kind(tmp_path):
    half_turn, quarter = "3.14159265 0 0", "1.57079632679 0 0.3"
    for text, size, high in ((half_turn, (1.2, 0.4), 0.6), (quarter, (1.2, 0.6), 0.5)):
        shape = collision(f"<box>{ELEMENT['box']}</box>", pose(f"1 1 .3 {text}"))
        (one,) = read(tmp_path, world(model("m", shape))).obstacles
        assert one.shape == "box" and sorted(one.size_m) == pytest.approx(sorted(size))
        assert one.bottom_m + one.height_m == pytest.approx(high)
    shape = collision(f"<cylinder>{ELEMENT['cylinder']}</cylinder>", pose("0 0 .5 0 0.0009 0"))
    (one,) = read(tmp_path, world(model("m", shape))).obstacles
    assert (one.shape, one.size_m) == ("cylinder", (0.6,))


def test_the_lidar_sees_what_is_at_its_height(tmp_path):
    """A cone is wide for the hull and narrow for the LiDAR's plane."""
    cone = collision("<cone><radius>.4</radius><length>.4</length></cone>", pose("0 0 .2 0 0 0"))
    layout = read(tmp_path, world(model("m", cone)))
    low, high = sorted(layout.obstacles, key=lambda one: one.bottom_m)
    assert low.bottom_m == 0.0 and low.height_m == high.bottom_m == 0.18
    assert max(abs(x) for x, _ in low.vertices_m) == pytest.approx(0.38)
    assert max(abs(x) for x, _ in high.vertices_m) == pytest.approx(0.22)


CORNER = [(0, 0), (2, 0), (2, 0.5), (0.5, 0.5), (0.5, 2), (0, 2)]


def test_a_polyline_is_not_its_hull_and_has_holes(tmp_path):
    def line(points, height=0.5):
        text = "".join(f"<point>{x} {y}</point>" for x, y in points)
        return f"<polyline>{text}<height>{height}</height></polyline>"

    hole = [(0.1, 0.1), (0.4, 0.1), (0.4, 0.4), (0.1, 0.4)]
    layout = read(tmp_path, world(model("m", collision(line(CORNER[::-1]) + line(hole)))))
    expected = Outline(CORNER).contains_points(GRID) & ~Outline(hole).contains_points(GRID)
    assert (filled(layout) != expected).mean() < 0.003
    low = read(tmp_path, world(model("m", collision(line(CORNER, 0.1)))))
    assert {one.height_m for one in low.obstacles} == {0.1}  # it begins at its own height 0
    rng = np.random.default_rng(0)
    for points in (CORNER[:2], rng.uniform(-1, 1, (1400, 2)).round(4).tolist()):
        with pytest.raises(InputError, match="model m: a polyline"):
            read(tmp_path, world(model("m", collision(line(points)))))


@given(st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=3, max_size=12))
@settings(max_examples=60)
def test_parts_of_any_figure_are_convex_and_cover_its_inside(points):
    loop = np.array(points, float)
    parts = convex_parts(closed_edges(loop), even_odd=True)
    rng = np.random.default_rng(1)
    samples = rng.uniform(-9, 9, (400, 2))
    hits = np.zeros(len(samples), int)
    for part in parts:
        sides, gap = np.roll(part, -1, axis=0) - part, samples[:, None] - part
        hits += np.all(sides[:, 0] * gap[..., 1] - sides[:, 1] * gap[..., 0] > 0.0, axis=1)
    x, y = samples.T
    crossed = np.zeros(len(samples), int)
    for (x0, y0), (x1, y1) in closed_edges(loop):
        if y0 != y1:
            spans = (y >= min(y0, y1)) & (y < max(y0, y1))
            crossed += spans & (x0 + (y - y0) / (y1 - y0) * (x1 - x0) > x)
    assert np.array_equal(hits, crossed % 2)


def prism(loop, z0: float, z1: float, caps) -> tuple[np.ndarray, list]:
    """Vertices and triangles, counter-clockwise from outside, of an upright body."""
    count = len(loop)
    vertices = np.array([(x, y, z) for z in (z0, z1) for x, y in loop])
    faces = [(k, (k + 1) % count, count + (k + 1) % count) for k in range(count)]
    faces += [(k, count + (k + 1) % count, count + k) for k in range(count)]
    faces += [(a, c, b) for a, b, c in caps]
    return vertices, faces + [(a + count, b + count, c + count) for a, b, c in caps]


CAPS = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]


def write_obj(file, vertices, faces):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    file.write_text("\n".join(lines + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]))


def mesh(name: str, more: str = "", at: str = "") -> str:
    return world(model("m", collision(f"<mesh><uri>{name}</uri>{more}</mesh>", at)))


def test_a_mesh_stands_as_its_own_outline(tmp_path):
    vertices, faces = prism(CORNER, 0.0, 1.0, CAPS)
    write_obj(tmp_path / "corner.obj", vertices, faces)
    corners = vertices[np.array(faces)]
    body = b"".join(struct.pack("<12fH", 0, 0, 1, *one.ravel(), 0) for one in corners)
    (tmp_path / "corner.stl").write_bytes(b"\0" * 80 + struct.pack("<I", len(corners)) + body)
    expected = Outline(CORNER).contains_points(GRID)
    own = f"model://{tmp_path.name}/corner.obj"  # the file is in the folder of this model
    for name in ("corner.obj", "corner.stl", "file://corner.obj", own):
        layout = read(tmp_path, mesh(name))
        assert (filled(layout) != expected).mean() < 1e-4 and len(layout.obstacles) <= 3
    mirrored = read(tmp_path, mesh("corner.obj", "<scale>-.5 .5 .1</scale>"))
    assert (
        filled(mirrored) != Outline(0.5 * np.array(CORNER) * [-1, 1]).contains_points(GRID)
    ).mean() < 1e-3
    assert all(one.height_m == pytest.approx(0.1) for one in mirrored.obstacles)


def test_an_arch_can_be_driven_through(tmp_path):
    """A convex hull would close it."""
    arch = [(-1, 0), (-0.6, 0), (-0.6, 0.5), (0.6, 0.5), (0.6, 0), (1, 0), (1, 1), (-1, 1)]
    caps = [(0, 1, 2), (0, 2, 7), (2, 3, 6), (2, 6, 7), (3, 4, 5), (3, 5, 6)]
    write_obj(tmp_path / "arch.obj", *prism(arch, -0.1, 0.1, caps))
    upright = pose("0 0 0 1.5707963267948966 0 0")
    layout = read(tmp_path, mesh("arch.obj", at=upright))
    x, y = np.abs(GRID).T
    assert (filled(layout) != ((x > 0.6) & (x < 1) & (y < 0.1))).mean() < 1e-3


def test_open_surfaces_are_thin_walls_and_their_inside_is_free(tmp_path):
    vertices, faces = prism([(-1, -1), (1, -1), (1, 1), (-1, 1)], 0.0, 1.0, [])
    write_obj(
        tmp_path / "room.obj", vertices, [face for face in faces if 3 not in face]
    )  # three sides
    layout = read(tmp_path, mesh("room.obj"))
    plan = plan_of(layout, 1.0)
    assert plan.clearance_m(np.array([[0.0, 0.0], [0.0, -1.0]])) == pytest.approx(
        [0.995, -0.005], abs=1e-4
    )
    assert plan.clearance_m(np.array([-1.3, 0.9]))[0] > 0.3


def test_a_fine_mesh_is_drawn(tmp_path):
    """A bumpy closed surface has too many edges to be cut exactly."""
    count = 120
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    radius = 1.0 + 0.02 * np.cos(12 * angle)
    heights = np.repeat(np.linspace(0, 1, 12), count)
    r, turned = np.tile(radius, 12) * (1.0 - 0.3 * heights), np.tile(angle, 12)
    vertices = np.column_stack([r * np.cos(turned), r * np.sin(turned), heights])
    faces = []
    for ring in range(11):
        for k in range(count):
            a, b = ring * count + k, ring * count + (k + 1) % count
            faces += [(a, b, b + count), (a, b + count, a + count)]
    write_obj(tmp_path / "fine.obj", vertices, faces)
    hit = filled(read(tmp_path, mesh("fine.obj")))
    distance = np.linalg.norm(GRID, axis=1)
    around = np.arctan2(GRID[:, 1], GRID[:, 0])
    outer = (1.0 + 0.02 * np.cos(12 * around)) * (1.0 - 0.3 * BAND_M[0])
    sure = np.abs(distance - outer) > 0.015
    assert np.array_equal(hit[sure & (distance > 0.9)], (distance < outer)[sure & (distance > 0.9)])


def test_meshes_of_other_formats_need_a_package_that_is_named(tmp_path, monkeypatch):
    (tmp_path / "m.dae").write_text("<COLLADA/>")
    monkeypatch.setitem(__import__("sys").modules, "trimesh", None)
    with pytest.raises(InputError, match=r"model m: mesh m\.dae: needs the package trimesh"):
        read(tmp_path, mesh("m.dae"))
    with pytest.raises(InputError, match=r"format '\.fbx'"):
        (tmp_path / "m.fbx").write_text("")
        read(tmp_path, mesh("m.fbx"))


def test_a_collada_mesh_is_read_in_its_unit(tmp_path):
    pytest.importorskip("trimesh")
    pytest.importorskip("collada")
    vertices, faces = prism(CORNER, 0.0, 1.0, CAPS)
    numbers = " ".join(f"{100 * value:g}" for value in vertices.ravel())
    indices = " ".join(str(k) for face in faces for k in face)
    (tmp_path / "corner.dae").write_text(
        f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
        <asset><unit name="centimeter" meter="0.01"/><up_axis>Z_UP</up_axis></asset>
        <library_geometries><geometry id="g" name="g"><mesh><source id="p">
        <float_array id="a" count="{vertices.size}">{numbers}</float_array>
        <technique_common><accessor source="#a" count="{len(vertices)}" stride="3">
        <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
        </accessor></technique_common></source>
        <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
        <triangles count="{len(faces)}"><input semantic="VERTEX" source="#v" offset="0"/>
        <p>{indices}</p></triangles></mesh></geometry></library_geometries>
        <library_visual_scenes><visual_scene id="s"><node id="n">
        <instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
        <scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
    )
    hit = filled(read(tmp_path, mesh("corner.dae")))
    assert (hit != Outline(CORNER).contains_points(GRID)).mean() < 1e-3
    for part, told in (("g", None), ("none", "no submesh 'none'")):
        text = mesh("corner.dae", f"<submesh><name>{part}</name><center>true</center></submesh>")
        if told:
            with pytest.raises(InputError, match=told):
                read(tmp_path, text)
        else:
            hit = filled(read(tmp_path, text))
            assert (hit != Outline(np.array(CORNER) - 1.0).contains_points(GRID)).mean() < 1e-3


@pytest.mark.parametrize(
    ("shape", "told"),
    [
        (
            "<heightmap><uri>hill.png</uri></heightmap>",
            "model m: a heightmap hill.png: not supported",
        ),
        ("<image><uri>a.png</uri></image>", "model m: a image a.png: not supported"),
        ("<box><size>1 0 1</size></box>", "impossible size"),
        ("<sphere><radius>-1</radius></sphere>", "impossible size"),
        ("<sphere/>", "sphere radius '': not 1 numbers"),
        ("<plane><normal>0 1 0</normal></plane>", "a plane that is not level"),
        ("<plane><normal>0 0 0</normal></plane>", "a plane that is not level"),
        ("<mesh><uri>none.obj</uri></mesh>", "none.obj: not found"),
        ("<mesh/>", "names no file"),
    ],
)
def test_what_cannot_be_told_is_refused_by_the_models_name(tmp_path, shape, told):
    with pytest.raises(InputError, match=told):
        read(tmp_path, world(model("m", collision(shape))))


def test_a_flat_solid_has_an_outline():
    """A board without thickness that leans at 45 degrees: only the part in the band counts."""
    turned = Rotation.from_euler("y", 45, degrees=True).as_matrix()
    size, middle = np.array([0.5, 0.3, 0.0]), np.array([0.0, 0.0, 0.1])
    board = Solid("m", mujoco.mjtGeom.mjGEOM_BOX, size, middle, turned, np.zeros((0, 3)))
    section = section_of(board)
    assert section is not None
    assert section.vertices_m.min(axis=0) == pytest.approx([-0.15, -0.3])
    assert section.vertices_m.max(axis=0) == pytest.approx([0.08, 0.3])
