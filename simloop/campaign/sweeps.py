"""Read the ranges of a campaign: its seeds, the values of its sweeps, and what excludes what."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from simloop.common.errors import InputError
from simloop.config import MOVED_KEYS
from simloop.scenario.load import parse_value, resolve

MOST_STEPS = 10_000
"""Values of one sweep, at most."""

SEEDS_END = 2**63
"""Seeds are smaller than this: the results hold them as integers of 64 bits."""

_STEPS = re.compile(r"(-?[\d.eE+-]+):(-?[\d.eE+-]+):([\d.eE+-]+)\Z")


def parse_seeds(text: str) -> tuple[int, int]:
    """Read a range of seeds.

    Args:
        text: ``A:B``, the seeds from A to B-1, or a single number N, which means 0:N.

    Returns:
        A and B.

    Raises:
        InputError: If the text is not such a range, the range is empty, or a seed is negative or
            too large.
    """
    first, colon, last = text.partition(":")
    try:
        seeds = (int(first), int(last)) if colon else (0, int(first))
    except ValueError:
        raise InputError(
            f"--seeds {text}: not a range; write A:B for the seeds from A to B-1, e.g. 0:50"
        ) from None
    if seeds[0] < 0:
        raise InputError(f"--seeds {text}: a seed is at least 0")
    if seeds[1] <= seeds[0]:
        raise InputError(f"--seeds {text}: an empty range; A:B needs A < B")
    if seeds[1] > SEEDS_END:
        raise InputError(f"--seeds {text}: a seed is at most 2^63 - 1; A:B needs B <= 2^63")
    return seeds


def sweep_values(text: str) -> list[str]:
    """Read the values of a sweep.

    Args:
        text: ``key=v1,v2,...`` or ``key=first:last:step``.

    Returns:
        ``key=value`` for each value.

    Raises:
        InputError: If the text is not a sweep, its range is empty or too long, or a value is given
            twice.
    """
    key, equals, values = text.partition("=")
    if not equals or not key.strip() or not values.strip():
        raise InputError(f"--sweep {text}: not a sweep; write KEY=V1,V2,... or KEY=FIRST:LAST:STEP")
    steps = _STEPS.match(values.strip())
    parts = list(_stepped(text, *steps.groups()) if steps else _split(values))
    if len(parts) > MOST_STEPS:
        raise InputError(f"--sweep {key.strip()}: {len(parts):,} values; at most {MOST_STEPS:,}")
    seen = set()
    for part in parts:
        value = repr(_canonical(parse_value(part.strip(), f"{key.strip()}={part.strip()}")))
        if value in seen:
            raise InputError(f"--sweep {text}: the value {part.strip()} is given twice")
        seen.add(value)
    return [f"{key.strip()}={part.strip()}" for part in parts]


def check_keys(overrides: Iterable[str], sweeps: Iterable[str], planners: Sequence[str]) -> None:
    """Refuse what would be ignored because another option sets the same key afterwards.

    Args:
        overrides: The texts of ``--set``.
        sweeps: The texts of ``--sweep``.
        planners: The names of ``--planner``.

    Raises:
        InputError: If two options contradict each other. The text names the right one.
    """
    taken: list[tuple[tuple[str, ...], str]] = [(("seed",), "--seeds")]
    if planners:
        taken.append((("planner", "name"), "--planner"))
    for text in sweeps:
        key = _key(text)
        for other, option in taken:
            if _meet(key, other):
                raise _twice(f"--sweep {text}", other, option)
        taken.append((key, f"--sweep {text}"))
    for text in overrides:
        key = _key(text)
        for other, option in taken:
            # A sweep may change a part of what --set gives as a whole, but not the reverse.
            if key[: len(other)] == other:
                raise _twice(f"--set {text}", other, option)


def is_text(text: str) -> bool:
    """Tell whether a text can be written as UTF-8, which half a surrogate pair cannot.

    Args:
        text: Any text, e.g. a file name that is not UTF-8.

    Returns:
        Whether it can.
    """
    return not any("\ud800" <= one <= "\udfff" for one in text)


def check_text(texts: Iterable[str]) -> None:
    """Refuse what the results cannot hold, such as a file name that is not UTF-8.

    Args:
        texts: Names and settings of a campaign.

    Raises:
        InputError: If one is not text.
    """
    for text in texts:
        if not is_text(text):
            raise InputError(f"{text}: not text in UTF-8; rename it to use it in a campaign")


def check_once(names: Iterable[str], option: str) -> None:
    """Refuse a name that is given twice.

    Args:
        names: Names.
        option: The option that gives them, for the error message.

    Raises:
        InputError: If a name occurs twice.
    """
    seen = set()
    for name in names:
        if name in seen:
            raise InputError(f"{option} {name}: given twice; its runs would be done twice")
        seen.add(name)


def check_scenarios(names: Sequence[str]) -> None:
    """Refuse two names of one scenario.

    Args:
        names: Names or files of scenarios.

    Raises:
        InputError: If a scenario does not exist, or two names lead to the same file.
    """
    check_once(names, "SCENARIO")
    seen: dict[tuple[int, int], str] = {}
    for name in names:
        status = resolve(name).stat()
        other = seen.setdefault((status.st_dev, status.st_ino), name)
        if other != name:
            raise InputError(f"SCENARIO {name}: the same file as {other}; give one of them")


def _twice(what: str, key: tuple[str, ...], option: str) -> InputError:
    name = ".".join(key)
    return InputError(f"{what}: {name} is already given by {option}; leave one of them out")


def _key(text: str) -> tuple[str, ...]:
    """Split a dotted key. An old key counts as the key that has replaced it."""
    key = ".".join(part.strip() for part in text.partition("=")[0].split("."))
    return tuple(MOVED_KEYS.get(key, key).split("."))


def _meet(one: tuple[str, ...], other: tuple[str, ...]) -> bool:
    """Tell whether one key is the other, or a part of it."""
    least = min(len(one), len(other))
    return one[:least] == other[:least]


def _canonical(value: Any) -> Any:
    """Make equal numbers look equal: 1, 1.0 and 1e0."""
    if isinstance(value, bool):
        return value
    if isinstance(value, list):
        return [_canonical(one) for one in value]
    if isinstance(value, dict):
        return {key: _canonical(value[key]) for key in sorted(value)}
    if isinstance(value, float) and math.isfinite(value) and value.is_integer():
        return int(value)
    return value


def _stepped(text: str, first: str, last: str, step: str) -> Iterator[str]:
    try:
        low, high, by = float(first), float(last), float(step)
        count = math.floor((high - low) / by + 1e-9) + 1
    except (ValueError, ZeroDivisionError, OverflowError):
        raise InputError(
            f"--sweep {text}: FIRST:LAST:STEP must be numbers, and STEP not 0"
        ) from None
    if by <= 0.0 or not 1 <= count <= MOST_STEPS:
        raise InputError(
            f"--sweep {text}: FIRST:LAST:STEP needs FIRST <= LAST and STEP > 0, "
            f"and at most {MOST_STEPS:,} values"
        )
    return (f"{low + by * k:.10g}" for k in range(count))


def _split(values: str) -> list[str]:
    """Split at commas outside brackets and quotes."""
    parts, depth, quoted = [""], 0, False
    for sign in values:
        quoted ^= sign == '"'
        depth += (sign in "[{") - (sign in "]}") if not quoted else 0
        if sign == "," and depth == 0 and not quoted:
            parts.append("")
        else:
            parts[-1] += sign
    return parts
