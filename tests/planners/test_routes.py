"""Routes: the lattice, its waves and its signatures against slow twins; the mixture of routes."""

from __future__ import annotations

from itertools import pairwise, permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from simloop.benchmarks.planners.scenes import box_distance, box_world, disc_world
from simloop.planners.problem.bends import MAX_POINTS
from simloop.planners.problem.clearance import make_problem
from simloop.planners.problem.objective import intrusion, make_stack
from simloop.planners.tlbo.recombine import recombine
from simloop.planners.tlbo.routes import (
    _BLOCKED,
    _DIAGONAL,
    _FAR,
    _NEARLY,
    _STRAIGHT,
    _STRETCH,
    Lattice,
    _chain,
    _ray_codes,
    _shortest_classes,
    _wave,
    find_routes,
    make_lattice,
)

SAFE = 0.26
BOX = (0.0, 0.0, 5.0, 5.0)
START, GOAL = np.array([0.5, 0.5, 0.0]), np.array([4.5, 4.5])
NOTHING = np.empty(0, np.int32)
seeds = st.integers(0, 2**32 - 1)


def room(seed, count=9):
    rng = np.random.default_rng(seed)
    discs = np.column_stack([rng.uniform(0.3, 4.7, (count, 2)), rng.uniform(0.05, 0.45, count)])
    apart = np.hypot(*(discs[:, None, :2] - [START[:2], GOAL]).transpose(2, 0, 1)) - discs[:, 2:]
    return discs[apart.min(axis=1) > SAFE + 0.1]


def problem_of(view, start=START, goal=GOAL):
    return make_problem(view, start, goal, safe_m=SAFE)


def nodes_of(lattice):
    ny, nx = lattice.weight.shape
    x, y = np.meshgrid(np.arange(nx), np.arange(ny))
    corner = [lattice.low_x, lattice.low_y]
    return corner + lattice.step * np.column_stack([x.ravel(), y.ravel()])


@given(seed=seeds, field=st.booleans())
@settings(max_examples=25)
def test_a_node_weighs_what_its_clearance_says(seed, field):
    rng = np.random.default_rng(seed)
    if field:
        low = rng.uniform(0.8, 3.5, (4, 2))
        boxes = np.hstack([low, low + rng.uniform(0.1, 0.8, (4, 2))])
        view = box_world(boxes, 5.0, 0.05)
    else:
        discs = room(seed)
        view = disc_world(discs, BOX)
    p = problem_of(view)
    p = p._replace(start_slack=0.0)
    lattice = make_lattice(p, 900)
    nodes = nodes_of(lattice)
    # The nodes cover the box, in its corner beginning, and are about as many as was asked for.
    assert (lattice.low_x, lattice.low_y) == BOX[:2]
    assert np.all(np.array(BOX[2:]) - nodes.max(axis=0) < lattice.step)
    assert 800 < len(nodes) < 1000
    if field:
        # Between cells the field is interpolated: off by half a cell's diagonal at the most.
        clearance, doubt = box_distance(boxes, nodes), 0.036
    else:
        apart = np.hypot(*(nodes[:, None] - discs[:, :2]).transpose(2, 0, 1))
        clearance, doubt = (apart - discs[:, 2]).min(axis=1), 1e-9
    lack = p.safe_m - clearance
    expected = np.where(lack <= 0.0, 1, np.where(lack < 0.5 * lattice.step, _NEARLY, _BLOCKED))
    sure = (np.abs(lack) > doubt) & (np.abs(lack - 0.5 * lattice.step) > doubt)
    np.testing.assert_array_equal(lattice.weight.ravel()[sure], expected[sure])
    assert sure.mean() > 0.7


def random_lattice(seed, shape=(17, 21)):
    """Blobs of blocked nodes in a rim of nearly free ones; the ends' corners are free."""
    rng = np.random.default_rng(seed)
    noise = ndimage.gaussian_filter(rng.normal(size=shape), 1.2)
    weight = np.ones(shape, np.int32)
    weight[noise > 0.2] = _NEARLY
    weight[noise > 0.28] = _BLOCKED
    weight[:2, :2] = weight[-2:, -2:] = 1
    return Lattice(-1.0, 2.0, 0.25, weight)


def plain_distances(lattice, source):
    """SciPy's Dijkstra over the eight neighbours, a step as heavy as the heavier of its ends."""
    weight = lattice.weight
    ny, nx = weight.shape
    index = np.arange(ny * nx).reshape(ny, nx)
    tails, heads, costs = [], [], []
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            if dx == dy == 0:
                continue
            rows, cols = np.mgrid[max(0, -dy) : ny - max(0, dy), max(0, -dx) : nx - max(0, dx)]
            tail, head = index[rows, cols].ravel(), index[rows + dy, cols + dx].ravel()
            size = _DIAGONAL if dx and dy else _STRAIGHT
            tails.append(tail)
            heads.append(head)
            costs.append(size * np.maximum(weight.ravel()[tail], weight.ravel()[head]))
    graph = coo_array(
        (np.concatenate(costs).astype(float), (np.concatenate(tails), np.concatenate(heads))),
        shape=(ny * nx, ny * nx),
    )
    return dijkstra(graph.tocsr(), indices=source)


