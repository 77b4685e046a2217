"""Compare trajectories in the plane: absolute and relative errors, computed by evo (Grupp 2017).

The absolute trajectory error (ATE) is the distance of each position from the true one, after the
best rigid alignment (Sturm et al. 2012). The relative pose error (RPE) is the length of the
translation from the true to the estimated motion over a part of the way. The robot never uses these
figures in a decision.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simloop.common.errors import InputError
from simloop.messages import FloatArray

RPE_M = (5.0, 20.0)
"""Lengths of way over which a trajectory is compared with a reference, m."""


@dataclass(frozen=True, slots=True)
class ReferenceErrors:
    """Errors of a trajectory against a reference.

    Attributes:
        ate_rmse_m: root mean square of the position errors after alignment.
        ate_max_m: the greatest of them.
        rpe_5m_median_m: median of the relative errors over 5 m of the reference's way; None if the
            way is shorter.
        rpe_20m_median_m: the same over 20 m.
        poses: number of poses compared.
    """

    ate_rmse_m: float
    ate_max_m: float
    rpe_5m_median_m: float | None
    rpe_20m_median_m: float | None
    poses: int

    def figures(self) -> dict[str, float | int | None]:
        """Return the values by name, for the JSON.

        Returns:
            Name to value.
        """
        return {name: getattr(self, name) for name in self.__slots__}


def check_evo(what: str) -> None:
    """Check that evo is installed.

    Args:
        what: What needs it, for the error message.

    Raises:
        InputError: If it is not installed.
    """
    try:
        import evo.core.metrics  # noqa: F401
    except ImportError:
        raise InputError(f"{what} compares by evo: pip install 'simloop[slam]'") from None


def aligned(found: FloatArray, reference: FloatArray) -> FloatArray:
    """Move a trajectory rigidly, without scale, so that its positions fit a reference best.

    Args:
        found: (n, 2) or (n, 3) x, y, and yaw if there; m, rad.
        reference: the same poses by the reference.

    Returns:
        The moved trajectory, of the same shape. The yaw is not wrapped.
    """
    from evo.core.geometry import GeometryException, umeyama_alignment

    try:
        turn, shift, _ = umeyama_alignment(found[:, :2].T, reference[:, :2].T)
    except GeometryException:  # all poses at one place
        turn, shift = np.eye(2), reference[:, :2].mean(axis=0) - found[:, :2].mean(axis=0)
    moved = np.array(found, np.float64)
    moved[:, :2] = found[:, :2] @ turn.T + shift
    moved[:, 2:] += np.arctan2(turn[1, 0], turn[0, 0])
    return moved


def absolute_errors(reference: FloatArray, found: FloatArray) -> FloatArray:
    """Compute the distance of each position from the reference's, after the best alignment.

    Args:
        reference: (n, 3) poses x, y, yaw, m, m, rad, n >= 1.
        found: (n, 3) the poses to measure, in any fixed frame.

    Returns:
        (n,) errors, m.
    """
    off = aligned(found, reference)[:, :2] - reference[:, :2]
    return np.asarray(np.hypot(off[:, 0], off[:, 1]))


def relative_errors(
    reference: FloatArray, found: FloatArray, over_m: float, along_reference: bool = True
) -> FloatArray:
    """Compute the translation errors of the motions over a length of way, from every pose on.

    Args:
        reference: (n, 3) poses x, y, yaw, m, m, rad.
        found: (n, 3) the poses to measure, in any fixed frame.
        over_m: length of way, m; evo takes the pose that is nearest to it, within 10 %.
        along_reference: whether the way is the reference's; else it is that of ``found``.

    Returns:
        (k,) errors, m; none if the way is too short.
    """
    from evo.core import filters, metrics

    measure = metrics.RPE(
        metrics.PoseRelation.translation_part,
        over_m,
        metrics.Unit.meters,
        all_pairs=True,
        pairs_from_reference=along_reference,
    )
    try:
        measure.process_data((_path(reference), _path(found)))
    except filters.FilterException:  # no two poses are so far apart
        return np.zeros(0)
    return np.asarray(measure.error, np.float64)


def rms(errors: FloatArray) -> float:
    """Compute the root mean square.

    Args:
        errors: (n,) values, n >= 1.

    Returns:
        Their root mean square.
    """
    return float(np.sqrt(np.mean(np.square(errors))))


def compare(reference: FloatArray, found: FloatArray) -> ReferenceErrors | None:
    """Measure a trajectory against a reference.

    Args:
        reference: (n, 3) poses of the reference, m, m, rad; NaN where there is none.
        found: (n, 3) estimated poses at the same instants; NaN where unknown.

    Returns:
        The errors; None if fewer than two instants have both poses.
    """
    both = in_both(reference, found)
    if np.count_nonzero(both) < 2:
        return None
    reference, found = reference[both], found[both]
    errors = absolute_errors(reference, found)
    over = [relative_errors(reference, found, length) for length in RPE_M]
    medians = [float(np.median(some)) if len(some) else None for some in over]
    return ReferenceErrors(rms(errors), float(errors.max()), medians[0], medians[1], len(reference))


def in_both(reference: FloatArray, found: FloatArray) -> NDArray[np.bool_]:
    """Find the instants with a pose in both trajectories.

    Args:
        reference: (n, 3) poses; NaN where there is none.
        found: (n, 3) poses; NaN where there is none.

    Returns:
        (n,) whether both poses are finite.
    """
    return np.asarray((np.isfinite(reference) & np.isfinite(found)).all(axis=1))


def _path(poses: FloatArray) -> Any:
    """Convert poses (n, 3) to a path of evo."""
    from evo.core.trajectory import PosePath3D

    half, zero = 0.5 * poses[:, 2], np.zeros(len(poses))
    return PosePath3D(
        positions_xyz=np.column_stack([poses[:, :2], zero]),
        orientations_quat_wxyz=np.column_stack([np.cos(half), zero, zero, np.sin(half)]),
    )
