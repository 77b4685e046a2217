"""The watchdog: what the robot drives by must be fresh; where it is not, its speed is capped.

Missing scans and a pose that is not to be believed halt the robot by themselves (``Health``). The
watchdog looks after the rest: the path, which stays as it was if a planner hangs; the estimate,
which may fall behind the robot's own beat or have nothing left to go by between two scans; and the
belts' counts, without which speed is not measured. The cap is lifted when all is fresh again.
"""

from __future__ import annotations

import math
from enum import StrEnum

from simloop.config import RatesConfig, WatchdogConfig
from simloop.messages import (
    EncoderReading,
    Event,
    FloatArray,
    HealthReason,
)


class Stale(StrEnum):
    """What is not fresh."""

    NOTHING = ""
    OLD_PATH = "no new path from the planner"
    NO_MOTION_SENSOR = "neither counts nor imu readings"
    BLIND = "no image from the camera"
    LATE = "the estimate lags behind"
    NO_BELTS = "no belt is heard"
    THIN = "many beams do not come back"
    SLIPPERY = "the ground is slippery"


_SLOWING = (Stale.NO_BELTS, Stale.THIN, Stale.SLIPPERY)
_BOTH_BELTS = {HealthReason.LEFT_BELT, HealthReason.RIGHT_BELT}
_DRIVEN_RADPS = 1.4  # of both sprockets: 5 cm/s, two counts a period
_STANDING_TICKS = 10  # twenty counts that have not come
_AT_REST_TICKS = 30


class StandingCounts:
    """Treats counts as missing if both belts are driven and no counts change.

    Fresh stamps would make the robot believe that it stands, and drive its motors harder.
    """

    def __init__(self) -> None:
        self._heard: EncoderReading | None = None
        self._stands = self._rests = 0

    def believed(self, reading: EncoderReading, sprocket_radps: FloatArray) -> EncoderReading:
        """Say which reading to believe.

        Args:
            reading: The latest one.
            sprocket_radps: (2,) sprocket speeds that were asked for in the last period, rad/s.

        Returns:
            The reading; while the counts stand, the last one that moved, with its old stamp.
        """
        last = self._heard
        if last is None or (reading.left_counts, reading.right_counts) != (
            last.left_counts,
            last.right_counts,
        ):
            self._heard, self._stands = reading, 0
            return reading
        left, right = sprocket_radps.tolist()
        driven = min(abs(left), abs(right))
        self._rests = 0 if left or right else self._rests + 1
        if driven > _DRIVEN_RADPS:
            self._stands += 1
        elif self._stands < _STANDING_TICKS or self._rests > _AT_REST_TICKS:
            self._stands = 0
        return last if self._stands >= _STANDING_TICKS else reading


class Watchdog:
    """Looks once a control period whether everything is fresh.

    Attributes:
        cause: What is not fresh.
    """

    def __init__(self, config: WatchdogConfig, rates: RatesConfig) -> None:
        self._config, self._period_ns = config, round(rates.control_s * 1e9)
        self._path_ns = round(config.path_frames * rates.plan_s * 1e9)
        self._late_ns = round(config.estimate_s * 1e9)
        self._image_ns = round(config.image_s * 1e9)
        self._beat_ns: int | None = None
        self.cause = Stale.NOTHING

    @property
    def stops(self) -> bool:
        """Whether the robot must stop."""
        return self.cause is not Stale.NOTHING and self.cause not in _SLOWING

    @property
    def speed_cap_mps(self) -> float:
        """The largest speed that is permitted, m/s; infinite while all is fresh."""
        if self.cause is Stale.NOTHING:
            return math.inf
        if self.stops:
            return 0.0
        config = self._config
        return {Stale.THIN: config.thin_mps, Stale.SLIPPERY: config.slippery_mps}.get(
            self.cause, config.unheard_mps
        )

    def check(
        self,
        t_ns: int,
        reasons: tuple[str, ...],
        path_ns: int | None,
        image_ns: int | None = None,
    ) -> Event | None:
        """Look at the ages of everything in this period.

        Args:
            t_ns: The estimate's stamp, ns.
            reasons: ``Health.reasons``.
            path_ns: When the path that is followed was taken up, ns; None without one.
            image_ns: Stamp of the last image, ns; None without a camera.

        Returns:
            An event if the cause has changed.
        """
        self._beat_ns = t_ns if self._beat_ns is None else self._beat_ns + self._period_ns
        cause = self._cause(t_ns, reasons, path_ns, image_ns)
        if cause == self.cause:
            return None
        self.cause = cause
        if cause is Stale.NOTHING:
            return Event(t_ns, "info", "watchdog: all is fresh again, going on")
        manner = "stopping" if self.stops else "slowing down"
        return Event(t_ns, "warning", f"watchdog: {cause}, {manner}")

    def _cause(
        self, t_ns: int, reasons: tuple[str, ...], path_ns: int | None, image_ns: int | None
    ) -> Stale:
        assert self._beat_ns is not None
        if self._beat_ns - t_ns > self._late_ns:
            return Stale.LATE
        if path_ns is not None and t_ns - path_ns > self._path_ns:
            return Stale.OLD_PATH
        if image_ns is not None and t_ns - image_ns > self._image_ns:
            return Stale.BLIND
        if HealthReason.NO_COUNTS in reasons:
            return Stale.NO_MOTION_SENSOR if HealthReason.NO_IMU in reasons else Stale.NO_BELTS
        if _BOTH_BELTS.issubset(reasons):
            return Stale.NO_BELTS
        if HealthReason.SLIDES in reasons:
            return Stale.SLIPPERY
        return Stale.THIN if HealthReason.THIN in reasons else Stale.NOTHING
