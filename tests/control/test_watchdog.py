"""The watchdog: slows down and stops for what is old, says why, and goes on when it is fresh."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.tracking import DRIVE, MONITOR, arbiter_of, situation
from hypothesis import given, settings
from hypothesis import strategies as st

from simloop.config import RatesConfig, WatchdogConfig
from simloop.control.watchdog import Stale, StandingCounts, Watchdog
from simloop.loop import Simulation
from simloop.messages import (
    EncoderReading,
    Event,
    HealthReason,
    Plan,
    TrackCommand,
    Velocity,
)
from simloop.scenario.load import load
from simloop.truth import Truth

RATES, CONFIG = RatesConfig(), WatchdogConfig()
TICK_NS = 10_000_000
PATH_NS = round(CONFIG.path_frames * RATES.plan_s * 1e9)


def watchdog():
    return Watchdog(CONFIG, RATES)


def looked(reasons=(), path_age_ns=None, lag_ns=0):
    """A watchdog after two periods, and the event of the second."""
    it = watchdog()
    assert it.check(PATH_NS, (), None) is None
    now = PATH_NS + TICK_NS - lag_ns
    return it, it.check(now, reasons, None if path_age_ns is None else now - path_age_ns)


@pytest.mark.parametrize(
    ("given_", "cause", "stops"),
    [
        ({}, "", False),
        ({"path_age_ns": PATH_NS}, "", False),
        ({"path_age_ns": PATH_NS + 1}, Stale.OLD_PATH, True),
        ({"lag_ns": 50_000_000}, "", False),
        ({"lag_ns": 60_000_000}, Stale.LATE, True),
        ({"reasons": (HealthReason.NO_IMU,)}, "", False),
        ({"reasons": (HealthReason.LEFT_BELT,)}, "", False),
        ({"reasons": (HealthReason.LEFT_BELT, HealthReason.RIGHT_BELT)}, Stale.NO_BELTS, False),
        ({"reasons": (HealthReason.NO_COUNTS,)}, Stale.NO_BELTS, False),
        ({"reasons": (HealthReason.THIN,)}, Stale.THIN, False),
        ({"reasons": (HealthReason.THIN, HealthReason.SLIDES)}, Stale.SLIPPERY, False),
        ({"reasons": (HealthReason.NO_COUNTS, HealthReason.NO_IMU)}, Stale.NO_MOTION_SENSOR, True),
    ],
)
def test_what_is_too_old_and_what_follows(given_, cause, stops):
    it, event = looked(**given_)
    assert (it.cause, it.stops) == (cause, stops)
    assert (event is None) == (not cause)
    if event is not None:
        assert event.level == "warning" and cause in event.text
        assert ("stopping" in event.text) == stops


def test_it_says_so_once_and_again_when_all_is_fresh():
    it = watchdog()
    said = [
        it.check(t * TICK_NS, (HealthReason.NO_COUNTS,) if 5 <= t < 20 else (), None)
        for t in range(1, 40)
    ]
    texts = [event.text for event in said if event is not None]
    assert len(texts) == 2 and "slowing" in texts[0] and "going on" in texts[1]


def braked(speed, rate, reasons, ticks=200):
    """The velocities (ticks, 2) chosen of one that is asked for again and again."""
    it, arbiter = watchdog(), arbiter_of()
    it.check(TICK_NS, (), None)
    last, out = Velocity(speed, rate), []
    for tick in range(2, ticks + 2):
        it.check(tick * TICK_NS, reasons, None)
        now = situation(t_ns=tick * TICK_NS, speed_cap_mps=it.speed_cap_mps)
        last, _ = arbiter.choose(Velocity(speed, rate), last, now)
        out.append(last)
    return np.array(out)


speeds, rates = st.floats(-0.45, 0.45), st.floats(-1.6, 1.6)


@given(speeds, rates)
@settings(max_examples=100)
def test_it_brakes_within_what_the_monitor_assumes(speed, rate):
    """Noticed 60 ms late, the stop is still no longer than the one that was found to be free."""
    out = braked(speed, rate, (HealthReason.NO_COUNTS, HealthReason.NO_IMU))
    assert (np.abs(np.diff(out, axis=0, prepend=[[speed, rate]])).T >= -1e-12).all()
    assert np.abs(out[-1]).max() == 0.0
    braking = max(abs(speed) / DRIVE.max_decel_mps2, abs(rate) / DRIVE.max_yaw_accel_radps2)
    lasts = MONITOR.reaction_s + 0.5 * braking
    way, turn = 0.01 * np.abs(out).sum(axis=0)
    assert way + 0.06 * abs(speed) <= abs(speed) * lasts + 1e-9
    assert turn + 0.06 * abs(rate) <= abs(rate) * lasts + 1e-9


@given(speeds, rates)
@settings(max_examples=100)
def test_without_counts_it_slows_down_to_what_is_set_and_never_speeds_up(speed, rate):
    out = braked(speed, rate, (HealthReason.NO_COUNTS,))
    assert abs(out[-1, 0]) <= CONFIG.unheard_mps + 1e-9
    assert (np.diff(np.abs(out), axis=0) <= 1e-12).all()
    slow = abs(speed) <= CONFIG.unheard_mps and abs(rate) <= 0.5
    assert not slow or tuple(out[-1]) == (speed, rate)


@given(speeds, rates)
def test_with_all_fresh_nothing_is_changed(speed, rate):
    assert (braked(speed, rate, (), ticks=3) == (speed, rate)).all()


def test_counts_that_stand_while_the_belts_are_driven_are_not_believed():
    it, fast, heard = StandingCounts(), np.array([3.0, 3.0]), []
    for tick in range(60):
        counts = min(tick, 20) if tick < 40 else tick
        heard.append(it.believed(EncoderReading(tick * TICK_NS, counts, counts), fast).t_ns)
    ages = np.arange(60) - np.array(heard) // TICK_NS
    assert not ages[:29].any() and not ages[40:].any()
    assert ages[39] == 19


@pytest.mark.parametrize("asked", [(0.0, 0.0), (3.0, 0.0), (1.0, 1.0)])
def test_counts_of_belts_that_are_not_driven_may_stand(asked):
    it = StandingCounts()
    for tick in range(60):
        reading = EncoderReading(tick * TICK_NS, 5, 5)
        assert it.believed(reading, np.array(asked)) is reading


def test_one_belt_that_turns_vouches_for_the_other():
    it = StandingCounts()
    for tick in range(60):
        reading = EncoderReading(tick * TICK_NS, tick, 5)
        assert it.believed(reading, np.array([3.0, 3.0])) is reading


def drive(name, *overrides, seed=0):
    """A run's result, its texts with their seconds, and its true speeds (n,), m/s."""
    texts, speeds, commands, plans = [], [], [], []

    def hear(message):
        if isinstance(message, Event):
            texts.append((message.t_ns * 1e-9, message.text))
        elif isinstance(message, Truth):
            speeds.append(abs(float(message.velocity_body[0])))
        elif isinstance(message, TrackCommand):
            commands.append(message)
        elif isinstance(message, Plan):
            plans.append(message)

    result = Simulation(load(name, overrides, seed=seed), [hear]).run()
    return result, texts, np.array(speeds), commands, plans


