"""Deskew scans and refine their poses in a map (compiled; the search is in ``correlative``).

The refinement is a normal-distributions match (after Biber & Strasser 2003), point to line:

- The surface in a map cell is the weighted mean and covariance of the hit means of the 3 x 3 cells
  around it. This is finer than a cell.
- A point's residual along the surface's normal is weighted with the inverse of the variance in
  that direction. The direction along the surface has no weight: the surface is a piece of a longer
  one, cut out by the cells, so it does not tell where along it a point belongs.
- Hits that lie too close together make no line and have no weight. They may look like a thin post
  and be a far wall that few beams reached.

If all normals are parallel, as in a bare corridor, the pose along the walls depends only on errors
of the normals. The pose is not changed in that direction, and the direction is declared unknown
(Zhang, Kaess & Singh 2016, "On degeneracy of optimization-based state estimation problems").
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.geometry.se2 import interpolate_xyt, wrap_angle
from simloop.messages import FloatArray

_ROBUST = 9.0  # squared Mahalanobis distance at which a point's weight has fallen to a quarter
_LEAST_CELLS = 2  # a surface needs this many cells with hits
_LEAST_MATCHED = 10  # the refinement needs this many matched points
_EQUAL_HITS = 10.0  # cells with at least this many hits have equal weight in a line
_LONG = 0.15  # a surface with a larger variance along it is a line, cells^2
# A direction is unobservable if it has less than this share of the best direction's information.
# Normals of new surfaces are off by some 10 degrees, which gives this much along a wall.
_DEGENERATE = 0.03
_STIFF = 1e12  # information that keeps the pose unchanged in an unobservable direction
_TINY = 1e-9  # information added so that the normal equations can be solved
_SMALL_STEP = 1e-4  # the iteration ends with a smaller step, m and rad


@njit(cache=True)
def _pose_between(
    k: int, pose_t_ns: NDArray[np.int64], poses: FloatArray, t_ns: int
) -> tuple[float, float, float]:
    """Interpolate the pose at a time between the k-th pose and the next one."""
    if poses.shape[0] == 1:
        return poses[0, 0], poses[0, 1], poses[0, 2]
    f = (t_ns - pose_t_ns[k]) / (pose_t_ns[k + 1] - pose_t_ns[k])
    ax, ay, ayaw = poses[k, 0], poses[k, 1], poses[k, 2]
    return interpolate_xyt(ax, ay, ayaw, poses[k + 1, 0], poses[k + 1, 1], poses[k + 1, 2], f)


@njit(cache=True)
def deskew(
    angles: FloatArray,
    ranges: FloatArray,
    beam_t_ns: NDArray[np.int64],
    limits: FloatArray,
    pose_t_ns: NDArray[np.int64],
    poses: FloatArray,
    mount: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Remove the motion during a scan from its hits and beam origins.

    Args:
        angles: (n,) angles of the beams in the laser frame, rad.
        ranges: (n,) m; ranges that are not finite or outside the limits are skipped.
        beam_t_ns: (n,) time of each beam, ns.
        limits: (2,) least and greatest range, m.
        pose_t_ns: (k,) rising stamps of the poses, ns.
        poses: (k, 3) x, y, yaw of base_link in a fixed frame; the last is at the end of the scan.
        mount: (3,) x, y, yaw of the laser in base_link.

    Returns:
        Hits and origins, (m, 2) each, in base_link at the last pose, m.
    """
    points, origins = np.empty((angles.shape[0], 2)), np.empty((angles.shape[0], 2))
    last = poses.shape[0] - 1
    ex, ey, eyaw = poses[last, 0], poses[last, 1], poses[last, 2]
    cos_end, sin_end = math.cos(eyaw), math.sin(eyaw)
    count, k = 0, 0
    for i in range(angles.shape[0]):
        r = ranges[i]
        if not (limits[0] <= r <= limits[1]):
            continue
        while k + 1 < last and pose_t_ns[k + 1] < beam_t_ns[i]:
            k += 1
        while k > 0 and pose_t_ns[k] > beam_t_ns[i]:
            k -= 1
        x, y, yaw = _pose_between(k, pose_t_ns, poses, beam_t_ns[i])
        # The laser's position relative to the last pose, still in the axes of the fixed frame.
        c, s = math.cos(yaw), math.sin(yaw)
        lx = x + c * mount[0] - s * mount[1] - ex
        ly = y + s * mount[0] + c * mount[1] - ey
        heading = yaw + mount[2] + angles[i]
        px, py = lx + r * math.cos(heading), ly + r * math.sin(heading)
        # Rotate both into the axes of the last pose.
        origins[count, 0] = cos_end * lx + sin_end * ly
        origins[count, 1] = cos_end * ly - sin_end * lx
        points[count, 0] = cos_end * px + sin_end * py
        points[count, 1] = cos_end * py - sin_end * px
        count += 1
    return points[:count].copy(), origins[:count].copy()


