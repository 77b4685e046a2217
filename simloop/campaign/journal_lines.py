"""Read the lines of a campaign's journal, and find what is whole in a damaged one."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any

from simloop.campaign.spec import RunSpec
from simloop.campaign.summary import NUMBERS
from simloop.campaign.sweeps import SEEDS_END, is_text
from simloop.campaign.work import OUTCOMES, REACHED, Row

LONGEST_LINE = 16 * 2**20
"""Bytes of a line, at most: a row with the driven path of a long run has some 100,000."""

_START = b'{"key"'  # a row's own quotation marks are escaped, so this occurs at starts only
_COLUMNS = 1000  # at most
_DEPTH = 4  # lists within a row: the points of a path are lists of two numbers
_KINDS = ((bool, "truth value"), ((int, float), "number"), (str, "text"), (list, "list"))


class Damaged(Exception):
    """A line that is not what a campaign has written.

    Attributes:
        offset: The byte of the line at which it is wrong.
    """

    def __init__(self, reason: str, offset: int = 0) -> None:
        super().__init__(reason)
        self.offset = offset


@dataclass(frozen=True, slots=True)
class Line:
    """A line of the journal.

    Attributes:
        start: Its first byte in the file.
        data: Its bytes, with the line break if it has one.
    """

    start: int
    data: bytes

    @property
    def ended(self) -> bool:
        """Whether it ends with a line break."""
        return self.data.endswith(b"\n")

    @property
    def torn(self) -> bool:
        """Whether it looks like the beginning of a line that a kill has cut off."""
        beginning = self.data.strip(b"\0")
        whole = len(self.data) == LONGEST_LINE
        starts = beginning.startswith(_START) or _START.startswith(beginning)
        return starts and not self.ended and not whole


@dataclass(frozen=True, slots=True)
class Found:
    """What a line of the journal holds.

    Attributes:
        line: The line.
        entries: The whole entries in it: their bytes with a line break, their key, their row.
        error: What is wrong with it; None for a whole line.
    """

    line: Line
    entries: tuple[tuple[bytes, str, Row], ...]
    error: Damaged | None = None


class LineReader:
    """Reads lines, and remembers what kind of value each column holds."""

    def __init__(self) -> None:
        """Begin without columns."""
        self._kinds: dict[str, str] = dict.fromkeys(NUMBERS, "number")

    def read(self, data: bytes) -> tuple[str, Row]:
        """Read one line.

        Args:
            data: A line, with or without its line break.

        Returns:
            The run's ``RunSpec.key`` and its row.

        Raises:
            Damaged: If it is not a whole line of a journal.
        """
        entry = _parse(data)
        if not isinstance(entry, dict) or not entry.keys() >= {"key", "row"}:
            raise Damaged("not a line with key and row")
        spec, row = _spec_of(entry["key"]), entry["row"]
        if not isinstance(row, dict):
            raise Damaged("its row is not a table")
        _check_row(spec, row)
        kinds = {name: kind for name, value in row.items() if (kind := _kind(name, value))}
        for name, kind in kinds.items():
            if self._kinds.get(name, kind) != kind:
                raise Damaged(f"{name} is a {kind}, not a {self._kinds[name]}")
        if len(self._kinds | kinds) > _COLUMNS:
            raise Damaged(f"more than {_COLUMNS} columns")
        self._kinds |= kinds
        return spec.key, row

    def salvage(self, data: bytes) -> Iterator[tuple[bytes, str, Row]]:
        """Find the whole entries in a damaged line, e.g. after zeros or after half a line.

        Args:
            data: The line.

        Yields:
            The bytes of each whole entry, with a line break; its key; its row.
        """
        for piece in data.split(_START)[1:]:
            try:
                text = _text_before_damage(_START + piece)
                _, end = json.JSONDecoder().raw_decode(text)
                one = text[:end].encode()
                entry = self.read(one)
            except (ValueError, RecursionError, Damaged):
                continue
            yield (one + b"\n", *entry)


def scan(file: IO[bytes]) -> Iterator[Found]:
    """Read a journal line by line. A line that is too long comes in pieces.

    Args:
        file: The journal, open at its beginning.

    Yields:
        Its lines with what they hold.
    """
    reader, start = LineReader(), 0
    while data := file.readline(LONGEST_LINE):
        line = Line(start, data)
        try:
            yield Found(line, ((data.rstrip(b"\r\n") + b"\n", *reader.read(data)),))
        except Damaged as error:
            yield Found(line, tuple(reader.salvage(data)), error)
        start += len(data)


def _text_before_damage(data: bytes) -> str:
    """Decode up to the first byte that is not UTF-8."""
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        return data[: error.start].decode("utf-8")


def _parse(data: bytes) -> Any:
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise Damaged("not text in UTF-8", error.start) from None
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise Damaged(error.msg, len(text[: error.pos].encode())) from None
    except ValueError as error:  # a number with thousands of digits
        raise Damaged(str(error)) from None
    except RecursionError:
        raise Damaged("nested too deeply") from None


def _spec_of(key: Any) -> RunSpec:
    """Read a run's key. Damaged if it is none."""
    try:
        scenario, planner, sweep, overrides, seed = json.loads(key)
        texts = (scenario, planner or "", *sweep, *overrides)
        good = all(isinstance(one, str) for one in texts) and type(seed) is int
        spec = RunSpec(scenario, planner, tuple(sweep), tuple(overrides), seed)
        if good and 0 <= seed < SEEDS_END and spec.key == key:
            return spec
    except (ValueError, TypeError, RecursionError):
        pass
    raise Damaged("its key names no run")


def _check_row(spec: RunSpec, row: Row) -> None:
    """Raise Damaged for a row that is not of this run, or lacks what every row has."""
    scenario, planner, sweep = spec.cell
    said = {"scenario": scenario, "planner": planner, "sweep": sweep, "seed": spec.seed}
    for name, value in said.items():
        if type(row.get(name)) is not type(value) or row[name] != value:
            raise Damaged(f"its row has another {name} than its key")
    outcome = row.get("outcome")
    if not isinstance(outcome, str) or outcome not in OUTCOMES:
        raise Damaged("its outcome is unknown")
    if row.get("success") is not (outcome == REACHED):
        raise Damaged("success and outcome contradict each other")
    if not isinstance(row.get("error"), str):
        raise Damaged("its error is not a text")


def _kind(name: str, value: Any, depth: int = 0) -> str:
    """Name the kind of a column's value; empty for None. Damaged if a row cannot hold it."""
    for text in (name, value):
        if isinstance(text, str) and not is_text(text):
            raise Damaged("half a character (a surrogate)")
    if value is None:
        return ""
    if type(value) is int and not -SEEDS_END <= value < SEEDS_END:
        raise Damaged(f"{name} is larger than 64 bits")
    if isinstance(value, list):
        if depth >= _DEPTH:
            raise Damaged(f"{name} is nested too deeply")
        if len({_kind(name, one, depth + 1) for one in value}) > 1:
            raise Damaged(f"{name} holds values of several kinds")
    for types, kind in _KINDS:
        if isinstance(value, types):  # type: ignore[arg-type]
            return kind
    raise Damaged(f"{name} is a table")
