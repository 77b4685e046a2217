"""The papers' tables beside the same algorithms measured here, with the same sizes and stops.

The papers do not print their obstacles. Lengths can agree only as well as a scene is rebuilt, but
the order of the algorithms and their spread can be compared. Each remark is computed from the
measurements or from the printed values.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from simloop.benchmarks.planners.paper_runs import (
    Panel,
    PaperTable,
    Runs,
    min_max_mean_std,
    run_many,
)
from simloop.benchmarks.planners.paper_scenes import online_scene, paper_scene
from simloop.benchmarks.planners.sabiha_tables import sabiha_tables
from simloop.benchmarks.planners.trials import prepare
from simloop.config import PlannerConfig
from simloop.planners.reactive.online import Trajectory, simulate


def wu_tables(runs: int = 30) -> list[PaperTable]:
    """Measure Wu 2016, Table 1: path length alone, with NP = 20, D = 14 and 200 iterations.

    Args:
        runs: Number of plans of each algorithm.

    Returns:
        The table.
    """
    table = PaperTable(
        "Path length",
        "Wu 2016, Table 1: 30 runs, 20 individuals, 14 cross lines, 200 iterations",
        ("algorithm", "min", "max", "mean", "std", "safe %"),
        (
            ("PSO", 219.022, 240.573, 228.434, 8.0535, "-"),
            ("ABC", 190.083, 211.559, 192.654, 7.9538, "-"),
            ("DE", 189.811, 210.876, 191.326, 7.8426, "-"),
            ("TLBO", 187.484, 199.641, 188.043, 5.1192, "-"),
            ("NIWTLBO", 186.988, 190.648, 187.621, 1.6746, "-"),
        ),
    )
    names = {"PSO": "pso", "ABC": "abc", "DE": "de", "TLBO": "tlbo_elitist", "NIWTLBO": "niwtlbo"}
    one, means, stds = paper_scene("wu180"), {}, {}
    for label, name in names.items():
        # An iteration of the TLBO family has two phases, each of which evaluates all individuals.
        twice = 2 if "TLBO" in label else 1
        options: dict[str, bool | int | float | str] = {
            "seeding": "uniform", "coding": "crosslines", "points": 14
        }  # fmt: skip
        if name == "tlbo_elitist":
            options["elites"] = 0
        config = PlannerConfig(
            name=name, safe_distance_m=one.safe_m, start_turn_weight=0.0, learners=20,
            length_weight=1.0, turning_weight=0.0, idle_generations=10_000,
            max_evaluations=20 * (1 + 200 * twice), options=options,
        )  # fmt: skip
        at = run_many("wu180", config, runs)
        table.ours.append((label, *min_max_mean_std(at.length), 100.0 * at.success))
        table.pictures.panels.append(at.panel("wu180", label))
        table.pictures.curves[label] = at.curve()
        means[label], stds[label] = float(at.length.mean()), float(at.length.std())
    order = sorted(means, key=means.__getitem__)
    table.note_least("mean length", means, "NIWTLBO")
    table.note_least("std of length", stds, "NIWTLBO")
    table.note(order[-1] == "PSO", f"Longest mean: {order[-1]} here, PSO in print.")
    table.differs.append(
        "Equal iterations are not equal work: TLBO and NIWTLBO take two evaluations an individual "
        "in each. `simloop bench planners` compares them on equal terms."
    )
    return [table]


def mohamed_tables() -> list[PaperTable]:
    """Measure Mohamed 2012, Tables 1 and 2.

    Returns:
        The two tables.
    """
    return [_mohamed_maps(), _mohamed_against_swarm()]


def _mohamed_maps() -> PaperTable:
    """Measure Mohamed 2012, Table 1: the first path of each map."""
    one = PaperTable(
        "Three maps",
        "Mohamed 2012, Table 1 (the first path of each map)",
        ("map", "runs", "generations max", "min", "s a run", "max error %", "shortest", "safe %"),
        (
            ("50 obstacles", 5, 267, 129, 18.157, 0.6, 30.462, "-"),
            ("150 obstacles", 5, 343, 126, 78.334, 0.233, 93.366557, "-"),
            ("20 x 60", 10, 143, 78, 3.85, 0.08, 61.64, "-"),
        ),
    )
    scenes = (("50 obstacles", "abed50", 5), ("150 obstacles", "abed150", 5))
    for label, scene, runs in (*scenes, ("20 x 60", "strip20x60", 10)):
        at = _plan(scene, "ga_apf", runs)
        one.pictures.panels.append(at.panel(scene, label))
        least, most = float(at.length.min()), float(at.length.max())
        one.ours.append(
            (label, runs, int(at.generations.max()), int(at.generations.min()),
             float(at.seconds.mean()), 100.0 * (most / least - 1.0), least, 100.0 * at.success)
        )  # fmt: skip
        printed = next(float(row[6]) for row in one.printed if row[0] == label)
        one.note(
            abs(least / printed - 1.0) < 0.02,
            f"{label}: shortest {least:.3f} here, {printed:.3f} in print "
            f"({100.0 * (least / printed - 1.0):+.2f} %).",
        )
        error = 100.0 * (most / least - 1.0)
        allowed = next(float(row[5]) for row in one.printed if row[0] == label)
        one.note(
            error < 2.0 * allowed,
            f"{label}: maximum error (Eq. 20) {error:.2f} % here, {allowed:.3g} % in print.",
        )
        one.note(at.success == 1.0, f"{label}: {100.0 * at.success:.0f} % of runs reach the goal.")
    return one


def _mohamed_against_swarm() -> PaperTable:
    """Measure Mohamed 2012, Table 2."""
    two = PaperTable(
        "Against a particle swarm",
        "Mohamed 2012, Table 2: mean length on the 20 x 60 map",
        ("algorithm", "straight line", "mean length"),
        (("improved PSO", 60, 62.503), ("GA and potential field", 60, 61.806)),
    )
    field, swarm = _plan("strip20x60", "ga_apf", 10), _plan("strip20x60", "pso", 10)
    two.pictures.panels = [
        swarm.panel("strip20x60", "PSO"),
        field.panel("strip20x60", "GA and potential field"),
    ]
    two.ours = [
        ("PSO (global best)", 60, float(swarm.length.mean())),
        ("GA and potential field", 60, float(field.length.mean())),
    ]
    two.note(
        bool(field.length.mean() < swarm.length.mean()),
        f"GA and potential field {field.length.mean():.3f}, PSO {swarm.length.mean():.3f}; in "
        "print the former is shorter. The PSO here is the common one, not the quantum variant.",
    )
    return two


def _plan(scene: str, name: str, runs: int) -> Runs:
    """Plan for a point robot; a swarm starts from a uniform population."""
    options: dict[str, bool | int | float | str] = {"seeding": "uniform"} if name == "pso" else {}
    config = PlannerConfig(
        name=name, safe_distance_m=paper_scene(scene).safe_m, start_turn_weight=0.0, options=options
    )
    return run_many(scene, config, runs)


# Map, scene, average length of APSO and AVOA, cm (Table 2).
_ABED = (
    ("MAP 2", "narrow", 34.013775, 33.005484958),
    ("MAP 3", "local_minimum", 59.19549375, 45.087328333),
    ("MAP 4", "trap", 59.19549375, 33.005484958),
    ("MAP 5", "maze", 12.447322917, 12.340264563),
)
# Map -> average length of APSO and AVOA, pixels (Table 2); enhancement rate, % (Table 3).
_ABED_PIXELS = {
    "MAP 2": (1285.56, 1247.4514, 0.284221), "MAP 3": (1784.71, 1704.088, 0.238941),
    "MAP 4": (2237.31, 2226.30095, 0.294113), "MAP 5": (470.45, 466.4037, 1.10651),
}  # fmt: skip


def abed_tables(runs: int = 3) -> list[PaperTable]:
    """Measure Abed 2022, Tables 2 and 3, and the two worlds with movers.

    Args:
        runs: Number of runs of each algorithm in each world.

    Returns:
        The two tables.
    """
    two = PaperTable(
        "Average path length",
        "Abed 2022, Table 2, in cm as printed; here the lengths of the runs in the scenes' units",
        ("map", "APSO", "AVOA", "fuzzy-WDO", "AVOA success %"),
        tuple((label, apso, avoa, "-", "-") for label, _, apso, avoa in _ABED),
    )
    three = PaperTable(
        "Enhancement of AVOA over APSO, %",
        "Abed 2022, Table 3, beside what follows from the pixels in its Table 2",
        ("map", "enhancement %", "from Table 2's pixels %"),
        tuple(
            (label, rate, 100.0 * (1.0 - avoa / apso))
            for label, (apso, avoa, rate) in _ABED_PIXELS.items()
        ),
    )
    scenes = [(label, scene) for label, scene, _, _ in _ABED]
    for label, scene in (*scenes, ("moving obstacles", "moving_obstacles"),
                         ("moving goal", "moving_goal")):  # fmt: skip
        length, success = {}, 1.0
        for name in ("apso_online", "avoa_online", "fuzzy_wdo"):
            done = [_run_online(scene, name, seed) for seed in range(runs)]
            length[name] = float(np.mean([run.length_m for run in done]))
            if name == "avoa_online":
                success = float(np.mean([run.success for run in done]))
            two.pictures.panels.append(
                Panel(
                    scene,
                    f"{label}: {name}",
                    [run.points_m for run in done[:1]],
                    [run.success for run in done[:1]],
                )
            )
        two.ours.append((label, *length.values(), 100.0 * success))
        gain = 100.0 * (1.0 - length["avoa_online"] / length["apso_online"])
        three.ours.append((label, gain, "-"))
        if (label, scene) in scenes:
            three.note(gain > 0.0, f"{label}: AVOA against APSO {gain:+.2f} % here.")
    two.pictures.note = (
        "Paths of the first seed. The star of the moving goal is its first place. Map 1, on which "
        "the paper compares with fuzzy-WDO, is not rebuilt."
    )
    two.differs.append(
        "If a unit is a centimetre, the printed lengths of maps 2 to 4 (33 to 59 cm) are shorter "
        "than the straight line between their ends, (0, 0) to (45, 45): 63.6. The figures of APSO "
        "on maps 3 and 4 repeat that of fuzzy-WDO on map 1."
    )
    three.differs.append(
        "The printed rates do not follow from the printed lengths; see the last column."
    )
    return [two, three]


def _run_online(scene: str, name: str, seed: int) -> Trajectory:
    """Simulate a run in a world known only by sensing."""
    steering = prepare(PlannerConfig(name=name)).steering()  # type: ignore[attr-defined]
    return simulate(online_scene(scene), steering, np.random.default_rng(seed))


TABLES: tuple[Callable[[], list[PaperTable]], ...] = (
    sabiha_tables,
    wu_tables,
    mohamed_tables,
    abed_tables,
)
"""Functions that measure the tables, one for each paper."""
