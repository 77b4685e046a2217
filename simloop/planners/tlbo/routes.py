"""Find rough routes of different homotopy, from which a planner's first class begins.

One wave from the goal and one from the start cross a coarse lattice, over discs and field alike.
The way start -> v -> goal through a node v has a known length. Its signature tells on which side
it passes each obstacle. The shortest ways with different signatures become routes and are pulled
taut.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simloop.messages import FloatArray
from simloop.planners.problem.bends import MAX_POINTS, pull_taut, settle
from simloop.planners.problem.clearance import Problem, relaxed_clearance
from simloop.planners.problem.objective import evaluate

_STRAIGHT, _DIAGONAL = 10, 14  # integer lengths let the wave run on buckets, without a heap
_NEARLY, _BLOCKED, _SOLID = 4, 100, 1500
_FAR = np.int32(2**30)
_LIFTS = 3
_TABLE = 512
_HOPELESS = 1.06  # a taut route that costs more than this times the best settled route is dropped
_STRETCH = 1.35  # routes longer than this times the shortest are not followed

IntArray = NDArray[np.int32]


class Lattice(NamedTuple):
    """Nodes at low + (ix, iy) * step.

    Attributes:
        low_x: x of node (0, 0), in map, m.
        low_y: y of node (0, 0), in map, m.
        step: Distance between two neighbouring nodes, m.
        weight: (ny, nx) cost factor of a step at a node.
    """

    low_x: float
    low_y: float
    step: float
    weight: IntArray


@njit(cache=True)
def make_lattice(p: Problem, most_nodes: int, solid: bool = False) -> Lattice:
    """Cover the waypoints' box and both ends with a lattice.

    Args:
        p: The problem.
        most_nodes: Approximate upper limit of the number of nodes.
        solid: Whether blocked nodes cost so much that the longest way round is cheaper. Otherwise,
            if the way round is long, a route may cross blocked nodes. It then finds gaps between
            the nodes, but may also cross a thin wall.

    Returns:
        The lattice.
    """
    blocked = _SOLID if solid else _BLOCKED
    low_x = min(p.low_x, p.start_x, p.goal_x)
    low_y = min(p.low_y, p.start_y, p.goal_y)
    wide = max(p.high_x, p.start_x, p.goal_x) - low_x
    high = max(p.high_y, p.start_y, p.goal_y) - low_y
    step = max(math.sqrt(wide * high / most_nodes), 0.02)
    nx = int(wide / step + 1e-9) + 1
    ny = int(high / step + 1e-9) + 1
    weight = np.ones((ny, nx), np.int32)
    if p.field.size > 0 or p.corners.size > 0:
        for iy in range(ny):
            for ix in range(nx):
                lack = p.safe_m - relaxed_clearance(p, low_x + ix * step, low_y + iy * step)
                if lack > 0.0:
                    weight[iy, ix] = _NEARLY if lack < 0.5 * step else blocked
    else:
        for k in range(p.discs.shape[1]):
            _draw_disc(p, weight, k, low_x, low_y, step, blocked)
    return Lattice(low_x, low_y, step, weight)


@njit(cache=True)
def _draw_disc(
    p: Problem, weight: IntArray, k: int, low_x: float, low_y: float, step: float, blocked: int
) -> None:
    """Raise the weights of the nodes within the safe distance of disc k."""
    ny, nx = weight.shape
    reach = p.discs[2, k] + p.safe_m
    cx = (p.discs[0, k] - low_x) / step
    cy = (p.discs[1, k] - low_y) / step
    outer = reach / step
    inner = max(0.0, outer - 0.5)
    for iy in range(max(0, math.ceil(cy - outer)), min(ny - 1, math.floor(cy + outer)) + 1):
        for ix in range(max(0, math.ceil(cx - outer)), min(nx - 1, math.floor(cx + outer)) + 1):
            square = (ix - cx) ** 2 + (iy - cy) ** 2
            if square < outer * outer:
                value = blocked if square < inner * inner else _NEARLY
                weight[iy, ix] = max(weight[iy, ix], value)


@njit(cache=True)
def _ray_codes(lattice: Lattice) -> NDArray[np.int64]:
    """Compute the (ny, nx) codes of steps from column ix to ix + 1 at (or from) row iy.

    Each connected blocked region sends a ray down from its lowest node, between two columns. A step
    across the ray adds the region's random number, modulo 2^64.
    """
    weight = lattice.weight
    ny, nx = weight.shape
    code = np.zeros((ny, nx), np.int64)
    seen = np.zeros((ny, nx), np.bool_)
    queue = np.empty(ny * nx, np.int32)
    random = np.int64(0x9E3779B97F4A7C1)
    for iy in range(ny):
        for ix in range(nx):
            if seen[iy, ix] or weight[iy, ix] < _BLOCKED:
                continue
            random = random * np.int64(6364136223846793005) + np.int64(1442695040888963407)
            for row in range(iy):
                code[row, ix] += random
            queue[0] = iy * nx + ix
            seen[iy, ix] = True
            head, tail = 0, 1
            while head < tail:
                y, x = queue[head] // nx, queue[head] % nx
                head += 1
                for dy in range(-1, 2):
                    for dx in range(-1, 2):
                        v, u = y + dy, x + dx
                        if v < 0 or v >= ny or u < 0 or u >= nx or seen[v, u]:
                            continue
                        if weight[v, u] >= _BLOCKED:
                            seen[v, u] = True
                            queue[tail] = v * nx + u
                            tail += 1
    return code


@njit(cache=True, forceinline=True)
def _crossed(code: NDArray[np.int64], ux: int, uy: int, vx: int, vy: int) -> Any:
    """Return what a step from node u to its neighbour v adds to the signature."""
    if vx > ux:
        return code[uy, ux]
    return -code[vy, vx] if vx < ux else np.int64(0)


@njit(cache=True)
def _wave(
    lattice: Lattice,
    code: NDArray[np.int64],
    source: int,
    target: int,
    onward: IntArray,
    far: int,
) -> tuple[IntArray, IntArray, NDArray[np.int64], int]:
    """Run Dijkstra with buckets: distance, parent and signature of each node from ``source``.

    The last return value is the search limit.

    onward: remaining distance to the target, known from the other wave (empty for the first wave).
    """
    weight = lattice.weight
    ny, nx = weight.shape
    nodes = ny * nx
    distance = np.full(nodes, _FAR, np.int32)
    parent = np.full(nodes, -1, np.int32)
    signature = np.zeros(nodes, np.int64)
    buckets = _DIAGONAL * int(weight.max()) + 1
    head = np.full(buckets, -1, np.int32)
    entry_node = np.empty(8 * nodes + 8, np.int32)
    entry_next = np.empty(8 * nodes + 8, np.int32)
    entry_node[0], entry_next[0], head[0] = source, -1, 0
    entries, live = 1, 1
    distance[source] = 0
    now = 0
    while live > 0 and now <= far:
        slot = now % buckets  # the nearest bucket that may hold an entry
        entry = head[slot]
        if entry < 0:
            now += 1
            continue
        head[slot] = entry_next[entry]
        live -= 1
        u = entry_node[entry]
        if distance[u] != now:
            continue
        if u == target and onward.size == 0:
            far = min(far, int(now * _STRETCH) + 10 * _STRAIGHT)  # others may be a little longer
        uy, ux = u // nx, u % nx
        for k in range(9):  # the eight neighbours; 4 is the node itself
            vy, vx = uy + k // 3 - 1, ux + k % 3 - 1
            if k == 4 or vy < 0 or vy >= ny or vx < 0 or vx >= nx:
                continue
            v = vy * nx + vx
            step = _DIAGONAL if k % 2 == 0 else _STRAIGHT
            reach = now + step * max(weight[uy, ux], weight[vy, vx])
            if reach >= distance[v] or (onward.size > 0 and reach + onward[v] > far):
                continue
            distance[v] = reach
            parent[v] = u
            signature[v] = signature[u] + _crossed(code, ux, uy, vx, vy)
            entry_node[entries] = v
            entry_next[entries] = head[reach % buckets]
            head[reach % buckets] = entries
            entries += 1
            live += 1
    return distance, parent, signature, far


@njit(cache=True)
def _shortest_classes(
    ahead: IntArray,
    behind: IntArray,
    signature_ahead: NDArray[np.int64],
    signature_behind: NDArray[np.int64],
    far: int,
    most: int,
) -> IntArray:
    """Find the node of least detour for the ``most`` shortest signatures, shortest first."""
    key = np.zeros(_TABLE, np.int64)
    length = np.full(_TABLE, _FAR, np.int32)
    node = np.full(_TABLE, -1, np.int32)
    held = 0
    # The hash table maps a signature to its node of least detour.
    for v in range(ahead.size):
        total = ahead[v] + behind[v]
        if total > far:
            continue
        signature = signature_behind[v] - signature_ahead[v]
        slot = (signature ^ (signature >> 29)) & (_TABLE - 1)
        while node[slot] >= 0 and key[slot] != signature:
            slot = (slot + 1) & (_TABLE - 1)
        if node[slot] < 0:
            if held >= _TABLE // 2:
                continue
            held += 1
            key[slot] = signature
        if total < length[slot]:
            length[slot] = total
            node[slot] = v
    order = np.argsort(length, kind="mergesort")
    return node[order[: min(held, most)]]


@njit(cache=True)
def _chain(
    lattice: Lattice, p: Problem, via: int, from_start: IntArray, to_goal: IntArray, out: FloatArray
) -> int:
    """Write the points start -> ... -> via -> ... -> goal along both waves' parents."""
    nx = lattice.weight.shape[1]
    # Count the points back to the start, then write them in travel order.
    n = 0
    v = via
    while v >= 0:
        n += 1
        v = from_start[v]
    v = via
    for k in range(n - 1, -1, -1):
        out[k, 0] = lattice.low_x + (v % nx) * lattice.step
        out[k, 1] = lattice.low_y + (v // nx) * lattice.step
        v = from_start[v]
    v = to_goal[via]
    while v >= 0:
        out[n, 0] = lattice.low_x + (v % nx) * lattice.step
        out[n, 1] = lattice.low_y + (v // nx) * lattice.step
        n += 1
        v = to_goal[v]
    # The exact ends replace their nearest nodes.
    out[0, 0], out[0, 1] = p.start_x, p.start_y
    n = max(n, 2)
    out[n - 1, 0], out[n - 1, 1] = p.goal_x, p.goal_y
    return n


@njit(cache=True)
def _lift(p: Problem, step: float, chain: FloatArray, n: int) -> None:
    """Move each point of a chain with too little clearance up the gradient of the clearance.

    The target is a little more than the required clearance, because a segment between two points
    about a corner cuts the corner.
    """
    wanted = p.safe_m + min(step * step / (3.0 * p.safe_m), 0.3 * step)
    h = 0.25 * step
    for i in range(1, n - 1):
        for _ in range(_LIFTS):
            x, y = chain[i, 0], chain[i, 1]
            here = relaxed_clearance(p, x, y)
            if here >= wanted:
                break
            gx = relaxed_clearance(p, x + h, y) - relaxed_clearance(p, x - h, y)
            gy = relaxed_clearance(p, x, y + h) - relaxed_clearance(p, x, y - h)
            size = math.hypot(gx, gy)
            if size < 1e-9:
                break
            move = min(wanted - here + 1e-6, step) / size
            x = min(max(x + move * gx, p.low_x), p.high_x)
            y = min(max(y + move * gy, p.low_y), p.high_y)
            if relaxed_clearance(p, x, y) <= here:
                break
            chain[i, 0], chain[i, 1] = x, y


@njit(cache=True)
def _node_at(lattice: Lattice, x: float, y: float) -> int:
    """Return the number of the node nearest to a point."""
    ny, nx = lattice.weight.shape
    ix = min(max(int((x - lattice.low_x) / lattice.step + 0.5), 0), nx - 1)
    iy = min(max(int((y - lattice.low_y) / lattice.step + 0.5), 0), ny - 1)
    return iy * nx + ix


@njit(cache=True)
def find_routes(
    p: Problem,
    most_nodes: int,
    sweeps: int,
    routes: FloatArray,
    counts: IntArray,
    costs: FloatArray,
    stack: FloatArray,
    solid: bool = False,
) -> int:
    """Find the shortest route of each of the shortest homotopy classes.

    Args:
        p: The problem.
        most_nodes: Approximate upper limit of the number of lattice nodes.
        sweeps: See `settle`.
        routes: (K, MAX_POINTS, 2) receives the routes, the cheapest first, m.
        counts: (K,) receives the number of points of each route.
        costs: (K,) receives J of each route with split bends, see `settle`.
        stack: Scratch.
        solid: See `make_lattice`.

    Returns:
        Number of routes found.
    """
    lattice = make_lattice(p, most_nodes, solid)
    ny, nx = lattice.weight.shape
    code = _ray_codes(lattice)
    start = _node_at(lattice, p.start_x, p.start_y)
    goal = _node_at(lattice, p.goal_x, p.goal_y)
    # A wave from the goal bounds the search; the wave from the start stays within this bound.
    nothing = np.empty(0, np.int32)
    ahead, to_goal, code_ahead, far = _wave(lattice, code, goal, start, nothing, _FAR - 1)
    behind, from_start, code_behind, _ = _wave(lattice, code, start, goal, ahead, far)
    vias = _shortest_classes(ahead, behind, code_ahead, code_behind, far, counts.size)
    chain = np.empty((2 * nx * ny + 2, 2))
    scratch = np.empty((2, MAX_POINTS, 2))
    best = np.inf
    # Each class of ways becomes one route: moved off the obstacles, pulled taut, bends split.
    for k in range(vias.size):
        n = _chain(lattice, p, vias[k], from_start, to_goal, chain)
        _lift(p, lattice.step, chain, n)
        m = pull_taut(p, chain, n, routes[k], stack)
        counts[k], costs[k] = m, evaluate(p, routes[k], m, np.inf, stack)
        if costs[k] < _HOPELESS * best:
            counts[k], costs[k] = settle(p, routes[k], m, sweeps, scratch, stack)
            best = min(best, costs[k])
    sort_routes(routes, counts, costs, vias.size)
    return vias.size


@njit(cache=True)
def sort_routes(routes: FloatArray, counts: IntArray, costs: FloatArray, n: int) -> None:
    """Sort routes by their cost, in place, by insertion because they are few.

    Args:
        routes: (>= n, MAX_POINTS, 2) the routes.
        counts: (>= n,) number of points of each route.
        costs: (>= n,) cost of each route.
        n: Number of routes.
    """
    for i in range(1, n):  # insertion sort: few routes
        k = i
        while k > 0 and costs[k] < costs[k - 1]:
            for j in range(MAX_POINTS):
                for c in range(2):
                    swap = routes[k, j, c]
                    routes[k, j, c] = routes[k - 1, j, c]
                    routes[k - 1, j, c] = swap
            counts[k], counts[k - 1] = counts[k - 1], counts[k]
            costs[k], costs[k - 1] = costs[k - 1], costs[k]
            k -= 1
