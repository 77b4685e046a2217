"""Learn from a log how far its odometry can be trusted.

Logs differ: one robot's odometry is right to a centimetre in a metre, another's counters cannot
tell backwards from forwards. So the deviations of a step are scaled by what the matches of the last
scans have shown, and so is the share of steps in which odometry is entirely wrong.
"""

from __future__ import annotations

import math
from collections import deque
from enum import Enum, auto

import numpy as np

from simloop.graph_slam.settings import MappingConfig
from simloop.messages import FloatArray

_SCANS = 200  # the last scans that count
_LEAST_WAY = 0.02  # shorter steps tell nothing about a drift, m
_PRIOR = 20  # weight of the assumed deviations, in scans
_LEAST, _MOST = 0.4, 3.0  # bounds of the factor on the assumed deviations
_MEDIAN_PLANE, _MEDIAN_LINE = 1.1774, 0.6745  # of the normal distribution's radius and size


class Step(Enum):
    """What the odometry of a step was: right up to its noise, with the wrong sign, or anything."""

    RIGHT = auto()
    REVERSED = auto()
    WRONG = auto()


_ASSUMED = {Step.RIGHT: 0.96, Step.REVERSED: 0.02, Step.WRONG: 0.02}  # shares of steps


class OdometryModel:
    """Deviations of odometry's steps, scaled by what the scans have shown."""

    def __init__(self, config: MappingConfig) -> None:
        """Begin with the assumed deviations.

        Args:
            config: the mapper's settings.
        """
        self._config = config
        self._far: deque[float] = deque(maxlen=_SCANS)
        self._turned: deque[float] = deque(maxlen=_SCANS)
        self._drift_xy: deque[FloatArray] = deque(maxlen=_SCANS)
        self._drift_yaw: deque[FloatArray] = deque(maxlen=_SCANS)
        self._kinds: deque[Step] = deque(maxlen=_SCANS)

    def share(self, kind: Step) -> float:
        """Estimate how often the log's odometry is of a kind.

        Args:
            kind: what odometry was in a step.

        Returns:
            The share of steps, 0 to 1.
        """
        seen = sum(one is kind for one in self._kinds)
        return (seen + _PRIOR * _ASSUMED[kind]) / (len(self._kinds) + _PRIOR)

    def correction(self, motion: FloatArray) -> FloatArray:
        """Compute what a step lacks by the errors that the log's odometry makes in every step.

        Args:
            motion: (3,) the step by odometry, m, m, rad.

        Returns:
            (3,) what to add to the step.
        """
        drift = [*_usual(self._drift_xy, 2), *_usual(self._drift_yaw, 1)]
        return _way(motion) * np.array(drift)

    def deviations(self, motion: FloatArray) -> tuple[float, float]:
        """Compute the standard deviations of a step.

        Args:
            motion: (3,) the step by odometry, m, m, rad.

        Returns:
            Standard deviations of the position, per axis, m, and of the yaw, rad.
        """
        xy, yaw = self._assumed(motion)
        return xy * _factor(self._far, _MEDIAN_PLANE), yaw * _factor(self._turned, _MEDIAN_LINE)

    def learn(self, motion: FloatArray, error: FloatArray, known: FloatArray, kind: Step) -> None:
        """Add a step whose result is known.

        An error tells nothing in a direction in which the match does not know the pose better than
        odometry does, for instance along a bare corridor.

        Args:
            motion: (3,) the step by odometry.
            error: (3,) pose that was matched, in the frame of the predicted one, m, m, rad.
            known: (3,) standard deviations of the match, in the same frame.
            kind: what odometry was; the error is used only if it was right.
        """
        self._kinds.append(kind)
        if kind is not Step.RIGHT:
            return
        xy, yaw = self._assumed(motion)
        way, drift = _way(motion), error + self.correction(motion)
        if max(known[0], known[1]) < xy:
            self._far.append(math.hypot(error[0], error[1]) / xy)
            if way > _LEAST_WAY:
                self._drift_xy.append(drift[:2] / way)
        if known[2] < yaw:
            self._turned.append(abs(float(error[2])) / yaw)
            if way > _LEAST_WAY:
                self._drift_yaw.append(drift[2:] / way)

    def _assumed(self, motion: FloatArray) -> tuple[float, float]:
        config = self._config
        step, turn = math.hypot(motion[0], motion[1]), abs(float(motion[2]))
        xy = (
            config.odometry_xy_m
            + config.odometry_xy_per_m * step
            + config.odometry_xy_per_rad * turn
        )
        yaw = (
            config.odometry_yaw_rad
            + config.odometry_yaw_per_m * step
            + config.odometry_yaw_per_rad * turn
        )
        return xy, yaw


def _way(motion: FloatArray) -> float:
    """Return how much a step is, as a way in m; a turn of a radian counts as half a metre."""
    return math.hypot(motion[0], motion[1]) + 0.5 * abs(float(motion[2]))


def _usual(errors: deque[FloatArray], size: int) -> FloatArray:
    """Return the median (size,) of the errors, less if there are few of them."""
    if not errors:
        return np.zeros(size)
    return np.median(np.array(errors), axis=0) * len(errors) / (len(errors) + _PRIOR)


def _factor(errors: deque[float], median: float) -> float:
    """Return the robust deviation of normalised errors, with the prior, within the bounds."""
    assumed = np.full(_PRIOR, median)
    scale = float(np.median(np.concatenate([np.array(errors), assumed]))) / median
    return min(max(scale, _LEAST), _MOST)
