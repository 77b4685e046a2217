"""The reference planners find the paths that were stored before they were made faster."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.reference_paths import EVALUATIONS, LIBRARIES, kept, load_paths, plan_all, seeds_of

_SAME_M = 1e-9


@pytest.mark.parametrize(
    ("name", "seed"), [(name, seed) for name in EVALUATIONS for seed in seeds_of(name)]
)
def test_a_reference_still_finds_its_stored_paths(name, seed):
    if name in LIBRARIES:
        pytest.importorskip(LIBRARIES[name])
    stored = load_paths(name)
    if not stored:
        pytest.skip("mathematical functions or the library differ from those of the stored paths")
    for key, plan in plan_all(name, seed):
        path, counts = stored[key]
        assert (len(plan.waypoints_m), plan.evaluations) == counts, key
        found = kept(plan.waypoints_m)
        np.testing.assert_allclose(found, path, rtol=0.0, atol=_SAME_M, err_msg=key)
