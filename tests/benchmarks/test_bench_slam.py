"""The mapper's benchmark: courses that can be driven, and figures of a short drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from simloop.benchmarks.slam import measure, run, summarise
from simloop.benchmarks.slam_courses import COURSES
from simloop.benchmarks.slam_drive import drive
from simloop.common.errors import InputError

ROBOT_M = 0.34  # from its middle to a corner


def clearance(course):
    """Least distance from the route to any box, m."""
    points = np.concatenate(
        [a + np.linspace(0, 1, 60)[:, None] * (b - a)
         for a, b in zip(course.route_m[:-1], course.route_m[1:], strict=True)]
    )  # fmt: skip
    least = np.inf
    for x, y, dx, dy in course.boxes:
        off = np.abs(points - [x, y]) - [0.5 * dx, 0.5 * dy]
        least = min(least, np.hypot(*np.maximum(off, 0.0).T).min())
    return least


@pytest.mark.parametrize("name", COURSES)
@pytest.mark.parametrize("seed", [0, 7, 1003])
def test_a_course_leaves_room_for_the_robot_all_along(name, seed):
    course = COURSES[name](np.random.default_rng(seed))
    again = COURSES[name](np.random.default_rng(seed))
    assert course.boxes == again.boxes
    assert clearance(course) > ROBOT_M + 0.1


def test_the_loop_is_sixty_metres_and_the_office_has_all_its_rooms():
    loop = COURSES["loop"](np.random.default_rng(1))
    assert np.hypot(*np.diff(loop.route_m[:-1], axis=0).T).sum() == pytest.approx(60.0 - 7.5 + 0.0)
    office = COURSES["office"](np.random.default_rng(1))
    rooms = {tuple(np.floor((corner + 10.0) / 5.0).astype(int)) for corner in office.route_m[::2]}
    assert len(rooms) == 16


def test_a_drive_is_mapped_and_measured_against_the_truth():
    course = COURSES["room"](np.random.default_rng(2))
    driven = drive(replace(course, route_m=course.route_m[:3]), 2)
    figures = measure(driven)
    assert figures["finished"] and figures["way_m"] == pytest.approx(9.0, abs=1.0)
    assert figures["ate_rmse_m"] < 0.01 and figures["ate_from_start_m"] < 0.01
    assert figures["map_iou"] > 0.9 and figures["surface_p95_m"] < 0.03
    shifted = replace(driven, truth=driven.truth + np.linspace(0, 0.3, len(driven.truth))[:, None])
    assert measure(shifted)["ate_rmse_m"] > 0.05


def test_an_unknown_course_is_refused():
    with pytest.raises(InputError, match="did you mean 'office'"):
        run(["ofice"])


def test_a_summary_tells_whether_covariances_are_consistent():
    def row(nees):
        return {"course": "loop", "nees_mean": nees, "ate_rmse_m": nees, "ate_from_start_m": 0.0}

    (consistent,) = summarise([row(nees) for nees in (1.0, 3.0, 5.0, 3.0)])
    assert consistent["consistent"] and consistent["nees_mean"] == 3.0
    assert consistent["ate_rmse_max_m"] == 5.0
    assert consistent["nees_band"] == pytest.approx(
        [1.101, 5.834], abs=0.001
    )  # chi-square of 12 / 4
    for nees in (1.0, 6.0):
        assert not summarise([row(nees)] * 4)[0]["consistent"]


@pytest.mark.slow
def test_the_mapper_is_accurate_and_consistent_on_the_loop_over_fifty_seeds():
    (summary,) = run(["loop"], range(50))["summary"]
    assert summary["consistent"], summary
    assert summary["ate_from_start_max_m"] < 0.05
