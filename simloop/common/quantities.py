"""The kinds of figures that settings are made of, and what their checks have in common."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field
from pydantic_core import PydanticCustomError

Coordinate = Annotated[float, Field(ge=-1e4, le=1e4)]
Point = tuple[Coordinate, Coordinate]


STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)

# Wide enough for whatever may be meant, and narrow enough that nothing overflows or never ends.
Positive = Annotated[float, Field(gt=0.0, le=1e6)]
NonNegative = Annotated[float, Field(ge=0.0, le=1e6)]
Length = Annotated[float, Field(gt=0.0, le=10.0)]
Period = Annotated[float, Field(gt=0.0, le=3600.0)]
Angle = Annotated[float, Field(ge=0.01, le=3.0)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]


def to_ns(seconds: float) -> int:
    """A time in whole nanoseconds, the unit in which simulated time is kept."""
    return round(seconds * 1e9)


def reject(message: str) -> PydanticCustomError:
    """An error about keys that do not go together; its text names the keys itself."""
    # The text is data, not a template: braces in it must stay as they are.
    return PydanticCustomError("keys_clash", "{text}", {"text": message})


def has_area(min_m: tuple[float, float], max_m: tuple[float, float]) -> bool:
    """Whether the first corner lies below the second in x and in y."""
    return min_m[0] < max_m[0] and min_m[1] < max_m[1]


def check_range(section: str, least_m: float, most_m: float) -> None:
    """Raise what ``reject`` makes unless a sensor's least range is below its greatest."""
    if least_m >= most_m:
        raise reject(
            f"{section}.range_min_m = {least_m:g} m is not below "
            f"{section}.range_max_m = {most_m:g} m"
        )


def check_multiple(slow: str, long_s: float, fast: str, short_s: float) -> None:
    """Raise what ``reject`` makes unless one period is a whole multiple of the other, in ns."""
    if to_ns(short_s) < 1 or to_ns(long_s) % to_ns(short_s) or to_ns(long_s) < 1:
        raise reject(f"{slow} = {long_s:g} s is not a whole multiple of {fast} = {short_s:g} s")
