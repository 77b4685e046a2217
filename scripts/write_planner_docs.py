"""Write the tables of docs/planners.md and docs/benchmarks.md from the benchmarks' JSON files.

    simloop bench papers --json papers.json
    simloop bench planners --seeds 20 --json planners.json
    python scripts/write_planner_docs.py papers.json --planners planners.json

A table stands between ``<!-- begin NAME -->`` and ``<!-- end NAME -->``. Everything else stays as
it is. Exit code 2: an input is wrong; then no file is changed.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from simloop.benchmarks.papers.entries import EVERY, WORLDS
from simloop.benchmarks.papers.page import figure
from simloop.benchmarks.papers.papers import LEAD, PAPERS
from simloop.benchmarks.planners.bench_figures import rank
from simloop.benchmarks.planners.weights import PRINTED
from simloop.cli.edge import run_script
from simloop.common.errors import InputError
from simloop.common.files import write_text

DOCS = Path(__file__).resolve().parent.parent / "docs"
Figures = dict[str, Any]

_POOLED = "S1-S4"
_SCENES = ("S1", "S2", "S3", "S4a", "S4b")


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Make a table in Markdown.

    Args:
        header: The columns' names.
        rows: The rows.

    Returns:
        The lines of the table.
    """
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def conditions(found: Figures) -> str:
    """Describe how the drives were measured.

    Args:
        found: The figures of ``simloop bench papers``.

    Returns:
        One paragraph.
    """
    first, last = found["seeds"]
    return (
        f"{found['runs_finished']} runs, seeds {first} to {last - 1}, "
        f"on {found['machine']['cpu']}, several runs at once. Times of frames are processor times: "
        "use them only for comparison."
    )


def closed_loop(found: Figures) -> str:
    """Make the table of all planners in the four worlds.

    Args:
        found: The figures of ``simloop bench papers``.

    Returns:
        Markdown.
    """
    cells = {
        (cell["planner"], cell["world"]): cell for cell in found["cells"] if cell["group"] == EVERY
    }
    names = list(dict.fromkeys(planner for planner, _ in cells))
    rows = [[name, *(_drive(cells.get((name, world))) for world in WORLDS)] for name in names]
    touched = [
        f"{name} in {world}: {cell['contacts']}"
        for (name, world), cell in cells.items()
        if cell["contacts"]
    ]
    contacts = (
        f"Contacts caused by the vehicle: {'; '.join(touched)}."
        if touched
        else "The vehicle touched nothing in any of these runs."
    )
    reasons: dict[tuple[str, str], list[str]] = {}
    for (name, world), cell in cells.items():
        if cell["reason"]:
            reasons.setdefault((name, cell["reason"]), []).append(world)
    why = [
        f"- `{name}` in {', '.join(worlds)}: {text}." for (name, text), worlds in reasons.items()
    ]
    parts = [conditions(found), table(["planner", *WORLDS], rows), contacts]
    return "\n\n".join([*parts, *(["\n".join(why)] if why else [])])


def _drive(cell: Figures | None) -> str:
    """Format a cell: arrivals, median time, median time of a frame."""
    if cell is None:
        return "-"
    time = "-" if cell["time_median_s"] is None else f"{cell['time_median_s']:.1f} s"
    frame = "-" if cell["frame_ms_p50"] is None else f"{cell['frame_ms_p50']:.3g} ms"
    return f"{cell['arrivals']} of {cell['runs']}, {time}, {frame}"


def paper_worlds(found: Figures) -> str:
    """Make the table of the papers' methods in the papers' worlds.

    Args:
        found: The figures of ``simloop bench papers``.

    Returns:
        Markdown.
    """
    header = ["world", "planner", "arrivals", "95 %", "contacts", "hits", "time s", "path ratio",
              "frame ms p50 / p99", "by construction"]  # fmt: skip
    keys = [paper.key for paper in PAPERS]
    rows, last = [], ""
    for cell in sorted(
        (cell for cell in found["cells"] if cell["group"] in keys),
        key=lambda cell: keys.index(cell["group"]),
    ):
        low, high = cell["arrival_interval"]
        name = f"**{cell['planner']}**" if cell["role"] == "own" else cell["planner"]
        rows.append([
            cell["world"] if cell["world"] != last else "", name,
            f"{cell['arrivals']} of {cell['runs']}", f"{100 * low:.0f} to {100 * high:.0f}",
            str(cell["contacts"]), str(cell["hits"]), figure(cell["time_median_s"], 1),
            figure(cell["path_ratio"], 3),
            f"{figure(cell['frame_ms_p50'], 1)} / {figure(cell['frame_ms_p99'], 1)}",
            cell["reason"],
        ])  # fmt: skip
        last = cell["world"]
    return table(header, rows)


