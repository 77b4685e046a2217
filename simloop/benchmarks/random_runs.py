"""Random short runs of the whole loop: none may end in an exception, hang, or believe in no number.

A run is drawn from one number: a scenario of the package or a generated world, movers, faults,
settings at and near their limits, a planner. It is described by the command that repeats it.
"""

from __future__ import annotations

import math
import shlex
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import numpy as np

from simloop.common.errors import InputError
from simloop.config import Config
from simloop.evaluation.referee import Outcome
from simloop.loop import Simulation
from simloop.messages import Estimate, TrackCommand
from simloop.planners import registry
from simloop.scenario.catalog import scenario_files
from simloop.scenario.load import load
from simloop.truth import Published

_KINDS = ("barn", "forest", "rooms", "maze", "gaps", "utrap")
_MOTIONS = ("pedestrian", "walk", "constant")
# Settings whose limits only cost time or memory, or that need a file; drawn apart or not at all.
_NOT_DRAWN = {
    "rates.physics_s",
    "rates.control_s",
    "rates.lidar_s",
    "rates.plan_s",
    "slam.prior_map",
    "slam.extend_map",
    "slam.max_cells",
    "camera.period_s",
    "planner.max_evaluations",
}
_MOST = {  # beyond these a run only takes longer
    "lidar.rays": 4000,
    "camera.columns": 160,
    "camera.rows": 120,
    "planner.learners": 300,
    "planner.idle_generations": 100,
    "slam.search_points": 1000,
    "slam.search_xy_m": 0.5,
    "slam.search_yaw_rad": 0.5,
    "slam.refine_steps": 100,
}
_LEAST = {"slam.resolution_m": 0.02}
_RATES = (  # physics, control, LiDAR, plan, s
    (0.002, 0.01, 0.01, 0.5),
    (0.002, 0.01, 0.37, 1.83),
    (0.002, 0.01, 4.0, 1.0),
    (0.001, 0.02, 0.1, 0.02),
    (0.01, 0.1, 0.1, 2.0),
    (0.005, 0.05, 0.2, 100.0),
    (0.0005, 0.002, 0.1, 1.0),
)


@dataclass(frozen=True, slots=True)
class Case:
    """A run to try.

    Attributes:
        scenario: Name of a scenario of the package.
        seed: Its seed.
        overrides: ``key=value`` texts, as for ``--set``.
    """

    scenario: str
    seed: int
    overrides: tuple[str, ...]

    def command(self) -> str:
        """Return the command line that repeats the run.

        Returns:
            The line, quoted for a shell.
        """
        sets = [part for text in self.overrides for part in ("--set", text)]
        return shlex.join(["simloop", "run", self.scenario, "--seed", str(self.seed), *sets])


@dataclass(frozen=True, slots=True)
class Result:
    """What came of a run.

    Attributes:
        outcome: The referee's decision, or "refused" if the scenario is not valid.
        failure: The exception with its last lines, or what else went wrong; empty if nothing did.
        seconds: Simulated time, s.
        cpu_s: Processor time, s.
    """

    outcome: str
    failure: str
    seconds: float
    cpu_s: float


def draw_case(seed: int, number: int) -> Case:
    """Draw a run.

    Args:
        seed: Seed of a series of runs.
        number: Number of the run in its series.

    Returns:
        The run. It may turn out not to be valid; about one in eight is not.
    """
    rng = np.random.default_rng([seed, number])
    names = sorted(scenario_files())
    name, sets = str(rng.choice(names)), [f"time_limit_s={2.0 + 4.0 * rng.random() ** 3:.2f}"]
    if rng.random() < 0.35:
        name = "open"
        sets += _world(rng)
    if rng.random() < 0.4:
        sets += _movers(rng)
    if rng.random() < 0.6:
        count = int(rng.integers(1, 4))
        sets.append(f"faults=[{', '.join(_fault(rng) for _ in range(count))}]")
    if rng.random() < 0.25:
        sets.append("camera.enabled=true")
    if rng.random() < 0.15:
        rates = _RATES[int(rng.integers(len(_RATES)))]
        keys = ("physics_s", "control_s", "lidar_s", "plan_s")
        sets += [f"rates.{key}={value}" for key, value in zip(keys, rates, strict=True)]
        sets.append("camera.period_s=0.1")
    sets += _settings(rng, int(rng.integers(0, 5)))
    sets += _planner(rng)
    return Case(name, int(rng.integers(0, 1000)), tuple(sets))


