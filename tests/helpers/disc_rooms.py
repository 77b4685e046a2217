"""A square room with round things in it, as a laser sees it."""

from __future__ import annotations

import math

import numpy as np


def room_scan(centre, discs=(), rays=360, half=4.0):
    """(n, 2) in map, the hits of a laser at ``centre`` in a square room with discs (x, y, r)."""
    angle = -math.pi + 2.0 * math.pi * np.arange(1, rays + 1) / rays
    way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    with np.errstate(divide="ignore"):
        sides = np.stack([(half - centre) / way, (-half - centre) / way])
    far = np.where(sides > 0.0, sides, np.inf).min(axis=(0, 2))
    for x, y, r in discs:
        off = np.array([x, y]) - centre
        along = way @ off
        inside = r * r - (off @ off - along**2)
        hit = (inside > 0.0) & (along > 0.0)
        far = np.where(hit, np.minimum(far, along - np.sqrt(np.maximum(inside, 0.0))), far)
    return centre + far[:, None] * way
