"""Fault injection: does the robot recover, or report that it is lost and stop?

Each fault is tried in many runs. A run fails if the robot touches an obstacle. It also fails if the
robot drives with a wrong pose estimate without a report for longer than it needs to notice it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from rich.console import Console

from simloop.common.terminal import print_table
from simloop.loop import Simulation
from simloop.scenario.load import load

_SCENARIO = "faults"
MOST_UNSAID_S = 0.25
"""Longest time that the pose may be wrong without a report, s. A scan must arrive and be rejected;
this takes a little more than two turns of the LiDAR."""


_HONEST = ("reached", "lost", "stuck", "timeout", "unreachable")
"""Outcomes of a robot that may fail, but neither touches anything nor stops at a wrong place."""


class FaultCase(NamedTuple):
    """A fault and the expected reaction of the robot.

    Attributes:
        spec: The fault as an entry of a scenario's ``faults``, in TOML; empty for none.
        expected: The expected behaviour in words.
        outcomes: The outcomes that the run may have.
        scenario: The scenario that is driven.
        settings: Further settings, as for ``simloop run --set``.
    """

    spec: str
    expected: str
    outcomes: tuple[str, ...] = ("reached",)
    scenario: str = _SCENARIO
    settings: tuple[str, ...] = ()

    @property
    def overrides(self) -> list[str]:
        """The settings with the fault among them."""
        return [f"faults=[{self.spec}]", *self.settings]


FAULTS: dict[str, FaultCase] = {
    "none": FaultCase("", "arrives; reports slip at most"),
    "encoder stuck": FaultCase(
        '{kind="encoder_stuck", at_s=4.0, side="left"}', "ignores that belt; arrives"
    ),
    "encoders silent 1 s": FaultCase(
        '{kind="encoders_silent", at_s=4.0, for_s=1.0}', "reports it; arrives"
    ),
    "gyro's bias jumps": FaultCase(
        '{kind="gyro_jump", at_s=4.0, bias_radps=0.1}', "estimates its bias again; arrives"
    ),
    "IMU silent 1 s": FaultCase('{kind="imu_silent", at_s=4.0, for_s=1.0}', "reports it; arrives"),
    "30 % of beams dropped": FaultCase('{kind="beams_dropped", at_s=0.0, share=0.3}', "arrives"),
    "glass": FaultCase('{kind="glass", at_s=0.0, min_m=[-0.9, 0.8], max_m=[-0.5, 3.0]}', "arrives"),
    **{
        f"{share:.0%} of beams dropped".replace("%", " %"): FaultCase(
            f'{{kind="beams_dropped", at_s=4.0, share={share}}}', "stops and reports why", ("lost",)
        )
        for share in (0.9, 0.95, 0.98, 1.0)
    },
    "glass all round": FaultCase(
        '{kind="glass", at_s=0.0, min_m=[-100.0, -100.0], max_m=[100.0, 100.0]}',
        "does not set out, and reports why",
        ("lost",),
    ),
    "short range in a crowd": FaultCase(
        "",
        "arrives, or stops and reports why",
        _HONEST,
        "hall",
        ("lidar.range_max_m=1.5",),
    ),
    "noise x 10": FaultCase(
        '{kind="lidar_noise", at_s=0.0, noise_m=0.1}', "reports it; never arrives wrongly", _HONEST
    ),
    "LiDAR silent 2 s": FaultCase(
        '{kind="lidar_silent", at_s=4.0, for_s=2.0}', "stops until scans come again; arrives"
    ),
    "LiDAR silent for good": FaultCase(
        '{kind="lidar_silent", at_s=4.0}', "stops and reports why", ("lost",)
    ),
    "scans 0.2 s late": FaultCase('{kind="lidar_late", at_s=2.0, delay_s=0.2}', "arrives"),
    "one track on ice": FaultCase(
        '{kind="ice", at_s=4.0, for_s=4.0, side="left", friction=0.05}',
        "ignores that belt; arrives",
    ),
    "pushed 0.3 m sideways": FaultCase(
        '{kind="pushed", at_s=4.0, for_s=0.5, shift_m=0.3}', "notices it; arrives"
    ),
    "kidnapped": FaultCase(
        '{kind="kidnapped", at_s=5.0, to=[0.6, 2.0, 1.0]}',
        "reports that it is lost, relocalises; arrives",
    ),
}
"""Name of a fault -> the fault and the expected reaction of the robot."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One run with a fault.

    Attributes:
        fault: Name of the fault, a key of `FAULTS`.
        seed: Seed of the run.
        outcome: How the run ended.
        contacts: Number of contacts with obstacles.
        health: The run's health figures, see `simloop.evaluation.health_account`.
        ate_rmse_m: Absolute trajectory error of the estimate, RMS, m.
        sim_time_s: Simulated time, s.
    """

    fault: str
    seed: int
    outcome: str
    contacts: int
    health: dict[str, Any]
    ate_rmse_m: float
    sim_time_s: float

    @property
    def handled(self) -> bool:
        """Whether the robot did as expected, touched nothing and reported every wrong pose."""
        if self.outcome not in FAULTS[self.fault].outcomes or self.contacts:
            return False
        return bool(self.health["unsaid_s"] <= MOST_UNSAID_S)


def run_trial(fault: str, seed: int) -> Trial:
    """Run the fault scenario once.

    Args:
        fault: Name of the fault, a key of `FAULTS`.
        seed: Seed of the run.

    Returns:
        The result of the run.
    """
    case = FAULTS[fault]
    result = Simulation(load(case.scenario, case.overrides, seed=seed)).run()
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


def run(seeds: int, report: Callable[[str, int], None]) -> Iterator[Trial]:
    """Run every fault several times.

    Args:
        seeds: Number of runs for each fault, with the seeds from 0 on.
        report: Called with the fault and the seed before each run.

    Yields:
        The trials, fault by fault.
    """
    for fault in FAULTS:
        for seed in range(seeds):
            report(fault, seed)
            yield run_trial(fault, seed)


def figures(trials: list[Trial]) -> dict[str, Any]:
    """Summarise trials by fault.

    Args:
        trials: Trials of any faults.

    Returns:
        What ``simloop bench faults --json`` writes: ``ok`` and ``faults``, by name.
    """
    found = {}
    for fault, case in FAULTS.items():
        mine = [t for t in trials if t.fault == fault]
        if mine:
            found[fault] = {
                "expected": case.expected,
                "runs": len(mine),
                "handled": sum(t.handled for t in mine),
                "ate_rmse_m_worst": max(t.ate_rmse_m for t in mine),
                "unsaid_s_worst": max(t.health["unsaid_s"] for t in mine),
                "failed_seeds": [t.seed for t in mine if not t.handled],
            }
    return {"ok": all(t.handled for t in trials), "faults": found}


def print_figures(console: Console, found: dict[str, Any]) -> None:
    """Print the figures as a table with one row for each fault.

    Args:
        console: Console to print to.
        found: The figures from `figures`.
    """
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
    columns = ["fault", "expected", "handled", "worst ATE", "wrong, not reported"]
    print_table(console, "Fault injection", columns, rows)
