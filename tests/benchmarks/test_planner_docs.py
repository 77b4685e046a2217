"""The tables in the docs that a script writes from the benchmarks' figures."""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "scripts"))
import write_planner_docs as script  # noqa: E402

from simloop.benchmarks.papers.entries import Entry  # noqa: E402
from simloop.benchmarks.papers.figures import cell_of  # noqa: E402
from simloop.common.errors import InputError  # noqa: E402

BLOCKS = [
    (file, name)
    for blocks in (script.PAPERS_BLOCKS, script.PLANNERS_BLOCKS)
    for file, named in blocks.items()
    for name, _ in named
]


def run(planner, seed, success):
    return {"planner": planner, "seed": seed, "success": success, "outcome": "x", "error": "",
            "sim_time_s": 12.0, "frame_ms": [2.0], "contact_count": 0, "hit_count": 0}  # fmt: skip


def papers():
    """Figures of the benchmark of the papers, with little data."""
    cells = [
        cell_of(Entry("planners", "trap", "potential_field"), [run("p", 0, False)]),
        cell_of(Entry("planners", "experiment", "tlbo"), [run("t", 0, True)]),
        cell_of(Entry("wu", "paper_wu", "niwtlbo", "own"), [run("n", 0, True)]),
    ]
    table = {"title": "Lengths", "source": "Wu 2016, Table 1", "columns": ["algorithm", "mean"],
             "printed": [["TLBO", 1.5]], "ours": [["TLBO", 2.5], ["other", 3.0]],
             "agrees": ["order"], "differs": []}  # fmt: skip
    study = {"pls": {"r2_x": 0.9, "r2_y": 0.8, "q2": 0.7, "vip": [1.0, 1.0, 0.5, 0.2]},
             "front": [True, False], "length_m": [6.0, 7.0], "turning_rad": [1.0, 2.0]}  # fmt: skip
    rest = {"seeds": [0, 1], "runs_finished": 3, "machine": {"cpu": "a processor"}}
    return {"cells": cells, "tables": {"wu": [table]}, "weights": study, **rest}


def planners():
    """Figures of the benchmark of the planners, with little data."""
    at = {"gap_p50": 0.1, "gap_p95": 0.2, "success": 1.0}
    return {
        "scenes": {"S1": {"tlbo": at, "ga": {**at, "success": 0.5}, "exact": at}},
        "comparison": {
            "S1-S4": {"ga": {"difference": 0.3, "lead_wins": 9, "rival_wins": 1, "p_holm": 1e-3}}
        },
    }


@pytest.fixture
def docs(tmp_path):
    for file in {file for file, _ in BLOCKS}:
        shutil.copy(ROOT / "docs" / file, tmp_path / file)
    return tmp_path


@pytest.mark.parametrize(("file", "name"), BLOCKS)
def test_the_docs_have_a_pair_of_markers_for_each_table(file, name):
    text = (ROOT / "docs" / file).read_text()
    begin, end = f"<!-- begin {name} -->", f"<!-- end {name} -->"
    assert text.count(begin) == text.count(end) == 1 and text.index(begin) < text.index(end)


@pytest.mark.parametrize("file", sorted({file for file, _ in BLOCKS}))
def test_nothing_in_the_docs_is_unfinished(file):
    text = (ROOT / "docs" / file).read_text().lower()
    assert not re.search("so far|not measured|to fill this|to be measured", text)


def test_the_script_is_idempotent_and_changes_its_tables_only(docs):
    before = {file: file.read_text() for file in docs.iterdir()}
    first = script.write(docs, papers(), planners())
    once = {file: file.read_text() for file in docs.iterdir()}
    assert set(first) == set(before) and once != before
    assert script.write(docs, papers(), planners()) == []
    assert {file: file.read_text() for file in docs.iterdir()} == once
    for file in before:
        pieces = [one for one in BLOCKS if one[0] == file.name]
        outside = [before[file], once[file]]
        for _, name in pieces:
            outside = [script.replaced(text, name, "") for text in outside]
        assert outside[0] == outside[1]


def test_the_tables_hold_the_figures(docs):
    script.write(docs, papers(), planners())
    drives, rest = ((docs / file).read_text() for file in ("planners.md", "benchmarks.md"))
    assert "| tlbo | 1 of 1, 12.0 s, 2 ms | - | - | - |" in drives
    assert "- `potential_field` in trap: the plain field" in drives
    assert "| paper_wu | **niwtlbo** | 1 of 1 | 21 to 100 |" in drives
    assert "| printed | TLBO | 1.500 |\n| here | TLBO | 2.500 |\n| here | other | 3.000 |" in rest
    assert "| **tlbo** | 0.100 / 0.200 | - |" in rest
    assert "| ga | 0.100 / 0.200 (50 % succeed) |" in rest and "| exact" not in rest
    assert "| Q2 of J | 0.700 | 0.93 |" in rest


def test_figures_of_a_part_leave_the_other_tables_alone(docs):
    before = (docs / "benchmarks.md").read_text()
    part = {**papers(), "tables": {}, "weights": None}
    assert script.write(docs, part, None) == [docs / "planners.md"]
    assert (docs / "benchmarks.md").read_text() == before


def test_a_missing_marker_changes_nothing(docs):
    file = docs / "planners.md"
    file.write_text(file.read_text().replace("<!-- end paper_worlds -->", ""))
    before = {file: file.read_text() for file in docs.iterdir()}
    with pytest.raises(InputError, match="paper_worlds"):
        script.write(docs, papers(), planners())
    assert {file: file.read_text() for file in docs.iterdir()} == before


def test_wrong_input_is_refused(docs, tmp_path):
    found = tmp_path / "found.json"
    for text, message in (
        ("{", "not a JSON file"),
        ("{}", "has no 'cells'"),
        (json.dumps({**papers(), "interrupted": True}), "was interrupted"),
    ):
        found.write_text(text)
        with pytest.raises(InputError, match=message):
            script.main([str(found), "--docs", str(docs)])
    assert script.main([str(found), "--docs", str(docs), "--partial"]) == 0