def paper_tables(found: Figures) -> str:
    """Make the papers' tables, printed beside measured.

    Args:
        found: The figures of ``simloop bench papers``.

    Returns:
        Markdown.
    """
    parts = []
    for one in (one for part in found["tables"].values() for one in part):
        rows = [
            [side, *(figure(value, 3) for value in row)]
            for row, side in _paired(one["printed"], one["ours"])
        ]
        notes = [f"- agrees: {text}" for text in one["agrees"]]
        notes += [f"- differs: {text}" for text in one["differs"]]
        parts += [
            f"**{one['title']}.** {one['source']}.",
            table(["", *one["columns"]], rows),
            "\n".join(notes),
        ]
    return "\n\n".join(part for part in parts if part)


def _paired(
    printed: Sequence[Sequence[Any]], ours: Sequence[Sequence[Any]]
) -> list[tuple[Sequence[Any], str]]:
    """Put each measured row below the printed row of the same name, the others at the end."""
    named = {str(row[0]): row for row in ours}
    rows: list[tuple[Sequence[Any], str]] = []
    for row in printed:
        rows.append((row, "printed"))
        if str(row[0]) in named:
            rows.append((named.pop(str(row[0])), "here"))
    return rows + [(row, "here") for row in named.values()]


def weights(found: Figures) -> str:
    """Make the table of the weight study.

    Args:
        found: The figures of ``simloop bench papers``.

    Returns:
        Markdown.
    """
    study = found["weights"]
    pls, front = study["pls"], study["front"]
    rows = [
        ["R2 of the predictors", figure(pls["r2_x"], 3), ""],
        ["R2 of J", figure(pls["r2_y"], 3), f"{PRINTED['r2']}"],
        ["Q2 of J", figure(pls["q2"], 3), f"{PRINTED['q2']}"],
        ["VIP of w1, w2, J1, J2", ", ".join(figure(value) for value in pls["vip"]),
         "w1 and J1 lead"],
        ["plans on the Pareto front", str(sum(front)), ""],
    ]  # fmt: skip
    for name, key, unit in (("length", "length_m", "m"), ("turning", "turning_rad", "rad")):
        values = [value for value, on in zip(study[key], front, strict=True) if on]
        span = f"{min(values):.4f} to {max(values):.4f} {unit}"
        rows.append([f"{name} on the front", span, ""])
    return table(["", "measured", "printed"], rows)


def metaheuristics(found: Figures) -> str:
    """Make the table of the metaheuristics on the scenes S1 to S4.

    Args:
        found: The figures of ``simloop bench planners``.

    Returns:
        Markdown.
    """
    pooled = found["comparison"].get(_POOLED, {})
    first = found["scenes"][_SCENES[0]]
    names = [name for name in first if name == LEAD or name in pooled]
    names.sort(key=lambda name: (name != LEAD, rank(first[name])))
    rows = []
    for name in names:
        cells = [_gap(found["scenes"].get(scene, {}).get(name)) for scene in _SCENES]
        at = pooled.get(name)
        last = (
            f"{at['difference']:.3f}, {at['lead_wins']} / {at['rival_wins']}, {at['p_holm']:.0e}"
            if at
            else ""
        )
        rows.append([f"**{name}**" if name == LEAD else name, *cells, last])
    pairs = f"all: median difference from {LEAD}, %; pairs won by {LEAD} / lost; p (Holm)"
    header = ["gap %, p50 / p95", *_SCENES, pairs]
    return table(header, rows)


def _gap(at: Figures | None) -> str:
    if at is None or at["gap_p50"] is None:
        return "-"
    fails = "" if at["success"] == 1.0 else f" ({100.0 * at['success']:.0f} % succeed)"
    return f"{at['gap_p50']:.3f} / {at['gap_p95']:.3f}{fails}"