@njit(cache=True)
def surface_at(
    row: int,
    col: int,
    hits: FloatArray,
    grain: float,
    resolution: float,
    out: FloatArray,
) -> bool:
    """Compute the surface in a cell: its mean and its inverse covariance [[a, b], [b, c]].

    The inverse covariance has rank one: it is zero along the surface. It is all zero if the hits
    make no line.

    Args:
        row: Row of the cell.
        col: Column of the cell.
        hits: (rows, cols, 3) sums of x and y, m from the grid's corner, and number of the hits.
        grain: Standard deviation added across the surface, m.
        resolution: Side of a cell, m.
        out: (5,) output: x, y, m, and a, b, c, 1/m^2.

    Returns:
        Whether there is a surface.
    """
    cells = 0
    weight = sx = sy = sxx = sxy = syy = 0.0
    rows, cols = hits.shape[:2]
    for i in range(max(0, row - 1), min(rows, row + 2)):
        for j in range(max(0, col - 1), min(cols, col + 2)):
            n = hits[i, j, 2]
            if n <= 0.0:
                continue
            x, y = hits[i, j, 0] / n, hits[i, j, 1] / n
            cells += 1
            # The weight of a cell is limited, so that the line does not pass through the most seen
            # cell only. From there, a small error in direction would be a large error in place.
            w = min(n, _EQUAL_HITS)
            weight += w
            sx += w * x
            sy += w * y
            sxx += w * x * x
            sxy += w * x * y
            syy += w * y * y
    if cells < _LEAST_CELLS:
        return False
    mx, my = sx / weight, sy / weight
    cxx, cyy, cxy = sxx / weight - mx * mx, syy / weight - my * my, sxy / weight - mx * my
    wide, thin, cos, sin = principal_axes(cxx, cxy, cyy)
    pull = 1.0 / (thin + grain * grain) if wide > _LONG * resolution**2 else 0.0
    out[0], out[1] = mx, my
    out[2], out[3], out[4] = pull * sin * sin, -pull * cos * sin, pull * cos * cos
    return True


@njit(cache=True)
def principal_axes(a: float, b: float, c: float) -> tuple[float, float, float, float]:
    """Compute the eigenvalues and the first axis of a symmetric matrix [[a, b], [b, c]].

    Args:
        a: Upper left entry.
        b: Off-diagonal entry.
        c: Lower right entry.

    Returns:
        Greater and lesser eigenvalue; cosine and sine of the axis of the greater one.
    """
    middle, half = 0.5 * (a + c), 0.5 * (a - c)
    reach = math.hypot(half, b)
    angle = 0.5 * math.atan2(b, half)
    return middle + reach, max(0.0, middle - reach), math.cos(angle), math.sin(angle)


@njit(cache=True)
def unheld_direction(h: FloatArray) -> FloatArray:
    """Return the direction that a match cannot observe, if there is one.

    The test uses the information of x and y with the yaw unknown (the Schur complement).

    Args:
        h: (3, 3) information of x, y, yaw.

    Returns:
        (3,) unit vector in x, y, yaw; zeros if all directions are observable.
    """
    a = h[0, 0] - h[0, 2] * h[0, 2] / h[2, 2]
    b = h[0, 1] - h[0, 2] * h[1, 2] / h[2, 2]
    c = h[1, 1] - h[1, 2] * h[1, 2] / h[2, 2]
    most, least, cos, sin = principal_axes(a, b, c)
    out = np.zeros(3)
    if least < _DEGENERATE * most:
        out[0], out[1] = -sin, cos
    return out


class _SurfaceCache(NamedTuple):
    """Last surface of each point: its data (n, 5), whether there is one (n,), its cell (n,)."""

    surfaces: FloatArray
    known: NDArray[np.bool_]
    cell_of: NDArray[np.int64]


