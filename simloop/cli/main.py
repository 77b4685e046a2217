"""The command line ``simloop`` and its commands run, list and certify.

Exit codes: 0 goal reached (or all is well), 1 the robot failed, 2 wrong input, 70 a fault of the
program, 130 stopped by Ctrl-C. Each command imports what it needs when it runs, so that
``simloop --help`` is quick.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from simloop import __version__
from simloop.cli.bench import bench_app
from simloop.cli.campaign import campaign
from simloop.cli.common import (
    JsonFile,
    Overrides,
    check_json,
    compiling_shown,
    stop_asked,
    write_json,
)
from simloop.cli.edge import INTERRUPTED, run_at_edge
from simloop.cli.replay import replay
from simloop.common.errors import InputError, printable

if TYPE_CHECKING:
    from simloop.evaluation.referee import Outcome
    from simloop.loop import RunResult, Simulation
    from simloop.recording.outputs import Outputs
    from simloop.recording.watch import Watch
    from simloop.scenario.build import World
    from simloop.scenario.scenario import Scenario

RunScenario = Annotated[str, typer.Argument(help="A scenario's name, or a TOML file.")]
RunSeed = Annotated[
    int | None, typer.Option(help="Seed of all random numbers. Default: the scenario's.")
]
RunPlanner = Annotated[
    str | None, typer.Option(metavar="NAME", help="A planner. Default: the scenario's.")
]
Recording = Annotated[
    Path | None, typer.Option(metavar="FILE.rrd", help="Record the run for the viewer rerun.")
]
Snapshots = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Draw pictures of the run and a contact sheet.")
]
Everything = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Record, draw and write all figures into one directory."),
]
ModelPath = Annotated[
    list[Path] | None,
    typer.Option(
        "--model-path",
        metavar="DIR",
        help="Folder of the models that a Gazebo world includes; repeatable.",
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]

app = typer.Typer(
    name="simloop",
    help="Simulates a tracked robot that drives to a goal across an unknown room, in MuJoCo.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.add_typer(bench_app, name="bench")
app.command("replay")(replay)
app.command("campaign")(campaign)


def main() -> None:
    """Run the command line. Wrong input ends it with one line on stderr and exit code 2."""
    run_at_edge(app)


def run_command(command: Callable[..., int]) -> None:
    """Run a function as the only command of a script, with the same exit codes and error lines.

    Args:
        command: A function with typer's annotations, which returns an exit code.
    """
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    alone.command()(command)
    run_at_edge(alone)


@app.callback(invoke_without_command=True)
def _about(
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
    debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of a fault of the program.")
    ] = False,  # taken from the arguments by ``run_at_edge``; here for the help text only
) -> None:
    if version:
        print(f"simloop {__version__}")
        raise typer.Exit


@app.command("list")
def list_choices() -> int:
    """List the scenarios, planners and arenas.
    \f

    Returns:
        The exit code.
    """
    from simloop.common.terminal import print_table
    from simloop.planners import registry
    from simloop.scenario import catalog

    console = Console()
    facts = {name: catalog.scenario_facts(path) for name, path in catalog.scenario_files().items()}
    rows = [[name, fact["title"], fact["description"]] for name, fact in facts.items()]
    print_table(console, "scenarios", ["name", "title", "description"], rows)
    about = [[name, registry.info(name).summary] for name in catalog.planner_names()]
    print_table(console, "planners", ["name", "description"], about)
    print_table(console, "arenas", ["name"], [[name] for name in catalog.arena_files()])
    return 0


@app.command("run")
def run_scenario(
    scenario: RunScenario,
    seed: RunSeed = None,
    planner: RunPlanner = None,
    record: Recording = None,
    snapshots: Snapshots = None,
    json_file: JsonFile = None,
    out: Everything = None,
    overrides: Overrides = None,
    model_path: ModelPath = None,
    quiet: Quiet = False,
) -> int:
    """Run a scenario.

    Exit code 0: the robot reached the goal. 1: it failed. 2: wrong input. 130: stopped by Ctrl-C.
    \f

    Args:
        scenario: A scenario's name, or a TOML file.
        seed: The seed of all random numbers. None: the scenario's own.
        planner: A planner's name. None: the scenario's own.
        record: The file of the recording.
        snapshots: The directory of the pictures.
        json_file: File for the figures as JSON; the config is written to the same directory.
        out: The directory for all outputs.
        overrides: ``key=value`` for keys of the scenario.
        model_path: Folders of the models that a Gazebo world includes.
        quiet: Whether only errors are printed.

    Returns:
        The exit code.
    """
    from simloop.cli.outputs import choose
    from simloop.evaluation.referee import Outcome
    from simloop.scenario.inputs import input_files
    from simloop.scenario.load import load, resolve

    wanted = load(
        scenario, overrides or (), seed=seed, planner=planner, model_path=model_path or ()
    )
    outputs = choose(out, record, snapshots, json_file)
    outputs.check(input_files(wanted, resolve(scenario)))
    world = _build(wanted, Console(stderr=True, quiet=quiet))
    # Nothing is written before this line, and all input is checked before it.
    outcome = _run_world(wanted, world, outputs, quiet)
    if outcome is Outcome.INTERRUPTED:
        sys.exit(INTERRUPTED)  # without a message, because the table shows it
    return 0 if outcome.success else 1


@app.command("certify")
def certify(
    json_file: JsonFile = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="A family of checks; repeatable. Default: all."),
    ] = None,
) -> int:
    """Check the physics of the tracks against known solutions.

    Exit code 0: every check holds. 1: at least one does not.
    \f

    Args:
        json_file: File for the figures as JSON.
        only: Families of checks.

    Returns:
        The exit code.
    """
    from simloop import certify as certificate
    from simloop.cli.tables import print_certificate
    from simloop.common.errors import did_you_mean
    from simloop.common.terminal import checking
    from simloop.evaluation.provenance import machine, versions

    for name in only or ():
        if name not in certificate.families():
            hint = did_you_mean(name, certificate.families())
            raise InputError(f"--only {name}: unknown family of checks{hint}")
    check_json(json_file)
    checks = []
    with checking(Console(stderr=True)) as report:
        for check in certificate.run(only or ()):
            checks.append(check)
            report(check.group, len(checks))
    print_certificate(Console(), checks)
    figures = certificate.figures(checks)
    write_json(json_file, {**figures, "versions": versions(), "machine": machine()})
    return 0 if figures["ok"] else 1


def _run_world(scenario: Scenario, world: World, outputs: Outputs, quiet: bool) -> Outcome:
    """Run a scenario in its world, write the outputs and print the result."""
    from simloop.common.files import folder_lock

    console, notes = Console(quiet=quiet), Console(stderr=True, quiet=quiet)
    with compiling_shown(notes) as report:
        from simloop.evaluation.provenance import versions
        from simloop.loop import Simulation, warm_up
        from simloop.recording.watch import watch

        warm_up(scenario, world, report)
    outputs.prepare()
    with (
        folder_lock(outputs.folder, outputs.snapshots),
        stop_asked() as stop,
        watch(scenario, world, outputs) as watched,
    ):
        outputs.announce(scenario, versions())
        simulation = Simulation(scenario, watched.listeners, world=world)
        result = _drive(simulation, notes, stop)
        try:
            outputs.write_result(
                result.metrics | _plan_figures(watched, notes, stop), scenario, versions()
            )
            watched.finish()
        finally:
            _print_result(console, result.metrics, outputs, watched.recording)
    return result.outcome


def _drive(simulation: Simulation, notes: Console, stop: Callable[[], bool]) -> RunResult:
    """Run with a progress bar until the end, or until ``stop`` returns True."""
    from simloop.common.terminal import progress_bar

    to_go, limit = simulation.metrics.distance_to_go_m(), simulation.scenario.time_limit_s
    with progress_bar(notes, to_go, limit) as show:

        def progress(sim_time_s: float, to_go_m: float) -> bool:
            show(sim_time_s, to_go_m)
            return not stop()

        result = simulation.run(progress)
    if result.unstable:
        text = f"unstable at {simulation.plant.t_ns * 1e-9:.2f} s: {result.unstable}"
        notes.print(text, markup=False, highlight=False, soft_wrap=True)
    return result


def _build(scenario: Scenario, notes: Console) -> World:
    """Build the scenario's world, and print what was left out or assumed when it was read."""
    from simloop.common.waiting import said_if_slow
    from simloop.scenario.build import build_world

    with said_if_slow(notes, "building the world"):
        world = build_world(scenario)
    for line in world.notes:
        notes.print(f"note: {printable(line)}", markup=False, highlight=False, soft_wrap=True)
    return world


