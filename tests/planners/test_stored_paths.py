"""The population planners find the paths that were stored when their objective was plain."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.population_paths import LED, SEEDS, load_paths, plan_all

_SAME_M = 1e-9


@pytest.fixture(scope="module")
def stored():
    paths = load_paths()
    if not paths:
        pytest.skip("this machine's mathematical functions round differently")
    return paths


def _seeds():
    """The first seed is quick; the others are slow."""
    marks = [pytest.param(s, marks=pytest.mark.slow) for s in SEEDS[1:]]
    return [SEEDS[0], *marks]


@pytest.mark.parametrize("seed", _seeds())
@pytest.mark.parametrize("name", LED)
def test_a_planner_still_finds_its_stored_paths(stored, name, seed):
    for key, plan in plan_all(name, seed):
        path, evaluations, generations = stored[key]
        assert (plan.evaluations, plan.generations) == (evaluations, generations), key
        np.testing.assert_allclose(plan.waypoints_m, path, rtol=0.0, atol=_SAME_M, err_msg=key)
