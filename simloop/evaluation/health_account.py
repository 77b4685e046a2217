"""What the robot said of its localisation, held against the truth, once the run is over."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from simloop.messages import FloatArray, Health

WRONG_M, WRONG_RAD = 0.1, 0.1
"""An error of the pose above which it is wrong."""
_MOVING_M = 2e-4  # a period: 2 cm/s


def account(
    said: Sequence[Health], t_ns: FloatArray, error: FloatArray, truth: FloatArray
) -> dict[str, Any]:
    """Seconds in each state and under each reason, and how long a wrong pose was driven on.

    said: the changes, in order; t_ns (n,), error (n, 3) and truth (n, 3) of the estimates. final:
    the last state. unsaid_s: how long it truly moved with a pose that was wrong, and said ``ok``.
    """
    period_s = float(np.median(np.diff(t_ns))) * 1e-9 if len(t_ns) > 1 else 0.0
    changes = np.array([health.t_ns for health in said], np.int64)
    current = changes.searchsorted(t_ns, side="right")
    ticks = np.bincount(current, minlength=len(said) + 1)
    states = {"ok": float(ticks[0]), "degraded": 0.0, "lost": 0.0}
    reasons: dict[str, float] = {}
    for health, count in zip(said, ticks[1:].tolist(), strict=True):
        states[health.state] += count
        for reason in health.reasons:
            reasons[reason] = reasons.get(reason, 0.0) + count * period_s
    fine = np.array([True, *(health.state == "ok" for health in said)])[current]
    wrong = (np.hypot(error[:, 0], error[:, 1]) > WRONG_M) | (np.abs(error[:, 2]) > WRONG_RAD)
    moves = np.hypot(*np.diff(truth[:, :2], axis=0, prepend=truth[:1, :2]).T) > _MOVING_M
    return {
        **{f"{state}_s": count * period_s for state, count in states.items()},
        "reasons_s": reasons,
        "final": said[-1].state if said else "ok",
        "unsaid_s": float(np.sum(fine & wrong & moves)) * period_s,
    }
