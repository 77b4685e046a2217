"""What is learnt about a log's odometry from the scans."""

from __future__ import annotations

import numpy as np
import pytest

from simloop.graph_slam.odometry_model import OdometryModel, Step
from simloop.graph_slam.settings import MappingConfig

STEP = np.array([0.5, 0.0, 0.1])
SURE, UNSURE_ALONG = np.array([0.001, 0.001, 0.001]), np.array([30.0, 30.0, 0.001])


def taught(error, count=300, known=SURE, kind=Step.RIGHT, spread=0.0):
    rng, model = np.random.default_rng(0), OdometryModel(MappingConfig())
    for _ in range(count):
        off = np.array(error) - model.correction(STEP) + spread * rng.standard_normal(3)
        model.learn(STEP, off, known, kind)
    return model


def test_at_first_the_assumed_deviations_count():
    model, config = OdometryModel(MappingConfig()), MappingConfig()
    xy, yaw = model.deviations(STEP)
    assert xy == pytest.approx(
        config.odometry_xy_m + 0.5 * config.odometry_xy_per_m + 0.1 * config.odometry_xy_per_rad
    )
    assert yaw > 0.0
    assert not model.correction(STEP).any()
    assert model.share(Step.RIGHT) > 0.9


def test_good_odometry_is_trusted_more_and_bad_odometry_less():
    assumed = OdometryModel(MappingConfig()).deviations(STEP)
    good, bad = taught([0, 0, 0], spread=0.005), taught([0, 0, 0], spread=0.3)
    for k in range(2):
        assert good.deviations(STEP)[k] < 0.6 * assumed[k]
        assert bad.deviations(STEP)[k] > 1.5 * assumed[k]


def test_an_error_in_every_step_is_corrected():
    drift = np.array([0.03, -0.01, 0.02])
    model = taught(drift)
    assert model.correction(STEP) == pytest.approx(drift, rel=0.1)
    assert model.correction(0.2 * STEP) == pytest.approx(0.2 * drift, rel=0.1)
    assert not model.correction(np.zeros(3)).any()


def test_a_match_that_does_not_know_the_place_teaches_nothing_about_it():
    model = taught([0.1, 0.0, 0.0], known=UNSURE_ALONG)
    assert not model.correction(STEP)[:2].any()
    assert model.deviations(STEP)[0] == OdometryModel(MappingConfig()).deviations(STEP)[0]


@pytest.mark.parametrize("kind", [Step.REVERSED, Step.WRONG])
def test_a_log_whose_counters_lie_is_known_for_it(kind):
    model = OdometryModel(MappingConfig())
    before = model.share(kind)
    for k in range(60):
        model.learn(STEP, np.zeros(3), SURE, kind if k % 3 == 0 else Step.RIGHT)
    assert model.share(kind) > 5.0 * before
    assert sum(model.share(one) for one in Step) == pytest.approx(1.0)
