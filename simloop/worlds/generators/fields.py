"""Open ground with many round things on it."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from simloop.worlds.layout import Bounds
from simloop.worlds.obstacles import Obstacle

_BARN_CELL_M = 0.15
_BARN_ROUNDS = 4
_BARN_BORN, _BARN_DIES = 5, 1  # neighbours of eight
_BARN_HEIGHT_M = 0.6
_TRUNK_M = (0.1, 0.4)
_PER_PLACE = 30


def barn(rng: np.random.Generator, bounds: Bounds, density: float) -> list[Obstacle]:
    """Cylinders of 0.15 m on a raster of as much, in clumps: after BARN (Perille et al. 2020).

    Cells are filled by chance, and then a cellular automaton fills what has five filled neighbours
    and empties what has one or none.
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
    """Trunks whose surfaces are ``apart_m`` apart or more (dart throwing).

    density: of the darts that would fill the ground, how many are thrown.
    """
    low, high = np.array(bounds[:2]), np.array(bounds[2:])
    mean_m = apart_m + sum(_TRUNK_M) / 2
    darts = int(density * _PER_PLACE * np.prod(high - low) / mean_m**2)
    places, radii = np.empty((0, 2)), np.empty(0)
    for _ in range(darts):
        place, radius = rng.uniform(low, high), 0.5 * rng.uniform(*_TRUNK_M)
        if np.all(np.hypot(*(places - place).T) - radii - radius >= apart_m):
            places, radii = np.vstack([places, place]), np.append(radii, radius)
    return [
        Obstacle("cylinder", (float(x), float(y)), (2.0 * float(r),), 0.0, 0.6)
        for (x, y), r in zip(places, radii, strict=True)
    ]
