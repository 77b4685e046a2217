"""Whether the robot knows where it is, and why not: kept reason by reason, said when it changes.

A reason holds for a while after it was last given, so that what comes and goes is said once. Some
reasons are to be lived with (a belt that slips: the other senses go on); some halt the robot until
they are over (no scans: it would drive blind). Scans that keep telling of another place than the
belief, when nothing explains it, mean that the robot is lost.
"""

from __future__ import annotations

from collections import deque

from simloop.messages import (
    LEFT_BELT,
    LOST,
    MISFIT,
    NO_COUNTS,
    NO_IMU,
    NO_SCANS,
    NOTHING_SEEN,
    RIGHT_BELT,
    Health,
)

_HOLD_NS = 500_000_000
_HALTING = {NO_SCANS, LOST}
_SCANS_MISSED = 3
_READINGS_MISSED_NS = 50_000_000
_BELT_TICKS = 30
_BELT_SHARE = 0.8
_MISFITS_TO_HALT = 2
_MISFITS_TO_BE_LOST = 4


class HealthMonitor:
    """Reasons in, one of three states out."""

    def __init__(self, lidar_period_ns: int) -> None:
        self._scan_ns = lidar_period_ns
        self._until_ns: dict[str, int] = {}
        self._belts = tuple(deque([False] * _BELT_TICKS, _BELT_TICKS) for _ in range(2))
        self._counts = [0, 0]
        self._last_scan_ns = 0
        self._misfits = 0
        self.lost_since_ns: int | None = None
        self.current = Health(0, "ok", (), False)

    @property
    def lost(self) -> bool:
        """Whether the pose is not to be believed at all."""
        return self.lost_since_ns is not None

    def sure_until_ns(self, t_ns: int) -> int:
        """Until when it had scans, and knew where it was."""
        known_ns = t_ns if self.lost_since_ns is None else self.lost_since_ns
        return min(known_ns, self._last_scan_ns)

    @property
    def belts_heard(self) -> tuple[bool, bool]:
        """Whether the left and the right encoder are worth listening to."""
        return LEFT_BELT not in self._until_ns, RIGHT_BELT not in self._until_ns

    def note(self, t_ns: int, reason: str) -> None:
        """Give a reason, which holds for a while from now on."""
        self._until_ns[reason] = t_ns + _HOLD_NS

    def holds(self, reason: str) -> bool:
        """Whether a reason was given lately."""
        return reason in self._until_ns

    def belts(self, t_ns: int, refused: tuple[bool, bool]) -> None:
        """Which of the belts the filter's gate refused in this period."""
        for side, reason in enumerate((LEFT_BELT, RIGHT_BELT)):
            kept = self._belts[side]
            if refused[side] or self._counts[side]:
                self._counts[side] += refused[side] - kept[0]
                kept.append(refused[side])
                if self._counts[side] > _BELT_SHARE * _BELT_TICKS:
                    self.note(t_ns, reason)

    def readings(self, t_ns: int, encoders_ns: int, imu_ns: int) -> None:
        """The newest stamps that encoders and IMU have given."""
        for reason, stamp in ((NO_COUNTS, encoders_ns), (NO_IMU, imu_ns)):
            if t_ns - stamp > _READINGS_MISSED_NS:
                self.note(t_ns, reason)

    def scan(self, t_ns: int, taken: bool, seen: bool) -> None:
        """A scan came; whether its fix was taken, and whether there was anything in it."""
        self._last_scan_ns = t_ns
        if not seen:
            self.note(t_ns, NOTHING_SEEN)
        elif taken:
            self._misfits = 0
        else:
            self._misfits += 1
            self.note(t_ns, MISFIT)
        if self._misfits >= _MISFITS_TO_BE_LOST and not self.lost:
            self.lost_since_ns = t_ns

    def found(self) -> None:
        """The robot knows again where it is."""
        self.lost_since_ns, self._misfits = None, 0

    def review(self, t_ns: int) -> Health | None:
        """The state now, if it is another than what was said last."""
        if t_ns - self._last_scan_ns > _SCANS_MISSED * self._scan_ns:
            self._until_ns[NO_SCANS] = t_ns + 1
        if self.lost:
            self._until_ns[LOST] = t_ns + 1
        if not self._until_ns and self.current.state == "ok":
            return None
        for reason in [r for r, until_ns in self._until_ns.items() if until_ns <= t_ns]:
            del self._until_ns[reason]
        reasons = tuple(sorted(self._until_ns))
        halts = self._misfits >= _MISFITS_TO_HALT or not _HALTING.isdisjoint(reasons)
        state = "lost" if self.lost else "degraded" if reasons else "ok"
        if (state, reasons, halts) == (
            self.current.state,
            self.current.reasons,
            self.current.halts,
        ):
            return None
        self.current = Health(t_ns, state, reasons, halts)
        return self.current