def run_case(case: Case, patience_s: float = 60.0) -> Result:
    """Try a run.

    Args:
        case: The run.
        patience_s: Processor time after which the run is stopped and counts as failed, s.

    Returns:
        What came of it.
    """
    began = time.process_time()
    heard = _Listener()

    def progress(seconds: float, to_go_m: float) -> bool:
        heard.seconds = seconds
        return time.process_time() - began < patience_s

    try:
        scenario = load(case.scenario, case.overrides, seed=case.seed)
        simulation = Simulation(scenario, [heard])
    except InputError as error:
        wrong = "" if "\n" not in str(error) else "a message of several lines"
        return Result("refused", wrong, 0.0, time.process_time() - began)
    except Exception:
        return Result("failed", _last_lines(), 0.0, time.process_time() - began)
    try:
        outcome = simulation.run(progress).outcome
        name, failure = str(outcome.value), heard.failure
        if outcome is Outcome.INTERRUPTED:
            failure = f"took more than {patience_s:g} s for {heard.seconds:.2f} s"
    except Exception:
        name, failure = "failed", _last_lines()
    return Result(name, failure, heard.seconds, time.process_time() - began)


class _Listener:
    """Watches that belief and commands stay numbers."""

    def __init__(self) -> None:
        self.failure, self.seconds = "", 0.0

    def __call__(self, message: Published) -> None:
        if isinstance(message, Estimate):
            good = np.isfinite(message.state).all() and np.isfinite(message.covariance).all()
            self._note(bool(good), message.t_ns, "the belief is no number")
        elif isinstance(message, TrackCommand):
            good = np.isfinite(message.voltage_v).all()
            self._note(bool(good), message.t_ns, "the command is no number")

    def _note(self, good: bool, t_ns: int, text: str) -> None:
        if not good and not self.failure:
            self.failure = f"{text} at {t_ns * 1e-9:.2f} s"


def _last_lines() -> str:
    return "".join(traceback.format_exc(limit=-4)).strip()


def _table(**entries: Any) -> str:
    """Write an inline table of TOML."""
    return "{" + ", ".join(f"{key}={_value(value)}" for key, value in entries.items()) + "}"


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f"'{value}'"
    if isinstance(value, float):
        return f"{value:.6g}" if value % 1.0 or abs(value) > 1e15 else f"{value:.1f}"
    if isinstance(value, Sequence):
        return f"[{', '.join(_value(one) for one in value)}]"
    return str(value)


def _world(rng: np.random.Generator) -> list[str]:
    """Draw a generated world, or a few obstacles of every shape on an open floor."""
    side = float(rng.choice([4.0, 5.0, 7.0, 10.0]))
    ends = [f"start=[0.8,0.8,{rng.uniform(-3.2, 3.2):.3f}]", f"goal=[{side - 0.8},{side - 0.8}]"]
    if rng.random() < 0.3:
        boxes = []
        for _ in range(int(rng.integers(1, 8))):
            place = rng.uniform(1.6, max(1.7, side - 1.6), 2).round(2).tolist()
            shape = str(rng.choice(["box", "cylinder", "ellipse", "ell"]))
            size = {"box": [0.5, 0.2], "cylinder": [0.4], "ellipse": [0.6, 0.3]}.get(shape)
            boxes.append(
                _table(
                    shape=shape,
                    position_m=place,
                    size_m=size or [0.6, 0.5, 0.1],
                    yaw_rad=float(rng.uniform(-3.0, 3.0)),
                    height_m=float(rng.choice([0.02, 0.1, 0.35, 2.0])),
                )
            )
        bounds = f"bounds_m=[0.0,0.0,{side},{side}]"
        return [*ends, "arena=field", bounds, f"obstacles=[{', '.join(boxes)}]"]
    world = _table(
        kind=str(rng.choice(_KINDS if side < 8.0 else _KINDS[2:])),
        size_m=[side, side],
        width_m=float(rng.uniform(0.6, 1.5)),
        cell_m=float(rng.uniform(1.0, 4.0)),
        gaps_m=[float(g) for g in rng.uniform(0.55, 1.5, 3)],
        density=float(rng.uniform(0.0, 0.2)),
        loops=float(rng.uniform(0.0, 1.0)),
        count=int(rng.integers(1, 6)),
    )
    return [*ends, "arena=field", "may_be_closed_off=true", f"generator={world}"]


def _movers(rng: np.random.Generator) -> list[str]:
    """Draw a crowd, a few movers about the start, or a goal that moves."""
    kind = rng.random()
    if kind < 0.4:
        low, high = sorted(rng.uniform(0.0, 5.0, 2).tolist())
        crowd = _table(count=int(rng.integers(1, 20)), speed_mps=[low, high],
                       diameter_m=[0.05, float(rng.uniform(0.05, 1.5))])  # fmt: skip
        return [f"crowd={crowd}"]
    if kind < 0.6:
        motion = _table(motion=str(rng.choice(["constant", "walk"])), noise_m=float(rng.random()),
                        speed_mps=float(rng.uniform(0.0, 5.0)))  # fmt: skip
        return [f"goal_motion={motion}"]
    movers = []
    for _ in range(int(rng.integers(1, 6))):
        place = rng.uniform(-4.0, 6.0, 2).round(2).tolist()
        movers.append(
            _table(
                motion=str(rng.choice(_MOTIONS)),
                position_m=place,
                speed_mps=float(rng.uniform(0.0, 5.0)),
                turn_rad=float(rng.uniform(0.0, 10.0)),
                diameter_m=float(rng.choice([0.05, 0.3, 1.0, 5.0])),
            )
        )
    return [f"movers=[{', '.join(movers)}]"]


