"""Faults on purpose, each in many runs: does the robot recover, or say that it is lost and stop?

It must never drive on a wrong pose without saying so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from rich.console import Console

from simloop.common.terminal import print_table
from simloop.loop import Simulation
from simloop.scenario.load import load

_SCENARIO = "faults"
MOST_UNSAID_S = 0.25
"""What passes until a scan has come, and been refused: two turns of the LiDAR and a little."""

FAULTS: dict[str, tuple[str, str]] = {
    "none": ("", "arrives; nothing is said but of slip"),
    "encoder stuck": (
        '{kind="encoder_stuck", at_s=4.0, side="left"}',
        "does not hear that belt; arrives",
    ),
    "encoders silent 1 s": ('{kind="encoders_silent", at_s=4.0, for_s=1.0}', "says so; arrives"),
    "gyro's bias jumps": (
        '{kind="gyro_jump", at_s=4.0, bias_radps=0.1}',
        "finds its bias anew; arrives",
    ),
    "IMU silent 1 s": ('{kind="imu_silent", at_s=4.0, for_s=1.0}', "says so; arrives"),
    "30 % of beams dropped": ('{kind="beams_dropped", at_s=0.0, share=0.3}', "arrives"),
    "glass": (
        '{kind="glass", at_s=0.0, min_m=[-0.9, 0.8], max_m=[-0.5, 3.0]}',
        "arrives",
    ),
    "LiDAR silent 2 s": (
        '{kind="lidar_silent", at_s=4.0, for_s=2.0}',
        "stops until it sees again; arrives",
    ),
    "LiDAR silent for good": (
        '{kind="lidar_silent", at_s=4.0}',
        "stops, and says why",
    ),
    "scans 0.2 s late": ('{kind="lidar_late", at_s=2.0, delay_s=0.2}', "arrives"),
    "one track on ice": (
        '{kind="ice", at_s=4.0, for_s=4.0, side="left", friction=0.05}',
        "does not hear that belt; arrives",
    ),
    "pushed 0.3 m sideways": (
        '{kind="pushed", at_s=4.0, for_s=0.5, shift_m=0.3}',
        "notices; arrives",
    ),
    "kidnapped": (
        '{kind="kidnapped", at_s=5.0, to=[0.6, 2.0, 1.0]}',
        "says that it is lost, finds itself; arrives",
    ),
}
"""What goes wrong, as in a scenario's ``faults``, and what the robot is to make of it."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One run with a fault; health: see ``health_account``."""

    fault: str
    seed: int
    outcome: str
    contacts: int
    health: dict[str, Any]
    ate_rmse_m: float
    sim_time_s: float

    @property
    def handled(self) -> bool:
        """Whether it did as the table says, hit nothing, and was never wrong without saying so."""
        stops = FAULTS[self.fault][1].startswith("stops, and")
        fate = self.outcome == "lost" if stops else self.outcome == "reached"
        return fate and not self.contacts and self.health["unsaid_s"] <= MOST_UNSAID_S


def run_trial(fault: str, seed: int) -> Trial:
    """One run of a fault of ``FAULTS``."""
    result = Simulation(load(_SCENARIO, [f"faults=[{FAULTS[fault][0]}]"], seed=seed)).run()
    m = result.metrics
    return Trial(
        fault,
        seed,
        result.outcome,
        m["contact_count"],
        m["health"],
        m["ate_rmse_m"],
        m["sim_time_s"],
    )


def run(seeds: int, tell: Callable[[str, int], None]) -> Iterator[Trial]:
    """All faults with so many seeds each. tell: hears of each fault and seed before its run."""
    for fault in FAULTS:
        for seed in range(seeds):
            tell(fault, seed)
            yield run_trial(fault, seed)


def figures(trials: list[Trial]) -> dict[str, Any]:
    """What ``--json`` writes."""
    found = {}
    for fault, (_, expected) in FAULTS.items():
        mine = [t for t in trials if t.fault == fault]
        if mine:
            found[fault] = {
                "expected": expected,
                "runs": len(mine),
                "handled": sum(t.handled for t in mine),
                "ate_rmse_m_worst": max(t.ate_rmse_m for t in mine),
                "unsaid_s_worst": max(t.health["unsaid_s"] for t in mine),
                "failed_seeds": [t.seed for t in mine if not t.handled],
            }
    return {"ok": all(t.handled for t in trials), "faults": found}


def print_figures(console: Console, found: dict[str, Any]) -> None:
    """One row a fault."""
    rows = [
        [
            fault,
            row["expected"],
            f"{row['handled']}/{row['runs']}",
            f"{1e3 * row['ate_rmse_m_worst']:.0f} mm",
            f"{row['unsaid_s_worst']:.2f} s",
        ]
        for fault, row in found["faults"].items()
    ]
    columns = ["fault", "the robot", "handled", "worst ATE", "wrong and unsaid"]
    print_table(console, "Faults on purpose", columns, rows)
