"""Tasks on which the paths of the population planners are held, and those paths in one file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from simloop.benchmarks.planners.paper_scenes import PAPER_SCENES, paper_scene
from simloop.benchmarks.planners.scenes import Instance, scene
from simloop.config import PlannerConfig, VehicleConfig
from simloop.messages import Plan
from simloop.planners import registry
from simloop.planners.protocol import PlanningTask
from simloop.planners.registry import make_planner

PATHS = Path(__file__).parents[1] / "planners" / "data" / "paths.npz"
SEEDS = (0, 1, 2)
RULES = tuple(n for n in registry.available() if registry.info(n).update_rule)
LED = (*RULES, "tlbo")
_POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))


def instances() -> Iterator[tuple[Instance, VehicleConfig]]:
    """List the tasks: the papers' scenes and S1 to S4 for a point, S1 and S4 for the vehicle.

    Yields:
        A task, and the robot that it is planned for. In the last one the robot starts too close
        to a wall.
    """
    for name in PAPER_SCENES:
        yield paper_scene(name), _POINT
    for name, count in (("S1", 1), ("S2", 2), ("S3", 2), ("S4a", 1), ("S4b", 1)):
        for one in scene(name)[:count]:
            yield one, _POINT
    for name, x in (("S1", 2.0), ("S4a", 1.0), ("S4b", 4.6)):
        one = scene(name)[0]
        start = np.array([x, *one.start[1:]])
        yield (
            Instance(f"{name}-robot", one.world, start, one.goal, one.safe_m, one.boxes_m),
            VehicleConfig(),
        )


def plan_all(name: str, seed: int) -> Iterator[tuple[str, Plan]]:
    """Plan every task with a planner; the tasks for the vehicle have a turn at the start.

    Args:
        name: Name of the planner.
        seed: Seed of each plan.

    Yields:
        A key, and the plan.
    """
    for one, vehicle in instances():
        weight = 0.0 if vehicle is _POINT else 0.1
        config = PlannerConfig(name=name, safe_distance_m=one.safe_m, start_turn_weight=weight)
        task = PlanningTask(one.world, one.start, one.goal, one.safe_m)
        plan = make_planner(config, vehicle).plan(task, np.random.default_rng(seed))
        yield f"{name}/{one.name}/{seed}", plan


def rounding() -> np.ndarray:
    """Compute values whose last bits depend on the machine's mathematical functions.

    A search follows another course after a single differing bit, so stored paths can only be
    compared where these values are the same.

    Returns:
        (n,) values.
    """
    x = np.linspace(0.01, 3.0, 400).tolist()
    functions = (math.sin, math.cos, math.exp, math.log, lambda v: v**0.31, lambda v: v**2.7)
    values = [f(v) for f in functions for v in x]
    values += [g(v, 1.7 - v) for g in (math.hypot, math.atan2) for v in x]
    return np.array(values)


def rounds_as_stored() -> bool:
    """Tell whether this machine rounds like the one that stored paths and walks.

    Returns:
        Whether `rounding` gives the stored values.
    """
    with np.load(PATHS) as stored:
        return bool(np.array_equal(stored["rounding"], rounding()))


def load_paths() -> dict[str, tuple[np.ndarray, int, int]]:
    """Read the stored paths.

    Returns:
        Key of `plan_all` -> waypoints (m, 2), evaluations, generations; empty if this machine
        rounds differently from the one that stored them.
    """
    if not rounds_as_stored():
        return {}
    with np.load(PATHS) as stored:
        ends = np.cumsum(stored["counts"])[:-1]
        paths = np.split(stored["points"], ends)
        effort = stored["effort"].tolist()
        keys = [key.decode() for key in stored["keys"]]
    return {k: (path, *spent) for k, path, spent in zip(keys, paths, effort, strict=True)}