def two_waves(lattice):
    """Source and target, both waves, and the limit of the first."""
    source, target = 0, lattice.weight.size - 1
    code = _ray_codes(lattice)
    ahead, to_goal, code_ahead, far = _wave(lattice, code, target, source, NOTHING, _FAR - 1)
    behind, from_start, code_behind, _ = _wave(lattice, code, source, target, ahead, far)
    return source, target, ahead, to_goal, code_ahead, behind, from_start, code_behind, far


@given(seed=seeds)
@settings(max_examples=25)
def test_both_waves_are_dijkstras(seed):
    lattice = random_lattice(seed)
    source, target, ahead, to_goal, _, behind, from_start, _, far = two_waves(lattice)
    to_target, to_source = plain_distances(lattice, target), plain_distances(lattice, source)
    shortest = to_target[source]
    assert ahead[source] == shortest
    assert far == int(shortest * _STRETCH) + 10 * _STRAIGHT
    near = to_target <= far
    np.testing.assert_array_equal(ahead[near], to_target[near])
    total = to_target + to_source
    wanted = total <= far
    np.testing.assert_array_equal((ahead + behind)[wanted], total[wanted])
    assert np.all((ahead.astype(float) + behind)[~wanted] > far)
    for distance, parent in ((ahead, to_goal), (behind, from_start)):
        for v in np.flatnonzero(wanted & (parent >= 0)):
            rows, cols = np.divmod([v, parent[v]], lattice.weight.shape[1])
            size = _DIAGONAL if rows[0] != rows[1] and cols[0] != cols[1] else _STRAIGHT
            heavier = lattice.weight.ravel()[[v, parent[v]]].max()
            assert distance[v] - distance[parent[v]] == size * heavier


def windings(chain, other, points):
    """(k,) how often the loop along ``chain`` and back along ``other`` goes round each point."""
    loop = np.vstack([chain, other[::-1], chain[:1]])
    arms = loop[:, None] - points
    a, b = arms[:-1], arms[1:]
    turned = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], (a * b).sum(axis=-1))
    return np.round(turned.sum(axis=0) / (2 * np.pi)).astype(int)


@given(seed=seeds)
@settings(max_examples=25)
def test_a_signature_tells_on_which_side_each_blocked_region_is_passed(seed):
    """Two ways have one signature where the loop that they make goes round no blocked region."""
    lattice = random_lattice(seed)
    source, target, ahead, to_goal, code_ahead, behind, from_start, code_behind, far = two_waves(
        lattice
    )
    nodes = nodes_of(lattice)
    labels, count = ndimage.label(lattice.weight >= _BLOCKED, np.ones((3, 3)))
    # Of each region one node; a way through none of them cannot go round a part of a region.
    of_region = [nodes[np.flatnonzero(labels.ravel() == k + 1)[0]] for k in range(count)]
    start = np.array([*nodes[source], 0.0])
    p = problem_of(disc_world(np.zeros((0, 3)), BOX), start, nodes[target])
    ways, signatures, signature = [], [], code_behind - code_ahead
    for v in np.flatnonzero(ahead.astype(float) + behind <= far):
        chain = np.empty((2 * len(nodes), 2))
        n = _chain(lattice, p, v, from_start, to_goal, chain)
        index = np.round((chain[:n] - nodes[0]) / lattice.step).astype(int)
        if np.all(lattice.weight[index[:, 1], index[:, 0]] < _BLOCKED):
            ways.append(chain[:n].copy())
            signatures.append(signature[v])
    for k in np.random.default_rng(seed).permutation(len(ways))[:40]:
        round_none = not windings(ways[k], ways[0], np.array(of_region).reshape(-1, 2)).any()
        assert (signatures[k] == signatures[0]) == round_none


@given(seed=seeds, most=st.integers(1, 12))
@settings(max_examples=25)
def test_the_shortest_way_of_each_of_the_shortest_signatures(seed, most):
    _, _, ahead, _, code_ahead, behind, _, code_behind, far = two_waves(random_lattice(seed))
    vias = _shortest_classes(ahead, behind, code_ahead, code_behind, far, most)
    total, signature = ahead.astype(np.int64) + behind, code_behind - code_ahead
    best: dict[int, int] = {}
    for v in np.flatnonzero(total <= far):
        best[signature[v]] = min(best.get(signature[v], 2**40), total[v])
    assert [total[v] for v in vias] == sorted(best.values())[:most]
    assert len({signature[v] for v in vias}) == len(vias)


