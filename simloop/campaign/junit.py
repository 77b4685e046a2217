"""A campaign's verdict as JUnit XML, which continuous integration servers show."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as Xml

from simloop.campaign.spec import RunSpec
from simloop.campaign.summary import Cell
from simloop.campaign.thresholds import Verdict
from simloop.campaign.work import Row
from simloop.common.files import write_bytes


def write_junit(
    file: Path, runs: Sequence[tuple[RunSpec, Row]], verdicts: Sequence[Verdict]
) -> None:
    """A suite a cell. A run that did not arrive fails, unless thresholds say what is required:
    then it is told as skipped, and each threshold is a case of its own."""
    root = Xml.Element("testsuites", name="simloop campaign")
    suites: dict[Cell, Xml.Element] = {}
    for spec, row in runs:
        if spec.cell not in suites:
            name = " ".join(part for part in spec.cell if part)
            suites[spec.cell] = Xml.SubElement(root, "testsuite", name=name)
        suite = suites[spec.cell]
        case = Xml.SubElement(
            suite, "testcase", classname=suite.get("name", ""), name=f"seed {spec.seed}",
            time=f"{row.get('wall_time_s') or 0.0:.3f}",
        )  # fmt: skip
        if not row["success"]:
            kind = "error" if row["outcome"] == "error" else "failure"
            note = Xml.SubElement(case, "skipped" if verdicts else kind, message=row["outcome"])
            note.text = row["error"] or spec.command()
    for verdict in verdicts:
        suite = suites[verdict.cell]
        case = Xml.SubElement(
            suite, "testcase", classname=suite.get("name", ""), name=str(verdict.threshold)
        )
        if not verdict.holds:
            value = "nothing to measure" if verdict.value is None else f"{verdict.value:.6g}"
            Xml.SubElement(case, "failure", message=f"{verdict.threshold}: {value}")
    for suite in suites.values():
        for kind, tag in (("tests", "testcase"), ("failures", "failure"), ("errors", "error")):
            suite.set(kind, str(len(list(suite.iter(tag)))))
    Xml.indent(root)
    write_bytes(file, Xml.tostring(root, encoding="utf-8", xml_declaration=True))
