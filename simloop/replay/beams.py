"""Find the directions of a scan's beams: by the log's numbers, and by the number of beams.

A log may state the step and the field of view, and the number of beams tells a known laser. Two of
these that agree win over the third.

The numbers of known lasers are those of CARMEN (``carmen_laser_guess_angle_increment``) and of
GMapping (``carmenconfiguration.cpp``), and of the lasers' manuals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from simloop.messages import FloatArray

_HOKUYO_DEG = 360.0 / 1024.0  # step of the URG-04LX
_KNOWN_STEPS_DEG = {
    # SICK LMS2xx, 180 and 100 degrees
    **dict.fromkeys((180, 181), 1.0),
    **dict.fromkeys((360, 361), 0.5),
    **dict.fromkeys((720, 721, 401), 0.25),
    **{101: 1.0, 201: 0.5},
    # SICK LMS1xx and TiM, Hokuyo UTM-30LX, 270 degrees
    **dict.fromkeys((270, 271), 1.0),
    **dict.fromkeys((540, 541), 0.5),
    **dict.fromkeys((810, 811), 1.0 / 3.0),
    **dict.fromkeys((1080, 1081), 0.25),
    # Hokuyo URG-04LX, 240 to 270 degrees
    **dict.fromkeys((682, 683, 725, 726, 768, 769), _HOKUYO_DEG),
}
_FULL_TURN = 2.0 * math.pi * (1.0 + 1e-3)  # logs round the steps
_FULL_TURN_DEG = math.degrees(_FULL_TURN)
_MOST_STEP = math.radians(5.0)  # a larger step in radians is no laser's
_ROUNDED = 2e-3  # two steps that differ by this share are one, rounded


@dataclass(frozen=True, slots=True)
class _Stated:
    """What a log says of a sweep, degrees; None where it says nothing or what cannot be.

    Attributes:
        step: angle between two beams.
        fov: field of view.
        said: each value as the log has it.
        units: the values that are in another unit than usual.
    """

    step: float | None
    fov: float | None
    said: tuple[str, ...]
    units: tuple[str, ...]


def beam_angles(beams: int, fov_rad: float = math.pi) -> FloatArray:
    """Compute the beams' directions in a sweep that is symmetric about the laser's x axis.

    An odd number of beams, such as 181 or 361, covers both ends of the field of view. An even
    number ends one step before the end, as in CARMEN.

    Args:
        beams: number of beams.
        fov_rad: field of view.

    Returns:
        (beams,) angles in the laser's frame, rad, from right to left.
    """
    return -0.5 * fov_rad + np.arange(beams) * fov_rad / _steps(beams)


def flaser_angles(
    beams: int, resolution_deg: float | None, fov_deg: float | None
) -> tuple[FloatArray, str]:
    """Compute the directions of a FLASER line's beams; the line itself does not have them.

    Args:
        beams: number of beams.
        resolution_deg: step by the log's PARAM laser_front_laser_resolution; None without.
        fov_deg: field of view by its PARAM laser_front_laser_fov; None without. Both may be in
            radians.

    Returns:
        (beams,) angles in the laser's frame, rad; and what was assumed, empty if nothing.
    """
    stated = _by_parameters(beams, resolution_deg, fov_deg)
    found = _decide(beams, stated)
    if found is not None:
        step, source = found
        angles = np.asarray(_first(beams, step, stated.fov) + step * np.arange(beams))
        return np.radians(angles), _note(beams, stated, np.radians(angles), source)
    angles = beam_angles(beams)
    source = "by the most common field of view"
    if stated.said:
        return angles, _note(beams, stated, angles, source)
    return angles, (
        "the log has no PARAM laser_front_laser_resolution or laser_front_laser_fov, and no laser "
        f"with {beams} beams is known: they are put on {_degrees(angles)}, {source}"
    )


def robotlaser_angles(
    beams: int, start_rad: float, step_rad: float, fov_rad: float
) -> tuple[FloatArray, str] | None:
    """Compute the directions of a ROBOTLASER1 or RAWLASER1 line's beams.

    Args:
        beams: number of beams.
        start_rad: direction of the first beam.
        step_rad: angle between two beams.
        fov_rad: field of view. All three may be in degrees.

    Returns:
        (beams,) angles in the laser's frame, rad; and what was assumed, empty if nothing. None if
        the line's numbers make no sweep.
    """
    stated = _by_line(beams, step_rad, fov_rad)
    start = start_rad  # becomes NaN if it is no direction
    if stated.units or _FULL_TURN < abs(start) <= _FULL_TURN_DEG:
        start = math.radians(start_rad)
    if not abs(start) <= _FULL_TURN:
        start = math.nan
    if stated.fov is None and 0.0 < -2.0 * start <= _FULL_TURN:  # a sweep about the x axis
        stated = replace(stated, fov=math.degrees(-2.0 * start))
    by_start = _start_decides(beams, stated, math.degrees(start))
    if by_start:
        stated = replace(stated, fov=math.degrees(-2.0 * start))
    if stated.step is None and stated.fov is None:
        return None
    found = _decide(beams, stated)
    if found is None:
        return None
    step, source = found[0], "by the resolution and the start" if by_start else found[1]
    first = math.radians(_first(beams, step, stated.fov)) if math.isnan(start) else start
    if step == stated.step and not stated.units:
        angles = np.asarray(first + step_rad * np.arange(beams), np.float64)
    else:
        angles = np.asarray(first + math.radians(step) * np.arange(beams), np.float64)
    note = _note(beams, stated, angles, source)
    if math.isnan(start) and not note:
        note = f"the laser lines say a start of {start_rad:.4g} rad: the sweep is put in the middle"
    return angles, note


def _steps(beams: int) -> int:
    return max(1, beams - 1 if beams % 2 else beams)


def _by_parameters(beams: int, step: float | None, fov: float | None) -> _Stated:
    """Read a log's parameters; those of a full turn or less in radians are in radians."""
    said, units = [], []
    if step is not None:
        said.append(f"PARAM laser_front_laser_resolution says {step:.4g}")
        if step <= _MOST_STEP and step * (beams - 1) <= _FULL_TURN:
            step = math.degrees(step)
            units.append("PARAM laser_front_laser_resolution is taken for radians")
    if fov is not None:
        said.append(f"PARAM laser_front_laser_fov says {fov:.4g}")
        if fov <= _FULL_TURN:
            fov = math.degrees(fov)
            units.append("PARAM laser_front_laser_fov is taken for radians")
    if step is not None and not 0.0 < step * (beams - 1) <= _FULL_TURN_DEG:
        step = None
    return _Stated(step, fov, tuple(said), tuple(units))


