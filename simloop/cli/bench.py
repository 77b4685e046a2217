"""The commands ``simloop bench ...``: measurements.

Each command imports what it needs when it runs, so that ``simloop --help`` is quick.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from simloop.cli.apart import Redo, Repair, check_apart, check_redo, files_in, outputs_of
from simloop.cli.bench_logs import bench_logs
from simloop.cli.common import (
    INTERRUPTED,
    JsonFile,
    NumberOfWorkers,
    Overrides,
    check_json,
    compiling_shown,
    write_json,
)
from simloop.cli.stopping import leaves_at_once, stopping
from simloop.cli.world import build_shown

if TYPE_CHECKING:
    from simloop.cli.runs import How

Scenes = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="Scenes, or .map, .scen and image files; repeatable or with commas. Default: all.",
    ),
]
Planners = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME", help="Planners; repeatable or with commas. Default: all."),
]
Budget = Annotated[
    int | None,
    typer.Option(min=1, max=10**7, help="Evaluations of the objective that a plan may use."),
]
Plans = Annotated[
    int | None,
    typer.Option(min=1, max=10**5, help="The least number of plans of each planner on each scene."),
]
Report = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Write an HTML page with charts into this directory."),
]
Out = Annotated[
    Path, typer.Option(metavar="DIR", help="Directory of the finished runs, to continue from.")
]
Only = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="Papers, worlds and planners; repeatable or with commas. Default: all.",
    ),
]
Dask = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Run on the Dask cluster with this scheduler instead."),
]

bench_app = typer.Typer(
    help="Measure speed, planners, reactions to faults, and the mapper.", no_args_is_help=True
)


@bench_app.command("loop")
@leaves_at_once
def bench_loop(
    json_file: JsonFile = None,
    scenario: Annotated[
        str, typer.Option(help="A scenario's name, or a TOML file.")
    ] = "experiment",
    repeats: Annotated[int, typer.Option(min=1, help="Measure this often and take the best.")] = 3,
    overrides: Overrides = None,
) -> int:
    """Measure the speed of the closed loop.

    The figures are the real-time factor, with and without a recording, the ratio to the physics
    alone, and the time of each stage.
    \f

    Args:
        json_file: File for the figures as JSON.
        scenario: The scenario to run.
        repeats: Number of runs; the best counts.
        overrides: ``key=value`` for keys of the scenario.

    Returns:
        The exit code.
    """
    from simloop.scenario.inputs import input_files
    from simloop.scenario.load import load, resolve

    wanted = load(scenario, overrides or ())
    check_json(json_file)
    check_apart({"--json": json_file}, input_files(wanted, resolve(scenario)))
    from simloop.benchmarks import loop_speed as bench_loop

    notes = Console(stderr=True)
    world = build_shown(wanted, notes)
    with compiling_shown(notes) as report:
        figures = bench_loop.run(wanted, repeats, report, world)
    bench_loop.print_figures(Console(), figures)
    write_json(json_file, figures)
    return 0


@bench_app.command("planners")
@leaves_at_once
def bench_planners(
    json_file: JsonFile = None,
    scenes: Scenes = None,
    planners: Planners = None,
    budget: Budget = None,
    seeds: Plans = None,
    workers: NumberOfWorkers = 0,
    report: Report = None,
) -> int:
    """Compare planners on the same tasks.

    The figures are the planning time, the gap to the optimum, the share of safe paths, and the
    significance of the differences. Ctrl-C keeps the measurements made so far.
    \f

    Args:
        json_file: File for the figures as JSON.
        scenes: The scenes, by name, or map files.
        planners: The planners' names.
        budget: Number of evaluations of the objective that each plan may use.
        seeds: The least number of plans of each planner on each scene.
        workers: The number of processes. 0: the number of cores.
        report: The directory of the HTML page.

    Returns:
        The exit code.
    """
    check_json(json_file)
    from simloop.benchmarks.planners import bench, tasks

    request = bench.Request(
        scenes=bench.names(scenes),
        planners=bench.names(planners),
        budget=bench.BUDGET if budget is None else budget,
        seeds=seeds,
        workers=workers,
        history=report is not None,
    )
    request.check()
    page_file = None if report is None else report / "index.html"
    outputs = {"--json": json_file, "--report": page_file}
    check_apart(outputs, tasks.scene_files(request.scenes))
    if report is not None:
        from simloop.benchmarks.planners import page

        page.check(report)
    with stopping("stopping: what is measured so far is kept; once more to end at once") as stop:
        result = bench.run(request, stop=stop)
    figures = bench.figures(result)
    bench.print_figures(Console(), figures)
    write_json(json_file, figures)
    if report is not None and not result.interrupted:
        page.write(report, result, figures)
    return INTERRUPTED if result.interrupted else 0


@bench_app.command("papers")
@leaves_at_once
def bench_papers(
    json_file: JsonFile = None,
    report: Report = None,
    out: Out = Path("runs/papers"),
    seeds: Annotated[str, typer.Option(metavar="A:B", help="The seeds from A to B-1.")] = "0:20",
    only: Only = None,
    workers: NumberOfWorkers = 0,
    dask: Dask = None,
    tables: Annotated[bool, typer.Option(help="Measure the papers' tables too.")] = True,
    redo: Redo = None,
    repair: Repair = False,
) -> int:
    """Drive with every planner, and with each paper's method in its own worlds.

    If the benchmark is stopped or killed, give the same command again: it continues where it
    stopped. The papers' tables are measured after the drives.
    \f

    Args:
        json_file: File for the figures as JSON.
        report: The directory of the HTML page.
        out: The directory of the finished runs.
        seeds: The range of the seeds.
        only: Names of papers, worlds and planners.
        workers: The number of processes. 0: the number of cores.
        dask: The address of a Dask scheduler whose workers are used instead.
        tables: Whether the papers' tables are measured.
        redo: ``errors`` to repeat the runs that ended with the outcome error.
        repair: Whether damaged files in ``out`` are repaired.

    Returns:
        The exit code.
    """
    check_json(json_file)
    check_redo(redo)
    from simloop.benchmarks.papers import tables as paper_tables
    from simloop.common.files import check_directory

    check_directory(out, "--out")
    kept = {f"{one.name} of --out": one for one in paper_tables.files(out).values()}
    page_file = None if report is None else report / "index.html"
    check_apart({**outputs_of(out), **kept, "--json": json_file, "--report": page_file}, ())
    check_apart({"--json": json_file}, files_in(out))
    from simloop.cli.runs import How
    from simloop.common.pool import processes

    how = How(processes(workers), dask, redo is not None, repair)
    return _bench_papers(json_file, report, out, seeds, only, how, tables)


def _bench_papers(
    json_file: Path | None,
    report: Path | None,
    out: Path,
    seeds: str,
    only: list[str] | None,
    how: How,
    tables: bool,
) -> int:
    from simloop.benchmarks.papers import entries, figures, page, print_figures
    from simloop.benchmarks.planners import bench
    from simloop.campaign.sweeps import parse_seeds
    from simloop.cli.papers import do_papers

    installed = bench.available_planners()
    table = entries.default_entries()
    missing = [name for name in dict.fromkeys(e.planner for e in table) if name not in installed]
    request = entries.Drives(
        entries.with_libraries(table, installed), parse_seeds(seeds), bench.names(only)
    )
    request.check()
    if report is not None:
        page.check(report)
    rows, measured = do_papers(request, out, how, tables)
    found = figures.figures_of(request, rows, measured, missing)
    print_figures.print_figures(Console(), found)
    write_json(json_file, found)
    if found["interrupted"]:
        print(
            f"interrupted: {found['runs_finished']} of {found['runs']} runs are finished and kept; "
            "give the same command again to continue"
        )
        sys.exit(INTERRUPTED)  # the line above replaces the general message
    if report is not None:
        page.write(report, request, rows, found)
    return 0


@bench_app.command("weights")
@leaves_at_once
def bench_weights(
    json_file: JsonFile = None,
    scene: Annotated[str, typer.Option(help="A scene of bench planners.")] = "S1",
    planner: Annotated[str, typer.Option(help="A planner.")] = "tlbo",
    count: Annotated[
        int, typer.Option(min=14, max=10_000, help="The number of weight pairs.")
    ] = 38,
) -> int:
    """Study the weights of path length and turning.

    The study is that of the lead paper: the Pareto front of length and turning, and a regression
    by partial least squares with its R2 and Q2.
    \f

    Args:
        json_file: File for the figures as JSON.
        scene: The scene.
        planner: The planner.
        count: Number of pairs of weights.

    Returns:
        The exit code.
    """
    check_json(json_file)
    from simloop.benchmarks.planners import bench, tasks, weights
    from simloop.common.terminal import print_table

    bench.Request(scenes=(scene,), planners=(planner,)).check()
    check_apart({"--json": json_file}, tasks.scene_files([scene]))
    done = weights.study(tasks.load_scene(scene)[0].instance, planner, count)
    header = ["", "measured", ""]
    print_table(Console(), f"{count} weights, {planner} on {scene}", header, weights.rows(done))
    write_json(json_file, weights.figures(done))
    return 0


@bench_app.command("faults")
@leaves_at_once
def bench_faults(
    json_file: JsonFile = None,
    seeds: Annotated[int, typer.Option(min=1, help="The number of runs with each fault.")] = 20,
) -> int:
    """Test how the robot reacts to faults.

    Exit code 0: the robot handled every fault in every run. 1: it did not.
    \f

    Args:
        json_file: File for the figures as JSON.
        seeds: The number of runs with each fault.

    Returns:
        The exit code.
    """
    check_json(json_file)
    from simloop.benchmarks import faults as bench_faults
    from simloop.common.terminal import checking

    trials = []
    with checking(Console(stderr=True)) as report:
        for trial in bench_faults.run(seeds, report):
            trials.append(trial)
    figures = bench_faults.figures(trials)
    bench_faults.print_figures(Console(), figures)
    write_json(json_file, figures)
    return 0 if figures["ok"] else 1


bench_app.command("logs")(bench_logs)


@bench_app.command("slam")
@leaves_at_once
def bench_slam(
    json_file: JsonFile = None,
    course: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="A course; repeatable. Default: all courses."),
    ] = None,
    seed: Annotated[
        list[int] | None,
        typer.Option(min=0, help="A seed of the course and the sensors; repeatable."),
    ] = None,
    seeds: Annotated[
        int, typer.Option(min=1, help="Without --seed: use the seeds 0 to this number - 1.")
    ] = 1,
) -> int:
    """Measure the mapper on simulated courses.

    The figures are the errors of the trajectory and of the map against the truth, and the speed.
    \f

    Args:
        json_file: File for the figures as JSON.
        course: The courses' names.
        seed: The seeds.
        seeds: Number of seeds if ``seed`` is not given.

    Returns:
        The exit code.
    """
    from simloop.benchmarks import slam as bench_slam
    from simloop.common.terminal import checking

    check_json(json_file)
    notes = Console(stderr=True)
    with compiling_shown(notes) as report, checking(notes) as said:
        figures = bench_slam.run(course or (), seed or range(seeds), said, report)
    bench_slam.print_figures(Console(), figures)
    write_json(json_file, figures)
    return 0
