"""Compare what the robot reported about its localisation with the ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from simloop.messages import FloatArray, Health, HealthState

WRONG_M, WRONG_RAD = 0.1, 0.1
"""A pose is wrong if its error is larger than one of these."""
_MOVING_MPS, _TURNING_RADPS = 0.02, 0.05  # the robot moves if it is faster than one of these


def health_account(
    reports: Sequence[Health], t_ns: FloatArray, error: FloatArray, truth: FloatArray
) -> dict[str, Any]:
    """Compute how long the robot was in each state of health, and how long it was wrong.

    Args:
        reports: The robot's reports in order. There is one at each change of its health. Before
            the first one the robot is ``ok``.
        t_ns: (n,) instants of the estimates, ns.
        error: (n, 3) errors of the estimates in x, y, m, and yaw, rad.
        truth: (n, 3) true poses x, y, yaw of base_link in map.

    Returns:
        ``ok_s``, ``degraded_s``, ``lost_s``: seconds in each state; ``reasons_s``: seconds under
        each reason; ``final``: the last state; ``unsaid_s``: seconds in which the robot moved
        or turned with a wrong pose and reported ``ok``. A robot that stands still drives into
        nothing, and what its sensors see of the place does not change, so nothing new can tell it
        that it is wrong.
    """
    period_s = float(np.median(np.diff(t_ns))) * 1e-9 if len(t_ns) > 1 else 0.0
    # current[i] is the number of the report that is valid at estimate i; 0 is before the first.
    changes = np.array([report.t_ns for report in reports], np.int64)
    current = changes.searchsorted(t_ns, side="right")
    ticks = np.bincount(current, minlength=len(reports) + 1)
    states = dict.fromkeys((state.value for state in HealthState), 0.0)
    states["ok"] = float(ticks[0])
    reasons: dict[str, float] = {}
    for report, count in zip(reports, ticks[1:].tolist(), strict=True):
        states[report.state.value] += count
        for reason in report.reasons:
            reasons[reason.value] = reasons.get(reason.value, 0.0) + count * period_s
    reported_ok = np.array([True, *(report.state is HealthState.OK for report in reports)])[current]
    wrong = (np.hypot(error[:, 0], error[:, 1]) > WRONG_M) | (np.abs(error[:, 2]) > WRONG_RAD)
    steps = np.diff(truth, axis=0, prepend=truth[:1])
    turned = np.abs(np.remainder(steps[:, 2] + np.pi, 2.0 * np.pi) - np.pi)
    moves = np.hypot(steps[:, 0], steps[:, 1]) > _MOVING_MPS * period_s
    moves |= turned > _TURNING_RADPS * period_s
    return {
        **{f"{state}_s": count * period_s for state, count in states.items()},
        "reasons_s": reasons,
        "final": reports[-1].state.value if reports else "ok",
        "unsaid_s": float(np.sum(reported_ok & wrong & moves)) * period_s,
    }
