"""The lead paper's study of the weights: what w1 and w2 do to length, turning and J.

Source: Sabiha 2022 (online TLBO), Section 5.4: 38 plans, each with weights of its own; the Pareto
front of length against turning; partial least squares (PLS) of two components on w1, w2, J1, J2,
which is judged by its fit (R2) and, by cross-validation, by its forecast (Q2). Filled in: w2 is 1 -
w1, w1 goes evenly from .025 to .975, columns are scaled to unit variance, seven folds.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from simloop.benchmarks.planners.judge import judge
from simloop.benchmarks.planners.scenes import Instance
from simloop.benchmarks.planners.trials import plan_once, prepare
from simloop.common.errors import InputError
from simloop.config import PlannerConfig
from simloop.messages import FloatArray

COUNT, COMPONENTS, FOLDS = 38, 2, 7
NAMES = ("w1", "w2", "J1", "J2")
PRINTED = {"r2": 0.97, "q2": 0.93}
_LEAST, _MOST = 0.025, 0.975


@dataclass(frozen=True, slots=True, eq=False)
class Pls:
    """r2_x, r2_y: share of the variance of x and y that the components explain; q2: of y's, in
    plans left out. scores: (n, c). x_loadings: (p, c); y_loadings: (c,). vip: (p,)."""

    r2_x: float
    r2_y: float
    q2: float
    scores: FloatArray
    x_loadings: FloatArray
    y_loadings: FloatArray
    vip: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """w1: (n,). length_m, turning_rad, cost, safe: (n,), of the best of each weight's plans.
    front: (n,) whether a plan is on the Pareto front of all safe ones."""

    scene: str
    planner: str
    w1: FloatArray
    length_m: FloatArray
    turning_rad: FloatArray
    cost: FloatArray
    safe: np.ndarray
    front: np.ndarray
    pls: Pls


def study(instance: Instance, planner: str = "tlbo", count: int = COUNT, seed: int = 0) -> Study:
    """Plan once with each pair of weights, from seeds of their own, and analyse."""
    base = PlannerConfig(name=planner, safe_distance_m=instance.safe_m, start_turn_weight=0.0)
    w1 = np.linspace(_LEAST, _MOST, count)
    rows = []
    for number, share in enumerate(w1):
        config = replace(base, length_weight=float(share), turning_weight=1.0 - float(share))
        plan = plan_once(prepare(config), instance, seed + number)
        verdict = judge(instance, plan.waypoints_m)
        rows.append((verdict.length_m, verdict.turning_rad, verdict.success))
    length, turning = np.array([row[:2] for row in rows]).T
    safe = np.array([row[2] for row in rows])
    cost = w1 * length + (1.0 - w1) * turning
    x = np.column_stack([w1, 1.0 - w1, length, turning])
    return Study(
        scene=instance.name,
        planner=planner,
        w1=w1,
        length_m=length,
        turning_rad=turning,
        cost=cost,
        safe=safe,
        front=pareto(np.column_stack([length, turning]), safe),
        pls=fit(x, cost),
    )


def pareto(points: FloatArray, allowed: np.ndarray) -> np.ndarray:
    """(n,) whether nothing allowed is as small as a point (n, k) in all and smaller in one."""
    out = np.array(allowed, dtype=bool)
    for k, point in enumerate(points):
        others = points[allowed]
        beaten = (others <= point).all(axis=1) & (others < point).any(axis=1)
        out[k] &= not beaten.any()
    return out


def fit(x: FloatArray, y: FloatArray, components: int = COMPONENTS, folds: int = FOLDS) -> Pls:
    """PLS of y (n,) on x (n, p), columns scaled to unit variance. Folds take every ``folds``-th
    plan. A column that does not vary stays, and counts for nothing."""
    model = _model(x, y, components)
    scores, loadings = model.x_scores_, model.x_loadings_
    back = scores @ loadings.T
    scaled = _scaled(x, x)
    explained = (scores**2).sum(axis=0) * model.y_loadings_[0] ** 2
    squares = model.x_weights_**2
    weights = squares / np.maximum(squares.sum(axis=0), 1e-300)
    total = max(float(explained.sum()), 1e-300)
    predicted = np.empty(len(y))
    for fold in range(folds):
        out = np.arange(len(y)) % folds == fold
        predicted[out] = _model(x[~out], y[~out], components).predict(x[out]).ravel()
    return Pls(
        r2_x=_explained(scaled, back),
        r2_y=_explained(y, model.predict(x).ravel()),
        q2=_explained(y, predicted),
        scores=scores,
        x_loadings=loadings,
        y_loadings=model.y_loadings_[0],
        vip=np.sqrt(x.shape[1] * (weights * explained).sum(axis=1) / total),
    )


def _model(x: FloatArray, y: FloatArray, components: int) -> Any:
    try:
        library = importlib.import_module("sklearn.cross_decomposition")
    except ImportError:
        raise InputError(
            "the weight study needs the library scikit-learn: pip install 'simloop[report]'"
        ) from None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a component left with nothing to explain is zero
        return library.PLSRegression(n_components=components, scale=True).fit(x, y)


def _scaled(x: FloatArray, like: FloatArray) -> FloatArray:
    spread = like.std(axis=0, ddof=1)
    out: FloatArray = (x - like.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    return out


def _explained(truth: FloatArray, found: FloatArray) -> float:
    """1 - residual / total sum of squares about the mean."""
    total = max(float(((truth - truth.mean(axis=0)) ** 2).sum()), 1e-300)
    return 1.0 - float(((truth - found) ** 2).sum()) / total


def figures(done: Study) -> dict[str, Any]:
    """The study as JSON."""
    plain: dict[str, Any] = {
        key: value.tolist() if isinstance(value, np.ndarray) else value
        for key, value in asdict(done).items()
        if key != "pls"
    }
    model = {
        key: value.tolist() if isinstance(value, np.ndarray) else value
        for key, value in asdict(done.pls).items()
    }
    return {**plain, "pls": {**model, "variables": list(NAMES)}, "printed": PRINTED}


def rows(done: Study) -> Sequence[Sequence[str]]:
    """What the terminal shows: the model, then each variable."""
    model = done.pls
    out = [["R2 of x", f"{model.r2_x:.3f}", ""], ["R2 of J", f"{model.r2_y:.3f}", ".97 printed"]]
    out.append(["Q2 of J", f"{model.q2:.3f}", ".93 printed"])
    out += [[f"VIP {name}", f"{vip:.3f}", ""] for name, vip in zip(NAMES, model.vip, strict=True)]
    out.append(["plans on the Pareto front", str(int(done.front.sum())), f"of {len(done.w1)}"])
    return out
