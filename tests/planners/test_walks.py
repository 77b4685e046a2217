"""The step-by-step planners walk as they always did: every path is the stored one.

`walks` says what is stored and how it was made.
"""

from __future__ import annotations

import numpy as np
import pytest
from helpers import walks
from helpers.population_paths import rounds_as_stored

QUICK = [case for case in walks.CASES if case.endswith("/1000") and "/narrow/" not in case]


def check(case):
    if not rounds_as_stored():
        pytest.skip("this machine's mathematical functions round differently")
    with np.load(walks.STORED) as stored:
        points, figures = stored[f"{case}/points"], stored[f"{case}/figures"]
    found_points, found_figures = walks.digest(*walks.walk(case))
    np.testing.assert_allclose(found_figures, figures, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found_points, points, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("case", QUICK)
def test_a_walk_is_the_stored_one(case):
    check(case)


@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in walks.CASES if case not in QUICK])
def test_every_walk_is_the_stored_one(case):
    check(case)
