"""Study of the weights from the lead paper: the effect of w1 and w2 on length, turning and J.

Source: Sabiha 2022 (online TLBO), Section 5.4. The study makes 38 plans, each with its own weights,
and the Pareto front of length and turning. It fits a partial least squares (PLS) model of two
components on w1, w2, J1 and J2. The model is rated by its goodness of fit (R2) and, by
cross-validation, of prediction (Q2).

Chosen here: w2 = 1 - w1, w1 evenly spaced from 0.025 to 0.975, columns scaled to unit variance,
seven folds.
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
    """A partial least squares model of n plans with p variables and c components.

    Attributes:
        r2_x: Share of the variance of x that the components explain.
        r2_y: Share of the variance of y.
        q2: Share of the variance of y in plans that are left out of the fit.
        scores: (n, c) scores of the plans.
        x_loadings: (p, c) loadings of the variables.
        y_loadings: (c,) loadings of y.
        vip: (p,) variable importance in projection.
    """

    r2_x: float
    r2_y: float
    q2: float
    scores: FloatArray
    x_loadings: FloatArray
    y_loadings: FloatArray
    vip: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """Plans with n pairs of weights, and their analysis.

    Attributes:
        scene: Name of the task.
        planner: Name of the planner.
        w1: (n,) weight of the length; w2 is 1 - w1.
        length_m: (n,) length of each plan, m.
        turning_rad: (n,) turning of each plan, rad.
        cost: (n,) J of each plan with its own weights.
        safe: (n,) whether each plan is safe and reaches the goal.
        front: (n,) whether each plan is on the Pareto front of the safe plans.
        pls: The model of ``cost``.
    """

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
    """Plan once with each pair of weights and analyse the plans.

    Args:
        instance: The task.
        planner: Name of the planner.
        count: Number of pairs.
        seed: Seed of the first plan; the others count up from it.

    Returns:
        The plans and their analysis.

    Raises:
        InputError: scikit-learn is not installed.
    """
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
    """Find the Pareto front of criteria that are all minimised.

    Args:
        points: (n, k) criteria of each point.
        allowed: (n,) whether each point takes part.

    Returns:
        (n,) whether no other point dominates a point.
    """
    out = np.array(allowed, dtype=bool)
    for k, point in enumerate(points):
        others = points[allowed]
        beaten = (others <= point).all(axis=1) & (others < point).any(axis=1)
        out[k] &= not beaten.any()
    return out


def fit(x: FloatArray, y: FloatArray, components: int = COMPONENTS, folds: int = FOLDS) -> Pls:
    """Fit a partial least squares model with columns scaled to unit variance.

    Args:
        x: (n, p) variables; a constant column is allowed and has no influence.
        y: (n,) the variable to explain.
        components: Number of components.
        folds: Parts of the cross-validation; each takes every ``folds``-th row.

    Returns:
        The model.

    Raises:
        InputError: scikit-learn is not installed.
    """
    model = _model(x, y, components)
    # R2 of x: how well scores and loadings reproduce the scaled variables.
    scores, loadings = model.x_scores_, model.x_loadings_
    back = scores @ loadings.T
    scaled = _scaled(x, x)
    # VIP: mean of the squared weights, each component by its share of the explained variance of y.
    explained = (scores**2).sum(axis=0) * model.y_loadings_[0] ** 2
    squares = model.x_weights_**2
    weights = squares / np.maximum(squares.sum(axis=0), 1e-300)
    total = max(float(explained.sum()), 1e-300)
    # Q2: each row is predicted by a model that was fitted without it.
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
    """Fit scikit-learn's PLS regression."""
    try:
        library = importlib.import_module("sklearn.cross_decomposition")
    except ImportError:
        raise InputError(
            "the weight study needs the library scikit-learn: pip install 'simloop[report]'"
        ) from None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a component with nothing left to explain is zero
        return library.PLSRegression(n_components=components, scale=True).fit(x, y)


def _scaled(x: FloatArray, like: FloatArray) -> FloatArray:
    """Scale x (n, p) with the means and deviations of the columns of ``like``."""
    spread = like.std(axis=0, ddof=1)
    out: FloatArray = (x - like.mean(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    return out


def _explained(truth: FloatArray, found: FloatArray) -> float:
    """Compute 1 - residual sum of squares / total sum of squares about the mean."""
    total = max(float(((truth - truth.mean(axis=0)) ** 2).sum()), 1e-300)
    return 1.0 - float(((truth - found) ** 2).sum()) / total


def figures(done: Study) -> dict[str, Any]:
    """Convert the study to plain types.

    Args:
        done: The study.

    Returns:
        What ``simloop bench weights --json`` writes.
    """
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
    """Format the study as rows of a table for the terminal.

    Args:
        done: The study.

    Returns:
        Name, measured value and remark: first the model, then each variable.
    """
    model = done.pls
    out = [["R2 of x", f"{model.r2_x:.3f}", ""], ["R2 of J", f"{model.r2_y:.3f}", "0.97 printed"]]
    out.append(["Q2 of J", f"{model.q2:.3f}", "0.93 printed"])
    out += [[f"VIP {name}", f"{vip:.3f}", ""] for name, vip in zip(NAMES, model.vip, strict=True)]
    out.append(["plans on the Pareto front", str(int(done.front.sum())), f"of {len(done.w1)}"])
    return out