def _by_line(beams: int, step: float, fov: float) -> _Stated:
    """Read a laser line's numbers; those that no angle in radians has are in degrees."""
    said = (
        f"the laser lines say a resolution of {step:.4g}",
        f"the laser lines say a field of view of {fov:.4g}",
    )
    units = []
    step_deg = fov_deg = None
    if 0.0 < step * (beams - 1) <= _FULL_TURN:
        step_deg = math.degrees(step)
    elif _FULL_TURN < step * (beams - 1) <= _FULL_TURN_DEG:
        step_deg = step
        units.append("the resolution in the laser lines is taken for degrees")
    if 0.0 < fov <= _FULL_TURN:
        fov_deg = math.degrees(fov)
    elif _FULL_TURN < fov <= _FULL_TURN_DEG:
        fov_deg = fov
        units.append("the field of view in the laser lines is taken for degrees")
    return _Stated(step_deg, fov_deg, said, tuple(units))


def _decide(beams: int, stated: _Stated) -> tuple[float, str] | None:
    """Choose the step by what agrees; if nothing does, a known laser's counts, then the fov.

    Returns:
        The step, degrees; and by what, empty if nothing contradicts it. None if nothing is known.
    """
    known, step, fov = _KNOWN_STEPS_DEG.get(beams), stated.step, stated.fov
    silent = len(stated.said) - (step is not None) - (fov is not None) <= 0
    if step is not None and fov is not None and _covers(beams, step, fov):
        return step, ""
    number = "by the number of beams"
    if known is not None:
        if step is not None and abs(step - known) * max(1, beams - 1) <= max(
            0.5 * known, _ROUNDED * known * beams
        ):
            return step, "" if fov is None and silent else f"{number} and the resolution"
        if fov is not None and _covers(beams, known, fov):
            return known, "" if step is None and silent else f"{number} and the field of view"
        return known, number if stated.said else ""
    if fov is not None:
        return fov / _steps(beams), "" if step is None and silent else "by the field of view"
    return None if step is None else (step, "" if silent else "by the resolution")


def _covers(beams: int, step: float, fov: float) -> bool:
    """Return whether the beams make the field of view, with both of its ends or one of them."""
    return abs(fov - step * (beams - 0.5)) <= step * (1.0 + 1e-9)


def _start_decides(beams: int, stated: _Stated, start: float) -> bool:
    """Return whether the start agrees with the step, and neither of them with the fov."""
    step, fov, known = stated.step, stated.fov, _KNOWN_STEPS_DEG.get(beams)
    if step is None or fov is None or _covers(beams, step, fov):
        return False
    return _covers(beams, step, -2.0 * start) and not (
        known is not None and _covers(beams, known, fov)
    )


def _first(beams: int, step: float, fov: float | None) -> float:
    """Return the first beam's direction, degrees, in a sweep about the x axis."""
    both_ends = fov is not None and abs(fov - step * (beams - 1)) <= 0.5 * step
    return -0.5 * step * (beams - 1 if both_ends else _steps(beams))


def _note(beams: int, stated: _Stated, angles: FloatArray, source: str) -> str:
    """Say what the log says of its sweep and what is taken, if that is not plain."""
    if source:
        others = "each other and with " if len(stated.said) > 1 else ""
        what = "; ".join((*stated.said, *stated.units))
        return (
            f"{what}; that does not agree with {others}{beams} beams: they are put on "
            f"{_degrees(angles)}, {source}"
        )
    if stated.units:
        what = "; ".join((*stated.said, *stated.units))
        return f"{what}: {beams} beams are put on {_degrees(angles)}"
    return ""


def _degrees(angles: FloatArray) -> str:
    return f"{math.degrees(angles[-1] - angles[0]):.4g} degrees"