def when(texts, what):
    return [t for t, text in texts if what in text]


def test_with_a_planner_that_takes_ten_seconds_it_stops_and_goes_on_with_each_new_path():
    result, texts, speeds, commands, _ = drive(
        "faults", "planner.latency_s=10.0", "time_limit_s=30.0"
    )
    stopped, again = when(texts, Stale.OLD_PATH), when(texts, "going on")
    assert stopped and again and result.metrics["contact_count"] == 0
    assert stopped[0] == pytest.approx(10.1 + 1e-9 * PATH_NS, abs=0.05)
    still = speeds[round(100 * stopped[0]) + 80 : round(100 * again[0]) - 1]
    assert len(still) > 300 and still.max() < 1e-3
    assert speeds[round(100 * again[0]) :].max() > 0.3
    assert not when(texts, "stuck")  # who waits is not stuck
    assert {c.mode for c in commands if stopped[0] + 0.5 < c.t_ns * 1e-9 < again[0]} == {"wait"}


def test_a_planner_that_is_only_slow_is_waited_for_by_nobody():
    _, texts, *_ = drive("faults", "planner.latency_s=1.34", "time_limit_s=15.0")
    assert not when(texts, "watchdog")


def test_when_scans_stop_it_stands_within_the_monitors_assumption_and_goes_on():
    fault = '{kind="lidar_silent", at_s=4.0, for_s=2.0}'
    result, texts, speeds, *_ = drive("faults", f"faults=[{fault}]")
    assert result.reached and result.metrics["contact_count"] == 0
    said = when(texts, "no scans")[0]
    assert 4.2 < said < 4.35
    assert speeds[round(100 * said)] > 0.3
    assumed = MONITOR.reaction_s * 0.45 + 0.45**2 / (2.0 * DRIVE.max_decel_mps2)
    assert 0.01 * speeds[round(100 * said) : 590].sum() < 0.5 * assumed
    assert speeds[round(100 * said) + 50 : 590].max() < 1e-3


