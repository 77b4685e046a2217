"""Equal meshes of a world share their outline, and each has it in its own place."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.gazebo import collision, model, pose, read, world
from scipy.spatial.transform import Rotation

from simloop.worlds.gazebo import outlines
from simloop.worlds.gazebo.mesh_slice import outline_between
from simloop.worlds.gazebo.outlines import Outlines
from simloop.worlds.gazebo.shapes import Shell

ARCH = np.array([[-1, 0], [1, 0], [1, 0.2], [0.3, 0.2], [0.3, 0.1], [-1, 0.1]], float)


def arch() -> np.ndarray:
    """The triangles (N, 3, 3) of the walls of an upright prism that is not convex."""
    low, high = (np.column_stack([ARCH, np.full(len(ARCH), z)]) for z in (0.0, 0.5))
    after = [np.roll(one, -1, axis=0) for one in (low, high)]
    first = np.stack([low, after[0], after[1]], axis=1)
    return np.concatenate([first, np.stack([low, after[1], high], axis=1)])


def area(polygons: list[np.ndarray]) -> float:
    """The area of polygons that do not overlap."""
    return sum(
        0.5 * float(np.sum(p[:, 0] * np.roll(p[:, 1], -1) - np.roll(p[:, 0], -1) * p[:, 1]))
        for p in polygons
    )


@pytest.mark.parametrize("tilt", [(0, 0), (0.3, 0), (0.2, -0.4), (np.pi / 2, 0), (0, np.pi / 2)])
def test_a_shared_outline_is_that_of_the_mesh_in_its_place(tilt):
    shared, local = Outlines(), arch()
    for yaw, place in [(0.0, (0, 0, 0)), (1.0, (3, -2, 0.1)), (-2.5, (-4, 1, 0.1)), (4, (1, 1, 0))]:
        frame = np.eye(4)
        frame[:3, :3] = (
            Rotation.from_euler("z", yaw) * Rotation.from_euler("xy", tilt)
        ).as_matrix()
        frame[:3, 3] = place
        placed = local @ frame[:3, :3].T + frame[:3, 3]
        found = shared.between(Shell(placed, ("arch",), local, frame), 0.02, 0.18)
        expected = outline_between(placed, 0.02, 0.18)
        assert area(found) == pytest.approx(area(expected), rel=1e-5)
        for least in (np.min, np.max):
            ends = [least(np.concatenate(one), axis=0) for one in (found, expected)]
            np.testing.assert_allclose(*ends, atol=1e-5)


def test_each_mesh_scale_tilt_and_height_is_cut_once(tmp_path, monkeypatch):
    calls = []

    def counted(*arguments):
        calls.append(arguments)
        return outline_between(*arguments)

    monkeypatch.setattr(outlines, "outline_between", counted)
    corners = arch().reshape(-1, 3)
    lines = [f"v {x} {y} {z}" for x, y, z in corners.tolist()]
    lines += [f"f {n} {n + 1} {n + 2}" for n in range(1, len(corners), 3)]
    (tmp_path / "arch.obj").write_text("\n".join(lines))

    def place(at: str, scale: str = "1 1 1") -> str:
        mesh = f"<mesh><uri>arch.obj</uri><scale>{scale}</scale></mesh>"
        return model(f"m{at}", collision(mesh), pose(at))

    many = [place(f"{3 * n % 17 - 8} {n % 5} 0 0 0 {n}") for n in range(30)]
    read(tmp_path, world(*many))
    assert len(calls) == 2  # two layers of heights
    others = [place("0 6 0 0 0 0", "1 1 .9"), place("0 7 0.1 0 0 0"), place("0 8 0 .2 0 0")]
    layout = read(tmp_path, world(*many, *others))
    assert len(calls) == 2 + 2 * 4
    assert len(layout.obstacles) >= 33
