"""What a scene looks like, apart from any physics engine: for whoever draws it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from simloop.messages import FloatArray

ShapeKind = Literal["plane", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"]


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One visible thing, in the frame of the body that carries it (``world`` for the arena).

    size_m: (3,) as in MJCF: half sizes of box and ellipsoid, half extents of a plane; radius and
    half length of cylinder and capsule; radius of a sphere. rgba: (4,) in 0..1. A mesh has
    vertices_m (V, 3) and faces (F, 3); no other kind does.
    """

    name: str
    body: str
    kind: ShapeKind
    position_m: FloatArray
    quaternion_wxyz: FloatArray
    size_m: FloatArray
    rgba: FloatArray
    vertices_m: FloatArray | None = None
    faces: NDArray[np.int32] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A body that shapes hang on: where it stands in its parent when its joint is at zero."""

    name: str
    parent: str
    position_m: FloatArray
    quaternion_wxyz: FloatArray
