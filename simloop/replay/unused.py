"""Count the scans of a log that cannot be used, and say why."""

from __future__ import annotations

from simloop.common.errors import InputError

_MOST_SHARE = 0.5  # a log of which more cannot be used is refused


class Unused:
    """Number of scans that cannot be used, by reason.

    Attributes:
        count: number of such scans so far.
    """

    def __init__(self) -> None:
        """Start with no such scan."""
        self.count = 0
        self._reasons: dict[str, tuple[int, str]] = {}

    def add(self, reason: str, where: str, count: int = 1) -> None:
        """Count scans.

        Args:
            reason: why they cannot be used, as the end of a sentence about one scan.
            where: the first of them, e.g. ``line 12``.
            count: how many.
        """
        if count:
            before, first = self._reasons.get(reason, (0, where))
            self._reasons[reason] = (before + count, first)
            self.count += count

    def notes(self, total: int) -> list[str]:
        """Describe what is left out.

        Args:
            total: number of all scans in the file.

        Returns:
            One sentence for each reason.
        """
        return [
            f"{count} of {total} scans are left out: {reason} (first at {first})"
            for reason, (count, first) in self._reasons.items()
        ]

    def refuse_most(self, name: str, total: int) -> None:
        """Refuse a log of which most cannot be used.

        Args:
            name: name of the log in the error message.
            total: number of all scans in the file.

        Raises:
            InputError: if more than half of the scans cannot be used, or if there are none.
        """
        if self.count > _MOST_SHARE * total or self.count >= total:
            reasons = "; ".join(self.notes(total)) or "it has no scan"
            raise InputError(f"{name}: most of the log cannot be used: {reasons}")
