"""Write the verdict of a campaign as JUnit XML, the format of continuous integration servers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as Xml

from simloop.campaign.spec import Cell, RunSpec
from simloop.campaign.thresholds import Verdict
from simloop.campaign.work import ERROR, Row
from simloop.common.files import write_bytes

_ILLEGAL = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def write_junit(
    file: Path, runs: Sequence[tuple[RunSpec, Row]], verdicts: Sequence[Verdict]
) -> None:
    """Write a test suite for each cell, with a test case for each run and each verdict.

    Without verdicts, a run that did not reach the goal is a failed case. With verdicts, it is a
    skipped case, and only a threshold that does not hold is a failed case.

    Args:
        file: The XML file. Its directory must exist.
        runs: Each run with its row.
        verdicts: The verdicts on these runs.

    Raises:
        InputError: If the file cannot be written.
    """
    root = Xml.Element("testsuites", name="simloop campaign")
    suites: dict[Cell, Xml.Element] = {}
    for spec, row in runs:
        if spec.cell not in suites:
            name = " ".join(part for part in spec.cell if part)
            suites[spec.cell] = Xml.SubElement(root, "testsuite", name=name)
        _add_run(suites[spec.cell], spec, row, skip=bool(verdicts))
    for verdict in verdicts:
        _add_verdict(suites[verdict.cell], verdict)
    for suite in suites.values():
        for kind, tag in (("tests", "testcase"), ("failures", "failure"), ("errors", "error")):
            suite.set(kind, str(len(list(suite.iter(tag)))))
    for element in root.iter():
        element.text = _legal(element.text) if element.text else None
        element.attrib = {key: _legal(value) for key, value in element.attrib.items()}
    Xml.indent(root)
    write_bytes(file, Xml.tostring(root, encoding="utf-8", xml_declaration=True))


def _legal(text: str) -> str:
    """Write the characters that XML 1.0 cannot hold, e.g. control characters, as escapes."""
    return _ILLEGAL.sub(lambda found: ascii(found[0])[1:-1], text)


def _add_run(suite: Xml.Element, spec: RunSpec, row: Row, *, skip: bool) -> None:
    case = Xml.SubElement(
        suite, "testcase", classname=suite.get("name", ""), name=f"seed {spec.seed}",
        time=f"{row.get('wall_time_s') or 0.0:.3f}",
    )  # fmt: skip
    if not row["success"]:
        kind = "error" if row["outcome"] == ERROR else "failure"
        note = Xml.SubElement(case, "skipped" if skip else kind, message=row["outcome"])
        note.text = row["error"] or spec.command()


def _add_verdict(suite: Xml.Element, verdict: Verdict) -> None:
    name = str(verdict.threshold)
    case = Xml.SubElement(suite, "testcase", classname=suite.get("name", ""), name=name)
    if not verdict.holds:
        Xml.SubElement(case, "failure", message=f"{name}: {verdict.measured}")
