"""The commands that measure: ``simloop bench ...`` and ``simloop replay``.

What is slow to import is imported by the command that needs it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from simloop.cli.common import (
    INTERRUPTED,
    JsonFile,
    Overrides,
    check_json,
    compiling_shown,
    stop_asked,
    write_json,
)

bench_app = typer.Typer(help="Measure speed and planners.", no_args_is_help=True)


@bench_app.command("loop")
def bench_loop(
    json_file: JsonFile = None,
    scenario: Annotated[str, typer.Option(help="A scenario's name or file.")] = "experiment",
    repeats: Annotated[int, typer.Option(min=1, help="The best of this many is taken.")] = 3,
    overrides: Overrides = None,
) -> int:
    """Speed of the closed loop: to the clock, to the plant alone, and stage by stage."""
    from simloop.scenario.load import load

    wanted = load(scenario, overrides or ())
    check_json(json_file)
    from simloop.benchmarks import loop_speed as bench_loop

    with compiling_shown(Console(stderr=True)) as report:
        figures = bench_loop.run(wanted, repeats, report)
    bench_loop.print_figures(Console(), figures)
    write_json(json_file, figures)
    return 0


@bench_app.command("planners")
def bench_planners(
    json_file: JsonFile = None,
    scenes: Annotated[
        list[str] | None, typer.Option(help="Names, or .map, .scen and image files; default: all.")
    ] = None,
    planners: Annotated[list[str] | None, typer.Option(help="Names; default: all.")] = None,
    budget: Annotated[
        int | None, typer.Option(min=1, max=10**7, help="Evaluations that each plan may spend.")
    ] = None,
    seeds: Annotated[
        int | None, typer.Option(min=1, max=10**5, help="Plans a scene and planner, at least.")
    ] = None,
    workers: Annotated[int, typer.Option(min=0, max=256, help="Processes; 0: one a core.")] = 0,
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write a page with pictures.")
    ] = None,
) -> int:
    """Planners on equal terms, beside the optimum: time, gap, safety, significance."""
    check_json(json_file)
    from simloop.benchmarks.planners import bench

    request = bench.Request(
        scenes=bench.names(scenes),
        planners=bench.names(planners),
        budget=bench.BUDGET if budget is None else budget,
        seeds=seeds,
        workers=workers,
        history=report is not None,
    )
    request.check()
    if report is not None:
        from simloop.benchmarks.planners import page

        page.check(report)
    result = bench.run(request)
    figures = bench.figures(result)
    bench.print_figures(Console(), figures)
    write_json(json_file, figures)
    if report is not None and not result.interrupted:
        page.write(report, result, figures)
    return INTERRUPTED if result.interrupted else 0


@bench_app.command("weights")
def bench_weights(
    json_file: JsonFile = None,
    scene: Annotated[str, typer.Option(help="A scene of the planners' benchmark.")] = "S1",
    planner: Annotated[str, typer.Option(help="A planner's name.")] = "tlbo",
    count: Annotated[int, typer.Option(min=14, max=10_000, help="Pairs of weights.")] = 38,
) -> int:
    """The lead paper's weight study: Pareto front of length and turning, PLS with R2 and Q2."""
    check_json(json_file)
    from simloop.benchmarks.planners import bench, tasks, weights
    from simloop.common.terminal import print_table

    bench.Request(scenes=(scene,), planners=(planner,)).check()
    done = weights.study(tasks.load_scene(scene)[0].instance, planner, count)
    header = ["", "measured", ""]
    print_table(Console(), f"{count} weights, {planner} on {scene}", header, weights.rows(done))
    write_json(json_file, weights.figures(done))
    return 0


@bench_app.command("faults")
def bench_faults(
    json_file: JsonFile = None,
    seeds: Annotated[int, typer.Option(min=1, help="Runs of each fault.")] = 20,
) -> int:
    """Faults on purpose: exit code 0 if the robot handled every one, 1 if not."""
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


@bench_app.command("slam")
def bench_slam(
    json_file: JsonFile = None,
    course: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="This course alone (repeatable).")
    ] = None,
    seed: Annotated[
        list[int] | None, typer.Option(min=0, help="The seed of course and sensors (repeatable).")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="So many seeds, from 0 on.")] = 1,
) -> int:
    """The mapper on simulated courses: errors against the truth, map, speed."""
    from simloop.benchmarks import slam as bench_slam
    from simloop.common.terminal import checking

    check_json(json_file)
    notes = Console(stderr=True)
    with compiling_shown(notes) as report, checking(notes) as said:
        figures = bench_slam.run(course or (), seed or range(seeds), said, report)
    bench_slam.print_figures(Console(), figures)
    write_json(json_file, figures)
    return 0


def replay(
    log: Annotated[Path, typer.Argument(help="A CARMEN .log or .clf, or an .npz of scans.")],
    json_file: Annotated[
        Path | None,
        typer.Option("--json", metavar="FILE", help="Write the figures as JSON; -: to stdout."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Map, trajectory (TUM) and recording.")
    ] = None,
    relations: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Relative relations to measure the trajectory by."),
    ] = None,
    prior: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE.yaml", help="Find the robot in this map; make none."),
    ] = None,
) -> int:
    """Matcher and mapper on a recorded log of a real robot."""
    from simloop.common.terminal import counting
    from simloop.graph_slam.settings import MappingConfig
    from simloop.mapping.map_files import load_map
    from simloop.replay import outputs, session

    files = outputs.ReplayFiles(out, json_file)
    files.check(log, relations, prior, prior and prior.with_suffix(".pgm"))
    read, truth = session.load(log, relations)
    config = MappingConfig()
    known = load_map(prior, config.grid) if prior is not None else None
    notes, bar = Console(stderr=True), counting(Console(stderr=True), "scans", len(read.t_s))
    with stop_asked() as stop, compiling_shown(notes) as report, bar as show:
        replayed = session.run(
            read, truth, config, known, lambda done: show(done) or not stop(), report
        )
        outputs.write(replayed, files)
    if json_file == outputs.STDOUT:
        print(json.dumps(replayed.figures, indent=2))
    else:
        outputs.print_figures(Console(), replayed.figures)
        write_json(json_file, replayed.figures)
    return INTERRUPTED if replayed.figures["interrupted"] else 0
