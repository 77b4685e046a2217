"""Judge the robot's own localisation: its state, the reasons, and whether it must halt.

A reason holds for a while after it was last given, so that what comes and goes is reported once.
Most reasons can be lived with: if a belt slips, the other sensors go on. Some halt the robot until
they are over: without scans it would drive blind.

Informative scans whose fixes are refused without an explanation are misfits. They are counted
until a fix is taken. After two the robot halts, after four it is lost. Scans with too few points
decide nothing: if they follow two misfits the robot stays halted, says why, and after a time it
gives up (``sure_until_ns``).
"""

from __future__ import annotations

from collections import deque

from simloop.messages import (
    Health,
    HealthReason,
    HealthState,
)

_HOLD_NS = 500_000_000  # how long a reason holds after it was last given
_HALTING = {HealthReason.NO_SCANS, HealthReason.LOST}
_SCANS_MISSED = 3  # scan periods without a scan
_READINGS_MISSED_NS = 50_000_000
_BELT_TICKS = 30  # control periods over which a belt is judged,
_BELT_SHARE = 0.8  # and the share of them in which it was refused that makes it "not heard"
_MISFITS_TO_HALT = 2
_MISFITS_TO_BE_LOST = 4


class HealthMonitor:
    """Takes what the localiser notices and turns it into one of three states.

    Attributes:
        lost_since_ns: When it became lost; None while it is not.
        current: The health as it was last reported.
    """

    def __init__(self, lidar_period_ns: int) -> None:
        """Start with everything in order.

        Args:
            lidar_period_ns: Time from one scan to the next.
        """
        self._scan_ns = lidar_period_ns
        self._until_ns: dict[HealthReason, int] = {}
        self._belts = tuple(deque([False] * _BELT_TICKS, _BELT_TICKS) for _ in range(2))
        self._counts = [0, 0]
        self._last_scan_ns = 0
        self._misfits = 0
        self._halted_since_ns: int | None = None
        self.lost_since_ns: int | None = None
        self.current = Health(0, HealthState.OK, (), False)

    @property
    def lost(self) -> bool:
        """Whether the pose is not to be believed at all."""
        return self.lost_since_ns is not None

    @property
    def belts_heard(self) -> tuple[bool, bool]:
        """Whether the left and the right encoder are worth listening to."""
        return (
            HealthReason.LEFT_BELT not in self._until_ns,
            HealthReason.RIGHT_BELT not in self._until_ns,
        )

    def sure_until_ns(self, t_ns: int) -> int:
        """Return until when the robot had scans, and no halting doubt of where it was.

        Args:
            t_ns: Now.

        Returns:
            An instant, ``t_ns`` at the latest.
        """
        doubt_ns = self._halted_since_ns if self.lost_since_ns is None else self.lost_since_ns
        return min(t_ns if doubt_ns is None else doubt_ns, self._last_scan_ns)

    def note(self, t_ns: int, reason: HealthReason) -> None:
        """Give a reason, which holds for a while from now on.

        Args:
            t_ns: Now.
            reason: One of the reasons in ``messages``.
        """
        self._until_ns[reason] = t_ns + _HOLD_NS

    def belts(self, t_ns: int, refused: tuple[bool, bool]) -> None:
        """Take which belts the filter refused in this period.

        Args:
            t_ns: Now.
            refused: Left and right.
        """
        for side, reason in enumerate((HealthReason.LEFT_BELT, HealthReason.RIGHT_BELT)):
            kept = self._belts[side]
            if refused[side] or self._counts[side]:
                self._counts[side] += refused[side] - kept[0]
                kept.append(refused[side])
                if self._counts[side] > _BELT_SHARE * _BELT_TICKS:
                    self.note(t_ns, reason)

    def readings(self, t_ns: int, encoders_ns: int, imu_ns: int) -> None:
        """Take the newest stamps of encoders and IMU.

        Args:
            t_ns: Now.
            encoders_ns: Newest stamp of the encoders.
            imu_ns: Newest stamp of the IMU.
        """
        for reason, stamp in ((HealthReason.NO_COUNTS, encoders_ns), (HealthReason.NO_IMU, imu_ns)):
            if t_ns - stamp > _READINGS_MISSED_NS:
                self.note(t_ns, reason)

    def scan(self, t_ns: int, taken: bool, informative: bool) -> None:
        """Take what became of a scan.

        Args:
            t_ns: Its stamp.
            taken: Whether the filter took its fix.
            informative: Whether it had points enough to contradict the belief.
        """
        self._last_scan_ns = t_ns
        if not informative:
            self.note(t_ns, HealthReason.NOTHING_SEEN)
        elif taken:
            self._misfits, self._halted_since_ns = 0, None
        else:
            self._misfits += 1
            self.note(t_ns, HealthReason.MISFIT)
            if self._misfits == _MISFITS_TO_HALT:
                self._halted_since_ns = t_ns
        if self._misfits >= _MISFITS_TO_BE_LOST and not self.lost:
            self.lost_since_ns = t_ns

    def found(self) -> None:
        """Take that the robot knows again where it is."""
        self.lost_since_ns, self._misfits, self._halted_since_ns = None, 0, None

    def review(self, t_ns: int) -> Health | None:
        """Return the health now, if it differs from what was reported last.

        Args:
            t_ns: Now.

        Returns:
            The new ``current``; None if nothing has changed.
        """
        doubtful = self._misfits >= _MISFITS_TO_HALT
        if t_ns - self._last_scan_ns > _SCANS_MISSED * self._scan_ns:
            self._until_ns[HealthReason.NO_SCANS] = t_ns + 1
        if self.lost:
            self._until_ns[HealthReason.LOST] = t_ns + 1
        elif doubtful:  # the reason is reported for as long as it halts
            self._until_ns[HealthReason.MISFIT] = max(
                t_ns + 1, self._until_ns.get(HealthReason.MISFIT, 0)
            )
        if not self._until_ns and self.current.state is HealthState.OK:
            return None
        for reason in [r for r, until_ns in self._until_ns.items() if until_ns <= t_ns]:
            del self._until_ns[reason]
        reasons = tuple(sorted(self._until_ns))
        halts = doubtful or not _HALTING.isdisjoint(reasons)
        state = HealthState.DEGRADED if reasons else HealthState.OK
        state = HealthState.LOST if self.lost else state
        current = self.current
        if (state, reasons, halts) == (current.state, current.reasons, current.halts):
            return None
        self.current = Health(t_ns, state, reasons, halts)
        return self.current