def _fault(rng: np.random.Generator) -> str:
    """Draw a fault of the first seconds; one in four lasts until the end."""
    low = rng.uniform(-5.0, 3.0, 2)
    keys: dict[str, dict[str, Any]] = {
        "encoder_stuck": {"side": str(rng.choice(["left", "right"]))},
        "encoders_silent": {},
        "gyro_jump": {"bias_radps": float(rng.uniform(-10.0, 10.0))},
        "imu_silent": {},
        "beams_dropped": {"share": float(rng.choice([0.5, 0.9, 0.98, 1.0]))},
        "glass": {"min_m": low.tolist(), "max_m": (low + rng.uniform(0.1, 20.0, 2)).tolist()},
        "lidar_noise": {"noise_m": float(rng.choice([1e-6, 0.03, 0.1, 1.0, 100.0]))},
        "lidar_short": {"range_m": float(rng.choice([0.01, 0.3, 1.0, 3.0, 100.0]))},
        "lidar_silent": {},
        "lidar_late": {"delay_s": float(rng.choice([0.01, 0.1, 0.3, 0.6, 2.0]))},
        "camera_silent": {},
        "ice": {"side": "left", "friction": float(rng.choice([1e-6, 0.05, 2.0]))},
        "pushed": {"shift_m": float(rng.uniform(-2.0, 2.0))},
        "kidnapped": {"to": rng.uniform(-1.0, 4.0, 3).tolist()},
    }
    kind = str(rng.choice(sorted(keys)))
    lasts = float(rng.choice([0.01, 0.5, 2.0, 0.0 if kind != "pushed" else 0.2]))
    start = float(rng.choice([0.0, rng.uniform(0.0, 4.0)]))
    return _table(kind=kind, at_s=start, for_s=lasts, **keys[kind])


def _settings(rng: np.random.Generator, count: int) -> list[str]:
    """Draw values of some settings: near the default, anywhere within the limits, or a limit."""
    known = numbers()
    texts = []
    for key in rng.choice(sorted(known), count, replace=False):
        default, least, most, whole = known[str(key)]
        draw = rng.random()
        if draw < 0.5:
            value = default * 10.0 ** rng.uniform(-1.0, 1.0) if default else rng.uniform(least, 1.0)
        elif draw < 0.7:
            low = max(least, 1e-9)
            value = math.exp(rng.uniform(math.log(low), math.log(max(most, 2.0 * low))))
        else:
            value = least if rng.random() < 0.5 else most
        value = min(max(float(value), least), most)
        texts.append(f"{key}={round(value) if whole else _value(value)}")
    return texts


@cache
def numbers() -> dict[str, tuple[float, float, float, bool]]:
    """List the numeric settings that are drawn.

    Returns:
        Key -> default, least and greatest value, and whether it is a whole number.
    """
    found = {}
    for section in fields(Config):
        kind: Any = type(getattr(Config(), section.name))
        for name, field in kind.__pydantic_fields__.items():
            key, default = f"{section.name}.{name}", field.default
            number = isinstance(default, int | float) and not isinstance(default, bool)
            if not number or key in _NOT_DRAWN:
                continue
            limits = {k: v for m in field.metadata for k, v in _limits(m).items()}
            least = max(limits.get("ge", -math.inf), limits.get("gt", -math.inf))
            most = min(limits.get("le", math.inf), limits.get("lt", math.inf))
            if "gt" in limits:
                least = max(least, 1e-9)
            most, least = min(most, _MOST.get(key, math.inf)), max(least, _LEAST.get(key, least))
            found[key] = (float(default), float(least), float(most), isinstance(default, int))
    return found


def _limits(constraint: Any) -> dict[str, float]:
    return {
        key: float(getattr(constraint, key))
        for key in ("ge", "gt", "le", "lt")
        if getattr(constraint, key, None) is not None
    }


def _planner(rng: np.random.Generator) -> list[str]:
    """Draw a planner; the lead planner in every second run, a slow one seldom."""
    if rng.random() < 0.5:
        return []
    name = str(rng.choice(registry.available()))
    if registry.info(name).slow and rng.random() < 0.8:
        return []
    latency = str(rng.choice(["fixed", "per_evaluation"]))
    return [f"planner.name={name}", f"planner.latency={latency}", "planner.max_evaluations=4000"]
