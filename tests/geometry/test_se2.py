"""SE(2) against homogeneous matrices, and the corners of angle wrapping."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from simloop.geometry import se2
from simloop.messages import FloatArray

_METRES = st.floats(-50.0, 50.0)
_ANGLES = st.floats(-20.0, 20.0)
_POSES = st.tuples(_METRES, _METRES, _ANGLES).map(lambda pose: np.array(pose))


def _matrix(pose: FloatArray) -> FloatArray:
    """The 3x3 homogeneous matrix: the obvious version of every function here."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.array([[cos, -sin, pose[0]], [sin, cos, pose[1]], [0.0, 0.0, 1.0]])


@given(st.floats(-1e6, 1e6))
def test_wrap_angle_is_in_range_and_congruent(angle: float) -> None:
    wrapped = se2.wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    turns = (angle - wrapped) / (2.0 * math.pi)
    assert abs(turns - round(turns)) < 1e-9
    assert se2.wrap_angles(np.array([angle]))[0] == wrapped


def test_wrap_angle_at_the_seam() -> None:
    assert se2.wrap_angle(math.pi) == math.pi
    assert se2.wrap_angle(-math.pi) == math.pi
    assert se2.wrap_angle(3.0 * math.pi) == math.pi
    beyond = np.nextafter(math.pi, 4.0)
    assert -math.pi < se2.wrap_angle(beyond) < 0.0
    assert se2.wrap_angles(np.array([-math.pi, 3.5 * math.pi])).tolist() == [
        math.pi,
        se2.wrap_angle(3.5 * math.pi),
    ]


@given(_POSES, _POSES)
def test_compose_is_the_matrix_product(a: FloatArray, b: FloatArray) -> None:
    np.testing.assert_allclose(_matrix(se2.compose(a, b)), _matrix(a) @ _matrix(b), atol=1e-11)


@given(_POSES)
def test_inverse_is_the_matrix_inverse(pose: FloatArray) -> None:
    np.testing.assert_allclose(_matrix(se2.inverse(pose)) @ _matrix(pose), np.eye(3), atol=1e-11)


@given(_POSES, _POSES)
def test_between_leads_from_one_to_the_other(a: FloatArray, b: FloatArray) -> None:
    np.testing.assert_allclose(_matrix(se2.compose(a, se2.between(a, b))), _matrix(b), atol=1e-10)


@given(_POSES, _POSES, st.floats(0.0, 1.0))
def test_interpolation_takes_the_short_way(a: FloatArray, b: FloatArray, fraction: float) -> None:
    middle = np.array(se2.interpolate_xyt(*a, *b, fraction))
    np.testing.assert_allclose(middle[:2], a[:2] + fraction * (b[:2] - a[:2]), atol=1e-12)
    whole = se2.wrap_angle(b[2] - a[2])
    assert abs(se2.wrap_angle(middle[2] - a[2] - fraction * whole)) < 1e-12
    assert -math.pi < middle[2] <= math.pi


def test_interpolation_across_the_seam() -> None:
    a, b = np.array([0.0, 0.0, 3.1]), np.array([0.0, 0.0, -3.1])
    assert abs(se2.interpolate_xyt(*a, *b, 0.5)[2] - math.pi) < 1e-12


@given(_POSES, st.lists(st.tuples(_METRES, _METRES), min_size=1, max_size=5))
def test_transform_points(pose: FloatArray, raw: list[tuple[float, float]]) -> None:
    points = np.array(raw)
    homogeneous = np.column_stack((points, np.ones(len(points))))
    expected = (homogeneous @ _matrix(pose).T)[:, :2]
    np.testing.assert_allclose(se2.transform_points(pose, points), expected, atol=1e-11)