def routes_of(p, most=12, nodes=4000):
    routes, counts, costs = np.zeros((most, 40, 2)), np.zeros(most, np.int32), np.zeros(most)
    n = find_routes(p, nodes, 4, routes, counts, costs, make_stack())
    return [routes[k, : counts[k]] for k in range(n)], costs[:n]


def test_both_ways_round_an_obstacle_are_found_the_shorter_first():
    start, goal = np.array([0.5, 2.5, 0.0]), np.array([4.5, 2.5])
    p = problem_of(disc_world([[2.5, 2.4, 0.4]], BOX), start, goal)
    ways, costs = routes_of(p)
    assert len(ways) == 2 and costs[0] < costs[1]
    above, below = (np.interp(2.5, way[:, 0], way[:, 1]) for way in ways)
    assert above > 2.4 + 0.4 and below < 2.4 - 0.4
    for way in ways:
        assert np.array_equal(way[0], start[:2]) and np.array_equal(way[-1], goal)


@pytest.mark.parametrize("seed", range(6))
def test_routes_are_sorted_safe_and_pass_on_different_sides(seed):
    discs = room(seed)
    ways, costs = routes_of(problem_of(disc_world(discs, BOX)))
    assert np.all(np.diff(costs) >= 0.0)
    safe = [w for w in ways if clear(w, discs)]
    assert len(safe) >= 2
    sides = {tuple(windings(way, safe[0], discs[:, :2])) for way in safe}
    assert len(sides) >= 0.5 * len(safe)  # pulled taut, a route may slip past a lone obstacle


def clear(way, discs, tolerance=1e-3):
    return all(
        (np.hypot(*(a + t * (b - a) - discs[:, :2]).T) - discs[:, 2]).min() >= SAFE - tolerance
        for a, b in pairwise(way)
        for t in np.linspace(0, 1, 60)
    )


def cost_of(way):
    steps = np.diff(way, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    return 0.65 * np.hypot(*steps.T).sum() + 0.35 * np.abs(np.diff(heading)).sum()


def mixture(p, ways, bound=np.inf):
    routes, counts = np.zeros((len(ways), 40, 2)), np.zeros(len(ways), np.int32)
    for k, way in enumerate(ways):
        routes[k, : len(way)], counts[k] = way, len(way)
    out = np.zeros((40, 2))
    return out[: recombine(p, routes, counts, len(ways), bound, out, make_stack())]


# In the last of these rooms the shortest way is not the best: it turns too much.
@pytest.mark.parametrize("seed", [*range(8), 295])
def test_the_mixture_is_the_best_of_all_orders_of_all_waypoints(seed):
    rng = np.random.default_rng(seed)
    discs = room(seed, 7)
    p = problem_of(disc_world(discs, BOX))
    inner = rng.uniform(0.4, 4.6, (5, 2))
    ends = START[:2], GOAL
    ways = [np.vstack([ends[0], inner[:3], ends[1]]), np.vstack([ends[0], inner[3:], ends[1]])]
    orders = [o for size in range(6) for o in permutations(range(5), size)]
    candidates = [np.vstack([ends[0], inner[list(o)].reshape(-1, 2), ends[1]]) for o in orders]
    candidates.sort(key=cost_of)
    best = next((way for way in candidates if clear(way, discs, 1e-6)), None)
    found = mixture(p, ways)
    if best is None:
        assert len(found) == 0
        return
    np.testing.assert_allclose(found, best)
    assert len(mixture(p, ways, cost_of(best) - 1e-6)) == 0
    np.testing.assert_allclose(mixture(p, ways, cost_of(best) + 1e-6), best)


def test_where_a_wall_is_solid_the_longest_way_round_is_taken():
    """A thin wall with its only gap far off: in the plain lattice going through it is cheaper."""
    view = box_world(np.array([[2.4, 0.0, 2.5, 4.3]]), 5.0, 0.05)
    p = problem_of(view, np.array([2.0, 0.5, 0.0]), np.array([3.0, 0.5]))
    weights = [make_lattice(p, 900, solid).weight for solid in (False, True)]
    assert weights[0].max() == _BLOCKED and weights[1].max() > 10 * _BLOCKED
    np.testing.assert_array_equal(weights[0] == _BLOCKED, weights[1] > _BLOCKED)
    routes, counts, costs = np.zeros((8, MAX_POINTS, 2)), np.zeros(8, np.int32), np.zeros(8)
    n = find_routes(p, 900, 4, routes, counts, costs, make_stack(), True)
    clear = [intrusion(p, routes[k], counts[k], np.inf, make_stack()) == 0.0 for k in range(n)]
    assert clear[0] and routes[0, : counts[0], 1].max() > 4.3
