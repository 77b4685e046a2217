"""Gazebo worlds as text, and where something stands in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from simloop.worlds.floor_plan import FloorPlan, rasterise
from simloop.worlds.gazebo_world import read_sdf
from simloop.worlds.layout import Layout

BOUNDS = (-10.0, -10.0, 10.0, 10.0)


def world(*parts: str, version: str = "1.9") -> str:
    """A world of these elements."""
    return f"<sdf version='{version}'><world name='w'>{''.join(parts)}</world></sdf>"


def collision(geometry: str, pose: str = "") -> str:
    """A collision shape."""
    return f"<collision name='c'>{pose}<geometry>{geometry}</geometry></collision>"


def box(x: float, y: float, z: float, pose: str = "") -> str:
    """A collision box of this size."""
    return collision(f"<box><size>{x} {y} {z}</size></box>", pose)


def pose(text: str, attributes: str = "") -> str:
    """A pose."""
    return f"<pose {attributes}>{text}</pose>"


def model(name: str, content: str, at: str = "", attributes: str = "", link: str = "l") -> str:
    """A static model of one link with this content. at: its pose element."""
    inside = f"<link name='{link}'>{content}</link>"
    return f"<model name='{name}' {attributes}><static>true</static>{at}{inside}</model>"


def read(folder: Path, text: str, **options: object) -> Layout:
    """Read a world from its text."""
    file = folder / "some.world"
    file.write_text(text)
    return read_sdf(file, options.pop("bounds", BOUNDS), **options)  # type: ignore[arg-type]


def plan_of(layout: Layout, resolution_m: float = 0.05) -> FloorPlan:
    """The floor plan of a world."""
    outlines = [section for one in layout.obstacles for section in one.sections()]
    assert layout.bounds_m is not None
    return rasterise(outlines, layout.bounds_m, resolution_m)


def centres(layout: Layout) -> np.ndarray:
    """(N, 2) the places of all obstacles, in order of x, then y."""
    return np.array(sorted(one.position_m for one in layout.obstacles))