PAPERS_BLOCKS: Mapping[str, tuple[tuple[str, Callable[[Figures], str]], ...]] = {
    "planners.md": (("closed_loop", closed_loop), ("paper_worlds", paper_worlds)),
    "benchmarks.md": (("paper_tables", paper_tables), ("weights", weights)),
}
"""File -> the blocks that are written from the figures of ``simloop bench papers``."""

PLANNERS_BLOCKS: Mapping[str, tuple[tuple[str, Callable[[Figures], str]], ...]] = {
    "benchmarks.md": (("metaheuristics", metaheuristics),),
}
"""File -> the blocks that are written from the figures of ``simloop bench planners``."""


def replaced(text: str, name: str, block: str) -> str:
    """Replace what stands between a pair of markers.

    Args:
        text: The text of a file.
        name: Name of the block.
        block: The new content.

    Returns:
        The new text.

    Raises:
        InputError: A marker is missing or not unique.
    """
    begin, end = f"<!-- begin {name} -->", f"<!-- end {name} -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise InputError(f"the markers '{begin}' and '{end}' must each be there once, in order")
    before, after = text.split(begin)[0], text.split(end)[1]
    return f"{before}{begin}\n{block}\n{end}{after}"


def write(docs: Path, papers: Figures | None, planners: Figures | None) -> list[Path]:
    """Write all blocks that the figures hold.

    Args:
        docs: The folder of the documentation.
        papers: The figures of ``simloop bench papers``, or None.
        planners: The figures of ``simloop bench planners``, or None.

    Returns:
        The files that have changed.

    Raises:
        InputError: A file or a marker is missing; then nothing is written.
    """
    texts: dict[str, str] = {}
    for found, blocks in ((papers, PAPERS_BLOCKS), (planners, PLANNERS_BLOCKS)):
        for file, named in blocks.items() if found is not None else ():
            for name, make in named:
                if _has(found or {}, name):
                    text = texts.get(file) or _read(docs / file)
                    try:
                        texts[file] = replaced(text, name, make(found or {}))
                    except InputError as error:
                        raise InputError(f"{docs / file}: {error}") from None
    changed = [docs / file for file, text in texts.items() if text != _read(docs / file)]
    for file in changed:
        write_text(file, texts[file.name])
    return changed


def _has(found: Figures, name: str) -> bool:
    """Whether the figures hold what a block needs; a partial benchmark leaves some out."""
    groups = {cell["group"] for cell in found.get("cells", ())}
    needed = {
        "closed_loop": EVERY in groups,
        "paper_worlds": bool(groups - {EVERY}),
        "paper_tables": bool(found.get("tables")),
        "weights": found.get("weights") is not None,
        "metaheuristics": _SCENES[0] in found.get("scenes", {}),
    }
    return bool(needed[name])


def _read(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{file}: {error.strerror}") from None


def read_figures(file: Path | None, key: str, partial: bool) -> Figures | None:
    """Read a benchmark's JSON file.

    Args:
        file: The file, or None.
        key: A key that the benchmark's figures have.
        partial: Whether the figures of an interrupted benchmark are accepted.

    Returns:
        The figures; None without a file.

    Raises:
        InputError: The file is missing, is not such a file, or the benchmark was interrupted.
    """
    if file is None:
        return None
    try:
        found: Figures = json.loads(_read(file))
    except ValueError as error:
        raise InputError(f"{file}: not a JSON file: {error}") from None
    if not isinstance(found, dict) or key not in found:
        raise InputError(f"{file}: not the figures of this benchmark; it has no '{key}'")
    if found.get("interrupted") and not partial:
        raise InputError(f"{file}: the benchmark was interrupted; finish it, or give --partial")
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the script.

    Args:
        arguments: The command line; None: that of the process.

    Returns:
        The exit code.

    Raises:
        InputError: If a file cannot be read, or is not what it should be.
    """
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("papers", type=Path, nargs="?", help="JSON of simloop bench papers")
    parser.add_argument("--planners", type=Path, help="JSON of simloop bench planners")
    parser.add_argument("--docs", type=Path, default=DOCS, help="folder of the documentation")
    parser.add_argument("--partial", action="store_true", help="accept an interrupted benchmark")
    given = parser.parse_args(arguments)
    papers = read_figures(given.papers, "cells", given.partial)
    planners = read_figures(given.planners, "scenes", given.partial)
    changed = write(given.docs, papers, planners)
    for file in changed:
        print(file)
    return 0


if __name__ == "__main__":
    run_script(main)
