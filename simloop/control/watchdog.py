"""The watchdog: what the robot drives by must be fresh; where it is not, it slows down and stops.

Scans that stop, and a pose that is not to be believed, halt the robot by themselves (``health``).
This one watches the rest: the path, which a planner that hangs leaves as it was; the estimate,
which may fall behind the robot's own beat or have nothing left to go by between two scans; and the
belts' counts, without which speed is not measured. It goes on when all is fresh again.
"""

from __future__ import annotations

from simloop.config import RatesConfig, TrackerConfig, WatchdogConfig
from simloop.messages import (
    LEFT_BELT,
    NO_COUNTS,
    NO_IMU,
    RIGHT_BELT,
    EncoderReading,
    Event,
    FloatArray,
)

OLD_PATH = "no new path from the planner"
DEAF = "neither counts nor imu readings"
BLIND = "no image from the camera"
LATE = "the estimate lags behind"
NO_BELTS = "no belt is heard"
_BOTH_BELTS = {LEFT_BELT, RIGHT_BELT}
_DRIVEN_RADPS = 1.4  # of both sprockets: 5 cm/s, two counts a period
_STANDING_TICKS = 10  # twenty counts that have not come
_AT_REST_TICKS = 30


class StandingCounts:
    """Counts that stand on both sides while both belts are driven are taken for none at all.

    Fresh stamps would make a robot believe that it stands, and drive its motors the harder.
    """

    def __init__(self) -> None:
        self._heard: EncoderReading | None = None
        self._stands = self._rests = 0

    def believed(self, reading: EncoderReading, sprocket_radps: FloatArray) -> EncoderReading:
        """The reading, or the last one that moved, with its old stamp, while the counts stand.

        sprocket_radps: (2,) asked for in the last period.
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
    """Looks once a control period; ``cause`` is why it slows the robot down, or nothing."""

    def __init__(self, config: WatchdogConfig, rates: RatesConfig, tracker: TrackerConfig) -> None:
        self._config, self._period_ns = config, round(rates.control_s * 1e9)
        self._path_ns = round(config.path_frames * rates.plan_s * 1e9)
        self._late_ns = round(config.estimate_s * 1e9)
        self._image_ns = round(config.image_s * 1e9)
        # At least as hard as the monitor takes it to brake, so that what that let through is safe.
        self._slow_down = 2.0 * tracker.max_decel_mps2 * rates.control_s
        self._turn_down = tracker.max_yaw_accel_radps2 * rates.control_s
        self._rate_a_speed = tracker.max_yaw_rate_radps / tracker.max_speed_mps
        self._beat_ns: int | None = None
        self._last = (0.0, 0.0)
        self.cause = ""

    @property
    def stops(self) -> bool:
        """Whether it lets nothing through but braking."""
        return self.cause not in ("", NO_BELTS)

    def look(
        self,
        t_ns: int,
        reasons: tuple[str, ...],
        path_ns: int | None,
        image_ns: int | None = None,
    ) -> Event | None:
        """What there is to say in a period.

        t_ns: the estimate's stamp; reasons: ``Health.reasons``; path_ns: when the path that is
        followed was taken up, or None without one; image_ns: of the last image, or None without a
        camera.
        """
        self._beat_ns = t_ns if self._beat_ns is None else self._beat_ns + self._period_ns
        cause = self._why(t_ns, reasons, path_ns, image_ns)
        if cause == self.cause:
            return None
        self.cause = cause
        if not cause:
            return Event(t_ns, "info", "watchdog: all is fresh again, going on")
        manner = "stopping" if self.stops else "slowing down"
        return Event(t_ns, "warning", f"watchdog: {cause}, {manner}")

    def limit(self, speed: float, rate: float) -> tuple[float, float]:
        """What is let through of a velocity, m/s and rad/s: a part of it, on the same arc."""
        if not self.cause:
            self._last = speed, rate
            return self._last
        part, most = 1.0, 0.0 if self.stops else self._config.unheard_mps
        speed_now = max(most, abs(self._last[0]) - self._slow_down)
        rate_now = max(most * self._rate_a_speed, abs(self._last[1]) - self._turn_down)
        for asked, now in ((speed, speed_now), (rate, rate_now)):
            if abs(asked) > now:
                part = min(part, now / abs(asked))
        self._last = (part * speed, part * rate) if part < 1.0 else (speed, rate)
        return self._last

    def _why(
        self, t_ns: int, reasons: tuple[str, ...], path_ns: int | None, image_ns: int | None
    ) -> str:
        assert self._beat_ns is not None
        if self._beat_ns - t_ns > self._late_ns:
            return LATE
        if path_ns is not None and t_ns - path_ns > self._path_ns:
            return OLD_PATH
        if image_ns is not None and t_ns - image_ns > self._image_ns:
            return BLIND
        if NO_COUNTS in reasons:
            return DEAF if NO_IMU in reasons else NO_BELTS
        return NO_BELTS if _BOTH_BELTS.issubset(reasons) else ""