@njit(cache=True)
def refine(
    points: FloatArray,
    start: FloatArray,
    hits: FloatArray,
    x0: float,
    y0: float,
    resolution: float,
    grain: float,
    most_steps: int,
) -> tuple[FloatArray, FloatArray, float, float]:
    """Refine a pose by Gauss-Newton, point to line, with robust weights.

    Args:
        points: (n, 2) hits in base_link, m.
        start: (3,) x, y, yaw of base_link in map, near the solution.
        hits: (rows, cols, 3) sums of x and y, m from (x0, y0), and number of the hits.
        x0: x of the grid's corner, m. Sums are relative to it, which keeps them well conditioned.
        y0: y of the grid's corner, m.
        resolution: Side of a cell, m.
        grain: Standard deviation added across a surface, m.
        most_steps: Largest number of iterations.

    Returns:
        Pose (3,); information (3, 3) of the last step, with robust weights, zero in an
        unobservable direction; share of the points that met a surface; mean squared Mahalanobis
        distance of these points, about 2 or less if the scan fits the map.
    """
    n, pose = points.shape[0], start.copy()
    cache = _SurfaceCache(np.empty((n, 5)), np.zeros(n, np.bool_), np.full(n, -1))
    h, g, open_ = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    share, residual = 0.0, 0.0
    for _ in range(most_steps):
        matched, total = _normal_equations(
            points, pose, hits, x0, y0, resolution, grain, cache, h, g
        )
        if matched < _LEAST_MATCHED:
            return pose, h, 0.0, 1e9
        share, residual = matched / n, total / matched
        h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
        for k in range(3):
            h[k, k] += _TINY
        # An unobservable direction is made stiff, so that the step has no part in it.
        open_ = unheld_direction(h)
        step = np.linalg.solve(h + _STIFF * np.outer(open_, open_), g)
        pose[0] -= step[0]
        pose[1] -= step[1]
        pose[2] = wrap_angle(pose[2] - step[2])
        if abs(step[0]) + abs(step[1]) < _SMALL_STEP and abs(step[2]) < _SMALL_STEP:
            break
    held = np.eye(3) - np.outer(open_, open_)
    return pose, held @ h @ held, share, residual


@njit(cache=True)
def _normal_equations(
    points: FloatArray,
    pose: FloatArray,
    hits: FloatArray,
    x0: float,
    y0: float,
    resolution: float,
    grain: float,
    cache: _SurfaceCache,
    h: FloatArray,
    g: FloatArray,
) -> tuple[int, float]:
    """Fill the upper half of h (3, 3) and g (3,); return matched points and their residual."""
    rows, cols = hits.shape[0], hits.shape[1]
    surfaces, known, cell_of = cache
    h[:], g[:] = 0.0, 0.0
    matched, total = 0, 0.0
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    for i in range(points.shape[0]):
        rx = cos * points[i, 0] - sin * points[i, 1]
        ry = sin * points[i, 0] + cos * points[i, 1]
        px, py = pose[0] + rx - x0, pose[1] + ry - y0
        row, col = math.floor(py / resolution), math.floor(px / resolution)
        if row < 0 or col < 0 or row >= rows or col >= cols:
            continue
        # A point's surface is computed again only if the point has moved to another cell. This is
        # rare in the last steps. Neighbours in a scan often share a surface.
        cell, surface = row * cols + col, surfaces[i]
        if cell != cell_of[i]:
            cell_of[i] = cell
            if i > 0 and cell == cell_of[i - 1]:
                known[i] = known[i - 1]
                surface[:] = surfaces[i - 1]
            else:
                known[i] = surface_at(row, col, hits, grain, resolution, surface)
        if not known[i]:
            continue
        dx, dy = px - surface[0], py - surface[1]
        a, b, c = surface[2], surface[3], surface[4]
        d2 = a * dx * dx + 2.0 * b * dx * dy + c * dy * dy
        w = 1.0 / (1.0 + d2 / _ROBUST) ** 2
        matched += 1
        total += min(d2, _ROBUST)
        # Residual's Jacobian: [1 0 -ry; 0 1 rx]
        ja, jb = -a * ry + b * rx, -b * ry + c * rx
        gx, gy = a * dx + b * dy, b * dx + c * dy
        h[0, 0] += w * a
        h[0, 1] += w * b
        h[1, 1] += w * c
        h[0, 2] += w * ja
        h[1, 2] += w * jb
        h[2, 2] += w * (-ry * ja + rx * jb)
        g[0] += w * gx
        g[1] += w * gy
        g[2] += w * (-ry * gx + rx * gy)
    return matched, total
