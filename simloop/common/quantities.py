"""Define the types of numbers in the settings, and the checks that settings share."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, ConfigDict, Field
from pydantic_core import PydanticCustomError

# The limits are wider than any sensible setting. They are narrow enough that nothing overflows and
# that every simulation ends.
Coordinate = Annotated[float, Field(ge=-1e4, le=1e4)]
"""A coordinate, m."""

Point = tuple[Coordinate, Coordinate]
"""A point x, y in the map frame, m."""

STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)
"""Configuration of pydantic models: unknown keys, infinity and NaN are errors."""

LEAST = 1e-9
"""Least value above 0: squares and quotients of smaller numbers leave the range of a float."""


def zero_or_enough(value: float) -> float:
    """Check that a number is 0 or large enough to calculate with.

    Args:
        value: The number, 0 or more.

    Returns:
        The same number.

    Raises:
        PydanticCustomError: If it is above 0 and below ``LEAST``.
    """
    if 0.0 < value < LEAST:
        raise PydanticCustomError(
            "too_small", "{text}", {"text": f"must be 0 or at least {LEAST:g}"}
        )
    return value


Positive = Annotated[float, Field(gt=0.0, le=1e6), AfterValidator(zero_or_enough)]
NonNegative = Annotated[float, Field(ge=0.0, le=1e6), AfterValidator(zero_or_enough)]
Small = Annotated[float, Field(ge=0.0, le=10.0), AfterValidator(zero_or_enough)]
"""A noise, a bias, a margin or a share, 0 to 10 of its unit."""

Scale = Annotated[float, Field(ge=1e-4, le=1e3)]
"""A gain, a weight of the map or a physical constant of a motor, which must not vanish."""

Rate = Annotated[float, Field(ge=1e-3, le=1e3)]
"""A speed or an acceleration that is a limit, per s or s^2."""

Offset = Annotated[float, Field(ge=-10.0, le=10.0)]
"""A coordinate in base_link, m."""

Length = Annotated[float, Field(ge=1e-6, le=10.0)]
"""A length of the robot or of an object near it, m."""

Period = Annotated[float, Field(gt=0.0, le=3600.0), AfterValidator(zero_or_enough)]
"""The time between two events, s."""

Angle = Annotated[float, Field(ge=0.01, le=3.0)]
"""An opening angle, rad."""

Fraction = Annotated[float, Field(ge=0.0, le=1.0)]


def to_ns(seconds: float) -> int:
    """Convert a time to whole nanoseconds, the unit of simulated time.

    Args:
        seconds: A time, s.

    Returns:
        The nearest whole number of nanoseconds.
    """
    return round(seconds * 1e9)


def reject(message: str) -> PydanticCustomError:
    """Make the error for keys that contradict each other.

    Args:
        message: The text, which names the keys.

    Returns:
        The error, to be raised by a pydantic validator.
    """
    # The text is data, not a template: its braces must not be changed.
    return PydanticCustomError("keys_clash", "{text}", {"text": message})


def has_area(min_m: tuple[float, float], max_m: tuple[float, float]) -> bool:
    """Return whether two corners span a rectangle.

    Args:
        min_m: The corner with the smaller x and y, m.
        max_m: The opposite corner, m.

    Returns:
        True if the first corner is smaller in x and in y.
    """
    return min_m[0] < max_m[0] and min_m[1] < max_m[1]


def check_range(section: str, least_m: float, most_m: float) -> None:
    """Check that a sensor's smallest range is less than its greatest range.

    Args:
        section: The section of the settings that has the keys ``range_min_m`` and ``range_max_m``.
        least_m: The smallest range, m.
        most_m: The greatest range, m.

    Raises:
        PydanticCustomError: If the smallest range is not less.
    """
    if least_m >= most_m:
        raise reject(
            f"{section}.range_min_m = {least_m:g} m is not below "
            f"{section}.range_max_m = {most_m:g} m"
        )


def check_multiple(slow: str, long_s: float, fast: str, short_s: float) -> None:
    """Check that a period is a whole multiple of another one.

    Both are first rounded to nanoseconds.

    Args:
        slow: The key of the longer period.
        long_s: The longer period, s.
        fast: The key of the shorter period.
        short_s: The shorter period, s.

    Raises:
        PydanticCustomError: If the longer period is not a whole multiple of the shorter one.
    """
    if to_ns(short_s) < 1 or to_ns(long_s) % to_ns(short_s) or to_ns(long_s) < 1:
        raise reject(f"{slow} = {long_s:g} s is not a whole multiple of {fast} = {short_s:g} s")
