"""What the drives confirm of a paper's claims, and what they do not, with the likely reason."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from simloop.benchmarks.papers.figures import Cell
from simloop.benchmarks.papers.papers import (
    ARRIVES,
    FIELD_STUCK,
    PACE,
    SAFE,
    SHORTEST,
    Drive,
    Paper,
)

PAPERS_TIME_S = 51.0
"""Time that the robot of Sabiha 2022 needed, s."""

_NEAR = 0.15


@dataclass(frozen=True, slots=True)
class Finding:
    """A claim of a paper, checked with drives.

    Attributes:
        holds: Whether the drives agree with the claim.
        text: What was measured.
        reason: The likely reason if they do not; may be empty.
    """

    holds: bool
    text: str
    reason: str = ""


def findings(paper: Paper, cells: Mapping[tuple[str, str], Cell]) -> list[Finding]:
    """Check the claims of a paper that drives can check.

    Args:
        paper: The paper.
        cells: (world, planner) -> figures.

    Returns:
        One finding for each claim and world that was driven.
    """
    checks = {
        ARRIVES: _arrives,
        SAFE: _safe,
        SHORTEST: _shortest,
        PACE: _pace,
        FIELD_STUCK: _field_stuck,
    }
    found = []
    for drive in paper.drives:
        for claim in drive.expected:
            checked = checks[claim](drive, cells)
            if checked is not None:
                holds, text = checked
                reason = "" if holds else paper.why.get(claim, "")
                found.append(Finding(holds, f"{drive.world}: {text}", reason))
    return found


Checked = tuple[bool, str] | None


def _arrives(drive: Drive, cells: Mapping[tuple[str, str], Cell]) -> Checked:
    cell = cells.get((drive.world, drive.own))
    if cell is None:
        return None
    text = f"{drive.own} arrives in {cell['arrivals']} of {cell['runs']} runs."
    return cell["arrivals"] == cell["runs"], text


def _safe(drive: Drive, cells: Mapping[tuple[str, str], Cell]) -> Checked:
    cell = cells.get((drive.world, drive.own))
    if cell is None:
        return None
    if cell["contacts"]:
        return False, f"the vehicle touches something {cell['contacts']} times with {drive.own}."
    nearest = cell["min_clearance_m"]
    near = "" if nearest is None else f"; its outline keeps {100.0 * nearest:.1f} cm or more"
    return True, f"the vehicle touches nothing with {drive.own}{near}."


def _shortest(drive: Drive, cells: Mapping[tuple[str, str], Cell]) -> Checked:
    """Compare the mean driven lengths over the runs that arrived."""
    paths = {
        name: cell["path_m"]
        for name in (drive.own, *drive.rivals)
        if (cell := cells.get((drive.world, name))) is not None and cell["path_m"] is not None
    }
    if drive.own not in paths or len(paths) < 2:
        return None
    order = sorted(paths, key=paths.__getitem__)
    shown = ", ".join(f"{name} {paths[name]:.2f} m" for name in order)
    longer = 100.0 * (paths[drive.own] / paths[order[0]] - 1.0)
    behind = f" {drive.own} is {longer:.1f} % longer than the shortest." if longer > 0.0 else ""
    return order[0] == drive.own, f"mean driven length in order: {shown}.{behind}"


def _pace(drive: Drive, cells: Mapping[tuple[str, str], Cell]) -> Checked:
    cell = cells.get((drive.world, drive.own))
    if cell is None or cell["time_mean_s"] is None:
        return None
    text = (
        f"the drive takes {cell['time_mean_s']:.1f} s on average; in the paper {PAPERS_TIME_S:g} s."
    )
    return abs(cell["time_mean_s"] / PAPERS_TIME_S - 1.0) < _NEAR, text


def _field_stuck(drive: Drive, cells: Mapping[tuple[str, str], Cell]) -> Checked:
    own, plain = (cells.get((drive.world, name)) for name in (drive.own, "potential_field"))
    if own is None or plain is None:
        return None
    text = (
        f"the plain potential field arrives in {plain['arrivals']} of {plain['runs']} runs, "
        f"{drive.own} in {own['arrivals']} of {own['runs']}."
    )
    shares = [cell["arrivals"] / cell["runs"] for cell in (own, plain)]
    return shares[0] > shares[1], text
