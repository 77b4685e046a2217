"""The settings: what does not go together is refused, with the keys named."""

from __future__ import annotations

from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from simloop.common.quantities import to_ns
from simloop.config import Config, LidarConfig, RatesConfig

SLOW = ("control_s", "lidar_s", "plan_s")


def test_defaults_are_valid_and_sections_cannot_be_changed():
    config = Config()
    with pytest.raises(AttributeError):
        config.rates.control_s = 0.02


@given(st.sampled_from(SLOW[1:]), st.integers(1, 400), st.sampled_from([0.001, 0.004, 0.01]))
def test_whole_multiples_of_the_control_period_are_taken(name, factor, control_s):
    rates = RatesConfig(
        **({"physics_s": control_s, "control_s": control_s}
           | dict.fromkeys(SLOW[1:], control_s) | {name: factor * control_s})
    )  # fmt: skip
    assert to_ns(getattr(rates, name)) == factor * to_ns(control_s)


@pytest.mark.parametrize("name", SLOW)
def test_a_period_that_does_not_divide_is_refused_by_name(name):
    divisor = "physics_s" if name == "control_s" else "control_s"
    with pytest.raises(ValidationError, match=rf"rates\.{name} = .* rates\.{divisor}"):
        RatesConfig(**{name: 0.0117})


def test_division_is_checked_in_nanoseconds_not_in_floating_point():
    # 0.3 % 0.1 is 0.1 in floating point, yet three tenths are three times a tenth.
    assert RatesConfig(physics_s=0.01, control_s=0.1, lidar_s=0.3, plan_s=1.1)
    with pytest.raises(ValidationError, match=r"rates\.lidar_s"):
        RatesConfig(lidar_s=0.100_000_001)


@pytest.mark.parametrize("name", [field.name for field in fields(RatesConfig)])
@pytest.mark.parametrize("value", [0.0, -0.01, float("nan"), float("inf"), 1e-12])
def test_periods_are_positive_and_finite(name, value):
    with pytest.raises(ValidationError):
        RatesConfig(**{name: value})


def test_the_lidar_must_see_further_than_its_blind_zone():
    with pytest.raises(ValidationError, match=r"lidar\.range_min_m .* lidar\.range_max_m"):
        LidarConfig(range_min_m=2.0, range_max_m=1.0)