def test_after_long_without_scans_it_plans_at_once_for_the_path_has_grown_old():
    fault = '{kind="lidar_silent", at_s=4.0, for_s=7.0}'
    result, _, _, _, plans = drive("faults", f"faults=[{fault}]")
    assert result.reached
    first = next(p for p in plans if p.t_ns >= 11_000_000_000)
    assert first.reason in ("stale", "frame", "blocked") and first.t_ns < 11_100_000_000


@pytest.mark.parametrize("at_s", [0.0, 4.0])
def test_when_both_encoders_freeze_it_goes_on_slowly_and_arrives(at_s):
    stuck = [f'{{kind="encoder_stuck", at_s={at_s}, side="{side}"}}' for side in ("left", "right")]
    result, texts, speeds, *_ = drive("faults", f"faults=[{', '.join(stuck)}]")
    assert result.reached and result.metrics["contact_count"] == 0
    said = when(texts, Stale.NO_BELTS)[0]
    assert at_s + 0.1 < said < at_s + 0.5
    assert speeds[round(100 * said) + 50 :].max() < 0.25
    assert result.metrics["ate_rmse_m"] < 0.01


def test_when_counts_are_silent_for_a_while_it_slows_down_for_that_while():
    fault = '{kind="encoders_silent", at_s=4.0, for_s=2.0}'
    result, texts, speeds, *_ = drive("faults", f"faults=[{fault}]")
    assert result.reached
    slow, again = when(texts, Stale.NO_BELTS)[0], when(texts, "going on")[0]
    assert slow == pytest.approx(4.05, abs=0.03)
    assert speeds[round(100 * slow) + 50 : round(100 * again)].max() < 0.25
    assert speeds[round(100 * again) :].max() > 0.4


def test_when_neither_counts_nor_imu_come_it_stands_until_they_do():
    silent = [f'{{kind="{k}_silent", at_s=4.0, for_s=1.0}}' for k in ("encoders", "imu")]
    result, texts, speeds, *_ = drive("faults", f"faults=[{', '.join(silent)}]")
    assert result.reached and result.metrics["contact_count"] == 0
    stopped, again = when(texts, Stale.NO_MOTION_SENSOR)[0], when(texts, "going on")[0]
    assert stopped == pytest.approx(4.05, abs=0.03)
    assert speeds[round(100 * stopped) + 60 : round(100 * again)].max() < 0.01
