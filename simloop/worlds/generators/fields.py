"""Draw open ground with many round obstacles."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from simloop.common.limits import SHAPES, check_limit
from simloop.messages import FloatArray
from simloop.worlds.layout import Bounds
from simloop.worlds.obstacles import Obstacle

_BARN_CELL_M = 0.15
_BARN_ROUNDS = 4
_BARN_BORN, _BARN_DIES = 5, 1  # number of filled neighbours, out of eight
_BARN_HEIGHT_M = 0.6
_TRUNK_M = (0.1, 0.4)  # least and greatest diameter
_PER_PLACE = 30  # darts for each trunk that has a place, at a density of 1


def barn(rng: np.random.Generator, bounds: Bounds, density: float) -> list[Obstacle]:
    """Draw clumps of cylinders on a raster of 0.15 m, after BARN (Perille et al. 2020).

    Cells are filled at random. Then a cellular automaton fills cells with five or more filled
    neighbours, and empties cells with one or none.

    Args:
        rng: random generator of all draws.
        bounds: x_min, y_min, x_max, y_max of the floor in map, m.
        density: initial share of filled cells, 0 to 1.

    Returns:
        The cylinders, each as large as a cell.
    """
    x0, y0, x1, y1 = bounds
    shape = int((x1 - x0) / _BARN_CELL_M), int((y1 - y0) / _BARN_CELL_M)
    filled = rng.random(shape) < density
    kernel = np.ones((3, 3), int)
    kernel[1, 1] = 0
    for _ in range(_BARN_ROUNDS):
        around = ndimage.convolve(filled.astype(int), kernel, mode="constant")
        filled = (filled & (around > _BARN_DIES)) | (around >= _BARN_BORN)
    return [
        Obstacle(
            "cylinder",
            (float(x0 + (i + 0.5) * _BARN_CELL_M), float(y0 + (j + 0.5) * _BARN_CELL_M)),
            (_BARN_CELL_M,),
            0.0,
            _BARN_HEIGHT_M,
        )
        for i, j in np.argwhere(filled)
    ]


def forest(
    rng: np.random.Generator, bounds: Bounds, apart_m: float, density: float
) -> list[Obstacle]:
    """Draw trunks of 0.1 to 0.4 m that keep a distance, by dart throwing.

    Args:
        rng: random generator of all draws.
        bounds: x_min, y_min, x_max, y_max of the floor in map, m.
        apart_m: least distance between the surfaces of two trunks, m.
        density: share of the number of darts that would fill the ground, 0 to 1.

    Returns:
        The trunks.
    """
    low, high = np.array(bounds[:2]), np.array(bounds[2:])
    mean_m = apart_m + sum(_TRUNK_M) / 2
    darts = int(density * _PER_PLACE * np.prod(high - low) / mean_m**2)
    near = _Trunks(apart_m)
    for _ in range(darts):
        place, radius = rng.uniform(low, high), 0.5 * rng.uniform(*_TRUNK_M)
        if near.keeps_apart(place, radius):
            near.add(place, radius)
            check_limit(len(near.trunks), SHAPES, "generator: trunks of this forest")
    return [
        Obstacle("cylinder", (float(x), float(y)), (2.0 * float(r),), 0.0, 0.6)
        for x, y, r in near.trunks
    ]


class _Trunks:
    """The trunks of a forest, by squares that are as large as two trunks can be too near."""

    def __init__(self, apart_m: float) -> None:
        self.trunks: list[tuple[float, float, float]] = []
        self._apart_m, self._side_m = apart_m, apart_m + 1.1 * _TRUNK_M[1]
        self._squares: dict[tuple[int, int], list[int]] = {}

    def keeps_apart(self, place: FloatArray, radius: float) -> bool:
        """Tell whether a new trunk keeps its distance from all others."""
        i, j = self._square(place)
        near = [
            self.trunks[number]
            for di in (-1, 0, 1)
            for dj in (-1, 0, 1)
            for number in self._squares.get((i + di, j + dj), ())
        ]
        if not near:
            return True
        x, y, radii = np.array(near).T
        return bool(np.all(np.hypot(x - place[0], y - place[1]) - radii - radius >= self._apart_m))

    def add(self, place: FloatArray, radius: float) -> None:
        self._squares.setdefault(self._square(place), []).append(len(self.trunks))
        self.trunks.append((float(place[0]), float(place[1]), radius))

    def _square(self, place: FloatArray) -> tuple[int, int]:
        return int(place[0] // self._side_m), int(place[1] // self._side_m)