def _plan_figures(watched: Watch, notes: Console, stop: Callable[[], bool]) -> dict[str, Any]:
    """Compute the exact optima with a progress bar. Tell for how many plans there is none."""
    from simloop.common.terminal import counting

    plans, optima = watched.plan_count
    done = 0

    def count(so_far: int) -> None:
        nonlocal done
        done = so_far
        show(so_far)

    with counting(notes, "exact optima", optima) as show:
        figures = watched.plan_figures(stop, count)
    if done < plans:
        why = "stopped" if done < optima else "the others would take too long"
        notes.print(
            f"{done} of {plans} plans are compared with the exact optimum: {why}", soft_wrap=True
        )
    return figures


def _print_result(
    console: Console, metrics: dict[str, Any], outputs: Outputs, recording: Path | None
) -> None:
    """Print the table of figures and the written files."""
    from simloop.cli.tables import print_result

    print_result(console, metrics)
    places = (
        ("recording", recording, "to open it: rerun "),
        ("pictures", outputs.snapshots, ""),
        ("figures", outputs.result, ""),
        ("config", outputs.config, "to repeat the run: simloop run "),
    )
    for name, path, hint in places:
        if path is not None and path.exists():
            shown = printable(str(path))
            quoted = shlex.quote(shown)
            text = f"  {name:13} {shown}" + (f"   ({hint}{quoted})" if hint else "")
            console.print(text, markup=False, highlight=False, soft_wrap=True)


if __name__ == "__main__":
    main()
