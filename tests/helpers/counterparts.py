"""Update rules of other libraries (mealpy, pymoo), set up as the same variants as ours.

Neither library has the bee colony of Karaboga & Basturk 2007 (mealpy moves all coordinates at
once), so that one is written out here, bee by bee.
"""

from __future__ import annotations

import numpy as np
from mealpy import AVOA, DE, TLO, FloatVar
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.algorithms.soo.nonconvex.pso import PSO
from pymoo.core.problem import Problem
from pymoo.core.selection import Selection
from pymoo.operators.crossover.sbx import SBX
from pymoo.operators.mutation.pm import PM
from pymoo.operators.sampling.rnd import FloatRandomSampling
from pymoo.optimize import minimize

SIZE, GENERATIONS = 20, 25


class VulturesThatRemember(AVOA.OriginalAVOA):
    """AVOA that keeps the two best vultures ever seen (Abdollahzadeh 2021, Eq. 1).

    mealpy only considers the present population.
    """

    def get_special_agents(self, pop=None, n_best=3, n_worst=3, minmax="min"):
        """Pick the best agents from the population and the memory.

        Args:
            pop: Agents of the present population.
            n_best: Number of best agents.
            n_worst: Number of worst agents.
            minmax: Whether the cost is minimised.

        Returns:
            None, the best agents, the worst agents, as mealpy expects.
        """
        known = list(pop) + getattr(self, "_memory", [])
        _, best, worst = super().get_special_agents(known, n_best, n_worst, minmax)
        self._memory = [agent.copy() for agent in best]
        return None, best, worst


def by_mealpy(model, objective, seed):
    """Run an optimiser of mealpy once.

    Args:
        model: The optimiser.
        objective: An `Objective`.
        seed: Seed of the run.

    Returns:
        Best value found.
    """
    bounds = FloatVar(lb=objective.low.tolist(), ub=objective.high.tolist())
    problem = {"bounds": bounds, "minmax": "min", "log_to": None}
    problem["obj_func"] = lambda x: cost_of(objective, x)
    mode = "swarm" if isinstance(model, DE.OriginalDE | AVOA.OriginalAVOA) else "single"
    return model.solve(problem, seed=seed, mode=mode).target.fitness


def cost_of(objective, x):
    """Evaluate one point.

    Args:
        objective: An `Objective`.
        x: (d,) point.

    Returns:
        Its cost.
    """
    out = np.empty(1)
    objective.costs(np.asarray(x, dtype=float)[None], out, np.full(1, np.inf))
    return float(out[0])


class TwoAtRandom(Selection):
    """Binary tournament with replacement; in pymoo's own all individuals compete equally often."""

    def _do(self, _, pop, n_select, n_parents=1, random_state=None, **kwargs):
        pairs = random_state.integers(0, len(pop), (n_select, n_parents, 2))
        cost = pop.get("F")[:, 0]
        first, second = pairs[..., 0], pairs[..., 1]
        return np.where(cost[first] <= cost[second], first, second)


def bee_colony(objective, seed):
    """Run the artificial bee colony once, without scouts: no food source is ever abandoned.

    Args:
        objective: An `Objective`.
        seed: Seed of the run.

    Returns:
        Best value found.
    """
    rng, low, high = np.random.default_rng(seed), objective.low, objective.high
    x = rng.uniform(low, high, (SIZE, len(low)))
    cost = np.array([cost_of(objective, row) for row in x])

    def forage(i):
        q, j = rng.choice([k for k in range(SIZE) if k != i]), rng.integers(len(low))
        there = x[i].copy()
        there[j] = np.clip(there[j] + rng.uniform(-1, 1) * (there[j] - x[q, j]), low[j], high[j])
        price = cost_of(objective, there)
        if price < cost[i]:
            x[i], cost[i] = there, price

    for _ in range(GENERATIONS):
        for i in range(SIZE):
            forage(i)
        fitness = 1.0 / (1.0 + cost)
        for i in rng.choice(SIZE, SIZE, p=fitness / fitness.sum()):
            forage(i)
    return cost.min()


class _Vectorised(Problem):
    def __init__(self, objective):
        super().__init__(n_var=len(objective.low), n_obj=1, xl=objective.low, xu=objective.high)
        self._objective = objective

    def _evaluate(self, x, out, *args, **kwargs):
        costs = np.empty(len(x))
        self._objective.costs(np.ascontiguousarray(x), costs, np.full(len(x), np.inf))
        out["F"] = costs


def by_pymoo(algorithm, objective, seed):
    """Run an algorithm of pymoo once; it counts the first population as a generation.

    Args:
        algorithm: The algorithm.
        objective: An `Objective`.
        seed: Seed of the run.

    Returns:
        Best value found.
    """
    found = minimize(
        _Vectorised(objective), algorithm, ("n_gen", 1 + GENERATIONS), seed=seed, verbose=False
    )
    return float(found.F[0])


# Name of a rule -> function of an objective and a seed that returns the best value found.
COUNTERPARTS = {
    "de": lambda f, s: by_mealpy(
        DE.OriginalDE(epoch=GENERATIONS, pop_size=SIZE, wf=0.5, cr=0.9, strategy=0), f, s
    ),
    "tlbo_paper": lambda f, s: by_mealpy(TLO.OriginalTLO(epoch=GENERATIONS, pop_size=SIZE), f, s),
    "avoa": lambda f, s: by_mealpy(
        VulturesThatRemember(
            epoch=GENERATIONS, pop_size=SIZE, p1=0.6, p2=0.4, p3=0.6, alpha=0.8, gama=2.5
        ),
        f,
        s,
    ),
    "abc": lambda f, s: bee_colony(f, s),
    "ga": lambda f, s: by_pymoo(
        GA(
            pop_size=SIZE,
            sampling=FloatRandomSampling(),
            selection=TwoAtRandom(),
            crossover=SBX(prob=0.9, eta=15),
            mutation=PM(prob=1.0, prob_var=1.0 / len(f.low), eta=20),
            eliminate_duplicates=False,
        ),
        f,
        s,
    ),
    "pso": lambda f, s: by_pymoo(
        PSO(
            pop_size=SIZE,
            sampling=FloatRandomSampling(),
            w=0.729,
            c1=1.49445,
            c2=1.49445,
            adaptive=False,
            initial_velocity="zero",
            max_velocity_rate=0.5,
            pertube_best=False,
        ),
        f,
        s,
    ),
}
