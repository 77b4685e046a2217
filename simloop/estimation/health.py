"""Monitor the health of the localisation: its state, the reasons, and whether the robot must halt.

A reason stays active for a while after it was last noted, so that an intermittent fault is
reported once. With most reasons the robot can go on: if a belt slips, the other sensors suffice.
Some reasons halt the robot until they are over: without scans it would drive blind.

A misfit is an informative scan whose fix is refused without an explanation. Misfits are counted
until a fix is accepted. After two misfits the robot halts; after four it is lost. Scans with too
few points do not change the count. If they follow two misfits, the robot stays halted and reports
why. After a time it gives up (``sure_until_ns``).
"""

from __future__ import annotations

from collections import deque

from simloop.estimation.sight import Sight
from simloop.messages import (
    Health,
    HealthReason,
    HealthState,
)

_HOLD_NS = 500_000_000  # a reason stays active for this time after it was last noted
_HALTING = {  # reasons that halt the robot
    HealthReason.NO_SCANS,
    HealthReason.LOST,
    HealthReason.BLIND,
    HealthReason.NEVER_SEEN,
}
_SIGHT = {
    Sight.BLIND: HealthReason.BLIND,
    Sight.UNPROVEN: HealthReason.NEVER_SEEN,
    Sight.THIN: HealthReason.THIN,
}
_SCANS_MISSED = 3  # scans are missing after this many scan periods without one
_READINGS_MISSED_NS = 50_000_000  # encoders or IMU are missing after this time without a reading
_BELT_TICKS = 30  # number of control periods over which a belt is judged
_BELT_SHARE = 0.8  # a belt is reported if it was refused in more than this share of them
_MISFITS_TO_HALT = 2  # the robot halts after this many misfits
_MISFITS_TO_BE_LOST = 4  # the robot is lost after this many misfits


class HealthMonitor:
    """Monitor that turns the localiser's observations into one of three states.

    Attributes:
        lost_since_ns: Time at which the robot became lost, ns; None while it is not lost.
        current: The health that was reported last.
    """

    def __init__(self, lidar_period_ns: int) -> None:
        """Start in the state OK.

        Args:
            lidar_period_ns: Time from one scan to the next, ns.
        """
        self._scan_ns = lidar_period_ns
        self._until_ns: dict[HealthReason, int] = {}
        self._belts = tuple(deque([False] * _BELT_TICKS, _BELT_TICKS) for _ in range(2))
        self._counts = [0, 0]
        self._last_scan_ns = 0
        self._misfits = 0
        self._halted_since_ns: int | None = None
        self._sight = Sight.CLEAR
        self._seen_ns = 0
        self.lost_since_ns: int | None = None
        self.current = Health(0, HealthState.OK, (), False)

    @property
    def lost(self) -> bool:
        """Whether the robot is lost: its pose must not be used."""
        return self.lost_since_ns is not None

    @property
    def belts_heard(self) -> tuple[bool, bool]:
        """Whether the left and the right encoder can be trusted."""
        return (
            HealthReason.LEFT_BELT not in self._until_ns,
            HealthReason.RIGHT_BELT not in self._until_ns,
        )

    def sure_until_ns(self, t_ns: int) -> int:
        """Return the last time at which the robot had scans, saw, and was not halted by misfits.

        Args:
            t_ns: Present time, ns.

        Returns:
            The time, ns, at most ``t_ns``.
        """
        doubt_ns = self._halted_since_ns if self.lost_since_ns is None else self.lost_since_ns
        seen_ns = min(self._last_scan_ns, self._seen_ns)
        return min(t_ns if doubt_ns is None else doubt_ns, seen_ns)

    def note(self, t_ns: int, reason: HealthReason) -> None:
        """Note a reason, which stays active for a while.

        Args:
            t_ns: Present time, ns.
            reason: One of the reasons in ``messages``.
        """
        self._until_ns[reason] = t_ns + _HOLD_NS

    def belts(self, t_ns: int, refused: tuple[bool, bool]) -> None:
        """Record which belts the filter refused in this period.

        Args:
            t_ns: Present time, ns.
            refused: Whether the left and the right belt was refused.
        """
        for side, reason in enumerate((HealthReason.LEFT_BELT, HealthReason.RIGHT_BELT)):
            kept = self._belts[side]
            if refused[side] or self._counts[side]:
                self._counts[side] += refused[side] - kept[0]
                kept.append(refused[side])
                if self._counts[side] > _BELT_SHARE * _BELT_TICKS:
                    self.note(t_ns, reason)

    def readings(self, t_ns: int, encoders_ns: int, imu_ns: int) -> None:
        """Check the newest stamps of encoders and IMU.

        Args:
            t_ns: Present time, ns.
            encoders_ns: Newest stamp of the encoders, ns.
            imu_ns: Newest stamp of the IMU, ns.
        """
        for reason, stamp in ((HealthReason.NO_COUNTS, encoders_ns), (HealthReason.NO_IMU, imu_ns)):
            if t_ns - stamp > _READINGS_MISSED_NS:
                self.note(t_ns, reason)

    def scan(self, t_ns: int, taken: bool, informative: bool) -> None:
        """Record the result of a scan.

        Args:
            t_ns: Stamp of the scan, ns.
            taken: Whether the filter accepted its fix.
            informative: Whether it had enough points to contradict the belief.
        """
        self._last_scan_ns = t_ns
        if self._sight in (Sight.CLEAR, Sight.THIN):
            self._seen_ns = t_ns
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

    def sees(self, sight: Sight) -> None:
        """Record the verdict on the LiDAR after a scan.

        Args:
            sight: How well it sees.
        """
        self._sight = sight

    def found(self) -> None:
        """Record that the robot has found its pose again."""
        self.lost_since_ns, self._misfits, self._halted_since_ns = None, 0, None

    def review(self, t_ns: int) -> Health | None:
        """Return the present health if it differs from the health reported last.

        Args:
            t_ns: Present time, ns.

        Returns:
            The new ``current``; None if nothing has changed.
        """
        doubtful = self._misfits >= _MISFITS_TO_HALT
        if t_ns - self._last_scan_ns > _SCANS_MISSED * self._scan_ns:
            self._until_ns[HealthReason.NO_SCANS] = t_ns + 1
        if self._sight in _SIGHT:
            self._until_ns[_SIGHT[self._sight]] = t_ns + 1
        if self.lost:
            self._until_ns[HealthReason.LOST] = t_ns + 1
        elif doubtful:  # the reason is reported as long as it halts the robot
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
