"""The reference walks of the step-by-step planners on the papers' scenes, and how they are stored.

``planners/data/walks.npz`` holds, for each case, at most `KEPT` points of the path, its number of
points, its length and the number of evaluations. It was written by the plain planners, before they
were made faster:

    python tests/helpers/walks.py

Run that only if a planner is meant to walk in another way.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from simloop.benchmarks.planners.paper_scenes import ONLINE_SCENES, online_scene, paper_scene
from simloop.benchmarks.planners.scenes import Instance, disc_world
from simloop.config import PlannerConfig, VehicleConfig
from simloop.planners.protocol import PlanningTask
from simloop.planners.reactive.online import simulate
from simloop.planners.registry import load, make_planner

STORED = Path(__file__).parents[1] / "planners" / "data" / "walks.npz"
KEPT = 100
SEEDS = (1000, 1001, 1002)
POINT = VehicleConfig(footprint_offsets_m=(0.0, 0.0, 0.0))
_GENETIC = ("strip20x60", "abed5", "abed50", "abed150")
_STEPWISE = ("avoa_online", "apso_online", "fuzzy_wdo")
_IN_A_FIELD = ("ga_apf", *_STEPWISE)
# Discs x, y, radius, m.
_ROOM = ((1.0, 1.3, 0.25), (2.2, 1.9, 0.3), (2.6, 3.3, 0.25), (3.6, 2.4, 0.2), (1.2, 2.8, 0.2))
CASES = (
    *(f"ga_apf/{scene}/{seed}" for scene in _GENETIC for seed in SEEDS),
    *(f"{name}/{scene}/{seed}" for name in _STEPWISE for scene in ONLINE_SCENES for seed in SEEDS),
    *(f"{name}/field/{seed}" for name in _IN_A_FIELD for seed in SEEDS),
)


def walk(case: str) -> tuple[np.ndarray, int]:
    """Return the points (n, 2) of a case ``planner/scene/seed`` and its evaluations."""
    name, scene, seed = case.split("/")
    rng = np.random.default_rng(int(seed))
    if name in _STEPWISE and scene in ONLINE_SCENES:
        steering = load(name)(_config(name, 1.0), POINT).steering()
        done = simulate(online_scene(scene), steering, rng)
        return done.points_m, done.evaluations
    one = room_in_a_field() if scene == "field" else paper_scene(scene)
    task = PlanningTask(one.world, one.start, one.goal, one.safe_m)
    plan = make_planner(_config(name, one.safe_m), POINT).plan(task, rng)
    return plan.waypoints_m, plan.evaluations


def _config(name: str, safe_m: float) -> PlannerConfig:
    """Return settings that ask for the shortest path."""
    return PlannerConfig(
        name=name,
        safe_distance_m=safe_m,
        start_turn_weight=0.0,
        length_weight=1.0,
        turning_weight=0.0,
    )


def room_in_a_field() -> Instance:
    """Return a task like those of the closed loop: discs in a room, given by a distance field."""
    cell, bounds = 0.05, np.array([-0.5, -0.5, 5.0, 5.0])
    at = bounds[0] + cell * (0.5 + np.arange(110))
    x, y = np.meshgrid(at, at)
    gaps = [np.hypot(x - cx, y - cy) - r for cx, cy, r in _ROOM]
    distance = np.minimum.reduce([*gaps, x + 0.5, y + 0.5, 5.0 - x, 5.0 - y])
    world = replace(
        disc_world(np.array(_ROOM), tuple(bounds)),
        distance_m=np.maximum(distance, 0.0).astype(np.float32),
        origin_m=bounds[:2].copy(),
        resolution_m=cell,
    )
    return Instance("field", world, np.zeros(3), np.array([3.6, 3.9]), 0.26, np.zeros((0, 4)))


def digest(points: np.ndarray, evaluations: int) -> tuple[np.ndarray, np.ndarray]:
    """Return at most `KEPT` points, evenly chosen, and count, length and evaluations."""
    chosen = np.unique(np.linspace(0, len(points) - 1, KEPT).round().astype(int))
    length = np.hypot(*np.diff(points, axis=0).T).sum()
    return points[chosen], np.array([len(points), length, evaluations])


def main() -> None:
    """Walk every case and store the digests."""
    stored = {}
    for case in CASES:
        points, figures = digest(*walk(case))
        stored[f"{case}/points"], stored[f"{case}/figures"] = points, figures
        print(case, *figures)
    STORED.parent.mkdir(exist_ok=True)
    np.savez_compressed(STORED, **stored)


if __name__ == "__main__":
    main()
