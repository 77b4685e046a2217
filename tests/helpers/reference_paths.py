"""The reference planners' paths on fixed tasks, and how they are stored.

``planners/data/reference_paths.npz`` was written by the plain planners, before they were made
faster:

    python tests/helpers/reference_paths.py

Run that only if a planner is meant to find another path. A path among polygons or discs may have
hundreds of points on its arcs, of which at most `KEPT` are stored.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from helpers.population_paths import rounding
from helpers.walks import room_in_a_field
from simloop.benchmarks.planners.paper_scenes import paper_scene
from simloop.benchmarks.planners.scenes import Instance, scene
from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import Plan
from simloop.planners.protocol import PlanningTask
from simloop.planners.registry import info, make_planner

STORED = Path(__file__).parents[1] / "planners" / "data" / "reference_paths.npz"
KEPT = 100
SEEDS = (0, 1)
EVALUATIONS = {
    "exact": 100,
    "visibility": 100,
    "cma": 4000,
    "informed_rrt_star": 1000,
    "bit_star": 1000,
}
"""Planner -> its budget. The first two search without one."""
LIBRARIES = {"cma": "cma", "informed_rrt_star": "ompl", "bit_star": "ompl"}
"""Planner -> the library that it needs."""
_POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))


def instances() -> Iterator[tuple[Instance, VehicleConfig]]:
    """List the tasks: for a point and for the vehicle, in every kind of world.

    Yields:
        A task, and the robot that it is planned for.
    """
    for name in ("S1", "S2", "S3", "S4a"):
        yield scene(name)[0], _POINT
    for name in ("abed50", "wu180", "trap"):
        yield paper_scene(name), _POINT
    one = scene("S1")[0]
    # The robot starts too close to an obstacle.
    yield replace(one, name="S1-robot", start=np.array([2.75, 0.3, 0.5])), VehicleConfig()
    yield replace(room_in_a_field(), name="room-robot"), VehicleConfig()
    one = scene("S2")[1]
    yield replace(one, name="S2-robot"), VehicleConfig()


def plan_all(name: str, seed: int) -> Iterator[tuple[str, Plan]]:
    """Plan every task with a planner; the tasks for the vehicle have a turn at the start.

    Args:
        name: Name of the planner.
        seed: Seed of each plan.

    Yields:
        A key, and the plan.
    """
    for one, vehicle in instances():
        config = PlannerConfig(
            name=name,
            safe_distance_m=one.safe_m,
            start_turn_weight=0.0 if vehicle is _POINT else 0.1,
            max_evaluations=EVALUATIONS[name],
            precise=True,
        )
        task = PlanningTask(one.world, one.start, one.goal, one.safe_m)
        plan = make_planner(config, vehicle).plan(task, np.random.default_rng(seed))
        yield f"{name}/{one.name}/{seed}", plan


def seeds_of(name: str) -> tuple[int, ...]:
    """Return the seeds of a planner: one if it draws nothing."""
    return SEEDS if info(name).stochastic else SEEDS[:1]


def kept(path: np.ndarray) -> np.ndarray:
    """Return at most `KEPT` points (n, 2) of a path, the first and the last among them."""
    if len(path) <= KEPT:
        return path
    return path[np.linspace(0, len(path) - 1, KEPT).round().astype(int)]


def load_paths(name: str) -> dict[str, tuple[np.ndarray, tuple[int, int]]]:
    """Read the stored paths of a planner.

    Returns:
        Key of `plan_all` -> stored points (m, 2), and the number of the path's points and of its
        evaluations; empty if this machine rounds differently from the one that stored them, or has
        another version of the planner's library.
    """
    with np.load(STORED) as stored:
        if not np.array_equal(stored["rounding"], rounding()):
            return {}
        library = LIBRARIES.get(name)
        if library is not None and str(stored[library]) != version(library):
            return {}
        paths = np.split(stored["points"], np.cumsum(stored["stored"])[:-1])
        cases = zip(stored["keys"], paths, stored["counts"].tolist(), strict=True)
        found = {key.decode(): (path, tuple(counts)) for key, path, counts in cases}
    return {key: value for key, value in found.items() if key.startswith(f"{name}/")}


def store() -> None:
    """Plan every task with every planner and write the file."""
    keys, paths, counts = [], [], []
    for name in EVALUATIONS:
        for seed in seeds_of(name):
            for key, plan in plan_all(name, seed):
                keys.append(key.encode())
                paths.append(kept(plan.waypoints_m))
                counts.append((len(plan.waypoints_m), plan.evaluations))
    np.savez_compressed(
        STORED,
        rounding=rounding(),
        keys=np.array(keys),
        points=np.concatenate(paths),
        stored=np.array([len(path) for path in paths]),
        counts=np.array(counts),
        **{library: version(library) for library in set(LIBRARIES.values())},
    )


if __name__ == "__main__":
    store()
