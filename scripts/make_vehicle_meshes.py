"""Write the visual meshes of models/tracked_ugv.xml: belt, wheels, sprocket, hull.

Run it after a change of a size in this file. The meshes have no mass and no contacts.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Faces = list[Array]  # each (3 or 4, 3), counter-clockwise when seen from outside

ASSETS = Path(__file__).resolve().parent.parent / "models" / "assets"
ROAD_X_M = np.linspace(-0.2075, 0.2075, 6)
END_Z_M = 0.088
TIP_M, PLATE_M, INNER_M = 0.037, 0.034, 0.029  # radii of a link's grouser, plate and inner face
BELT_HALF_WIDTH_M = 0.0375
LINKS = 46


def prism(outline: Array, low: float, high: float) -> Faces:
    """Extrude an outline along y.

    Args:
        outline: (N, 2) convex, counter-clockwise, x and z, m.
        low: first y, m.
        high: last y, m.

    Returns:
        The faces.
    """
    front = np.column_stack([outline[:, 0], np.full(len(outline), low), outline[:, 1]])
    back = front + np.array([0.0, high - low, 0.0])
    # Seen from -y, x runs to the right and z up.
    sides = [np.array([front[i - 1], back[i - 1], back[i], front[i]]) for i in range(len(outline))]
    caps = [np.array([front[0], front[i], front[i + 1]]) for i in range(1, len(front) - 1)]
    caps += [np.array([back[0], back[i + 1], back[i]]) for i in range(1, len(back) - 1)]
    return sides + caps


def lathe(profile: Sequence[tuple[float, float]], centre: tuple[float, float], count: int) -> Faces:
    """Rotate a profile about an axis parallel to y.

    Args:
        profile: points (radius, y), m.
        centre: x and z of the axis, m.
        count: number of faces around the axis.

    Returns:
        The faces.
    """
    angle = 2.0 * math.pi * np.arange(count + 1) / count
    rings = [
        np.column_stack(
            [centre[0] + r * np.cos(angle), np.full(count + 1, y), centre[1] + r * np.sin(angle)]
        )
        for r, y in profile
    ]
    return [
        np.array([a[i], b[i], b[i + 1], a[i + 1]])
        for a, b in itertools.pairwise(rings)
        for i in range(count)
    ]


def belt_path(count: int) -> tuple[Array, Array]:
    """Compute evenly spaced points along the belt's centre line.

    Args:
        count: number of points.

    Returns:
        (count, 2) points x, z, m, and (count, 2) outward normals.
    """
    x0, x1, r = float(ROAD_X_M[0]), float(ROAD_X_M[-1]), PLATE_M
    corners = [(x0, TIP_M), (x1, TIP_M), (x1, END_Z_M), (x0, END_Z_M)]
    points, normals = [], []
    for k, (x, z) in enumerate(corners):
        start = -math.pi + 0.5 * math.pi * k
        for a in np.linspace(start, start + 0.5 * math.pi, 60):
            normals.append((math.cos(a), math.sin(a)))
            points.append((x + r * math.cos(a), z + r * math.sin(a)))
    way, out = np.array([*points, points[0]]), np.array([*normals, normals[0]])
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    at = arc[-1] * np.arange(count) / count
    even = np.column_stack([np.interp(at, arc, way[:, i]) for i in (0, 1)])
    normal = np.column_stack([np.interp(at, arc, out[:, i]) for i in (0, 1)])
    return even, normal / np.hypot(*normal.T)[:, None]


def belt() -> Faces:
    """Build the belt: links around the wheels, each a plate with a grouser across it.

    Returns:
        The faces.
    """
    points, normals = belt_path(LINKS)
    pitch = float(np.hypot(*(points[1] - points[0])))
    faces: Faces = []
    for point, normal in zip(points, normals, strict=True):
        along = np.array([-normal[1], normal[0]])
        for half, low, high, width in (
            (0.46 * pitch, INNER_M - PLATE_M, 0.0, BELT_HALF_WIDTH_M),
            (0.16 * pitch, 0.0, TIP_M - PLATE_M, BELT_HALF_WIDTH_M - 0.003),
        ):
            corners = [(-half, high), (-half, low), (half, low), (half, high)]
            outline = np.array([point + a * along + n * normal for a, n in corners])
            faces += prism(counter_clockwise(outline), -width, width)
    return faces


def wheels() -> Faces:
    """Build six road wheels, the idler in front and two return rollers.

    Returns:
        The faces.
    """
    dish = [(0.0, -0.024), (0.008, -0.026), (0.011, -0.019), (0.021, -0.019), (0.023, -0.027)]
    rim = [(1.0, -0.027), (1.0, 0.027)]
    faces: Faces = []
    places = [(x, TIP_M, INNER_M) for x in ROAD_X_M[1:-1]]
    places += [(x, TIP_M, INNER_M - 0.004) for x in ROAD_X_M[[0, -1]]]
    places += [(float(ROAD_X_M[-1]), END_Z_M, INNER_M)]
    places += [(x, END_Z_M + INNER_M - 0.012, 0.012) for x in (-0.07, 0.07)]
    for x, z, radius in places:
        scale = radius / INNER_M
        face = [(r * scale, y) for r, y in dish]
        profile = [*face, *((k * radius, y) for k, y in rim), *((r, -y) for r, y in face[::-1])]
        faces += lathe(profile, (float(x), float(z)), 20)
    return faces


def sprocket() -> Faces:
    """Build a toothed ring on five spokes and a hub, about the y axis through the origin.

    Returns:
        The faces.
    """
    faces: Faces = []
    width, teeth = 0.022, 11
    for k in range(teeth):
        a, step = 2.0 * math.pi * k / teeth, 2.0 * math.pi / teeth
        ring = [(0.020, a), (0.026, a), (0.026, a + step), (0.020, a + step)]
        tooth = [(0.026, a + 0.2 * step), (0.0325, a + 0.38 * step), (0.0325, a + 0.62 * step),
                 (0.026, a + 0.8 * step)]  # fmt: skip
        for outline in (ring, tooth):
            points = np.array([(r * math.cos(t), r * math.sin(t)) for r, t in outline])
            faces += prism(counter_clockwise(points), -width, width)
    for k in range(5):
        a = 2.0 * math.pi * k / 5
        along, across = np.array([math.cos(a), math.sin(a)]), np.array([-math.sin(a), math.cos(a)])
        corners = [(0.005, -0.003), (0.021, -0.003), (0.021, 0.003), (0.005, 0.003)]
        points = np.array([u * along + v * across for u, v in corners])
        faces += prism(counter_clockwise(points), -0.8 * width, 0.8 * width)
    hub = [(0.0, -0.026), (0.008, -0.026), (0.009, -0.022), (0.009, 0.022), (0.008, 0.026),
           (0.0, 0.026)]  # fmt: skip
    return faces + lathe(hub, (0.0, 0.0), 16)


def hull() -> Faces:
    """Build a tub between the tracks with a sloping bow, and a deck with bevelled edges.

    Returns:
        The faces.
    """
    tub = np.array([(-0.205, 0.045), (0.17, 0.045), (0.225, 0.082), (0.2, 0.118), (-0.215, 0.118),
                    (-0.222, 0.07)])  # fmt: skip
    deck = [
        ((-0.215, 0.212), 0.152, 0.118),
        ((-0.215, 0.205), 0.152, 0.128),
        ((-0.195, 0.165), 0.128, 0.145),
    ]
    faces = prism(counter_clockwise(tub), -0.15, 0.15)
    rings = [
        np.array([(x0, -y, z), (x1, -y, z), (x1, y, z), (x0, y, z)]) for (x0, x1), y, z in deck
    ]
    for low, high in itertools.pairwise(rings):
        for i in range(4):
            faces.append(np.array([low[i - 1], low[i], high[i], high[i - 1]]))
    return [*faces, rings[-1]]


def counter_clockwise(outline: Array) -> Array:
    """Reverse an outline if it runs clockwise.

    Args:
        outline: (N, 2) m.

    Returns:
        (N, 2) counter-clockwise.
    """
    nxt = np.roll(outline, -1, axis=0)
    area = np.sum(outline[:, 0] * nxt[:, 1] - outline[:, 1] * nxt[:, 0])
    return outline if area > 0.0 else outline[::-1]


def write(name: str, faces: Faces) -> None:
    """Write an OBJ file with flat normals. Each face has its own vertices.

    Args:
        name: name of the file in models/assets, without extension.
        faces: the faces to write; faces without area are left out.
    """
    lines = [f"# {name}: written by scripts/make_vehicle_meshes.py"]
    normals, indices, count = [], [], 0
    for face in faces:
        normal = sum(
            np.cross(face[i] - face[0], face[i + 1] - face[0]) for i in range(1, len(face) - 1)
        )
        size = float(np.linalg.norm(normal))
        if size < 1e-12:
            continue
        normals.append("vn {:.4f} {:.4f} {:.4f}".format(*(normal / size)))
        lines += ["v {:.5f} {:.5f} {:.5f}".format(*vertex) for vertex in face]
        corners = [f"{count + i + 1}//{len(normals)}" for i in range(len(face))]
        indices += [
            f"f {corners[0]} {corners[i]} {corners[i + 1]}" for i in range(1, len(face) - 1)
        ]
        count += len(face)
    ASSETS.mkdir(parents=True, exist_ok=True)
    (ASSETS / f"{name}.obj").write_text("\n".join([*lines, *normals, *indices, ""]))


if __name__ == "__main__":
    for part in (belt, wheels, sprocket, hull):
        write(part.__name__, part())
