"""Scenes by name or from a file, each with its best known J."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from simloop.benchmarks.planners.judge import judge, optimum
from simloop.benchmarks.planners.map_files import files_read, is_map_file, load_file
from simloop.benchmarks.planners.paper_scenes import (
    ONLINE_SCENES,
    PAPER_SCENES,
    online_scene,
    paper_scene,
)
from simloop.benchmarks.planners.scenes import SCENE_NAMES, Instance, scene
from simloop.benchmarks.planners.trials import Trial, moving_instance, plan_once, prepare
from simloop.common.errors import InputError, did_you_mean
from simloop.config import PlannerConfig
from simloop.planners.reference.reference import kind_of


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """An instance of a scene.

    Attributes:
        scene: Name of the scene, or of the file.
        instance: The planning task.
        best: J* or the best known J; None if unknown.
        exact: Whether ``best`` is the optimum.
    """

    scene: str
    instance: Instance
    best: float | None
    exact: bool


def scene_names() -> tuple[str, ...]:
    """List the names of the built-in scenes.

    Returns:
        Names that `load_scene` accepts, besides map files.
    """
    return (*SCENE_NAMES, *paper_scene_names())


def paper_scene_names() -> tuple[str, ...]:
    """List the names of the papers' scenes.

    Returns:
        Fixed scenes first, then those with motion.
    """
    moving = [name for name in ONLINE_SCENES if name not in PAPER_SCENES]
    return (*PAPER_SCENES, *moving)


def check_scene(name: str) -> None:
    """Check that `load_scene` knows a scene.

    Args:
        name: Name of a scene, or a map file.

    Raises:
        InputError: The name is unknown; the message lists the choices.
    """
    if not is_map_file(name) and name not in scene_names():
        choices = did_you_mean(name, scene_names())
        raise InputError(f"--scenes {name}: unknown{choices}, or a .map, .scen or image file")


def scene_files(names: Iterable[str]) -> list[Path]:
    """List the files that `load_scene` reads for some scenes.

    Args:
        names: Names of scenes, or map files.

    Returns:
        The files; none for a built-in scene.

    Raises:
        InputError: A scenario file cannot be read, or the map that it names is missing.
    """
    return [file for name in names if is_map_file(name) for file in files_read(Path(name))]


def load_scene(name: str) -> list[Task]:
    """Load the tasks of a scene or of a map file.

    Args:
        name: Name of a scene, or a map file.

    Returns:
        The tasks, with J* where it can be computed.

    Raises:
        InputError: The name is unknown, or the file cannot be read.
    """
    check_scene(name)
    if is_map_file(name):
        found = load_file(Path(name))
        return [Task(Path(name).name, one, None, exact=False) for one in found]
    if name in PAPER_SCENES:
        return [_known(Task(name, paper_scene(name), None, exact=False))]
    if name in ONLINE_SCENES:
        return [Task(name, moving_instance(online_scene(name)), None, exact=False)]
    instances = scene(name)
    return [_known(Task(name, one, None, exact=False)) for one in instances]


def _known(task: Task) -> Task:
    """Return the task with its best known J.

    Among discs it is the exact optimum, among polygons the J of a fine visibility graph. In a
    distance field it is known only if it is stored.
    """
    one = task.instance
    if one.best_cost is not None:
        return replace(task, best=one.best_cost, exact=True)
    kind = kind_of(one.world)
    if kind == "discs":
        try:
            return replace(task, best=optimum(one), exact=True)
        except ValueError:
            return task
    if kind == "polygons":
        config = PlannerConfig(name="visibility", safe_distance_m=one.safe_m, start_turn_weight=0.0)
        verdict = judge(one, plan_once(prepare(config), one, 0).waypoints_m)
        if verdict.success:
            return replace(task, best=verdict.cost)
    return task


def with_best_known(tasks: list[Task], trials: list[Trial]) -> list[Task]:
    """Use the best safe plan of all trials if the optimum is unknown.

    Args:
        tasks: Tasks of a scene.
        trials: Trials of all planners on them.

    Returns:
        The tasks, in the same order.
    """
    found: dict[str, float] = {}
    for trial in trials:
        if trial.verdict.success:
            cost = min(found.get(trial.instance, trial.verdict.cost), trial.verdict.cost)
            found[trial.instance] = cost
    out = []
    for task in tasks:
        best = found.get(task.instance.name)
        if not task.exact and best is not None and (task.best is None or best < task.best):
            task = replace(task, best=best)
        out.append(task)
    return out
