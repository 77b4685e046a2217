"""Find the directions of a scan's beams: by the log's parameters, or by the number of beams.

The numbers of known lasers are those of CARMEN (``carmen_laser_guess_angle_increment``) and of
GMapping (``carmenconfiguration.cpp``), and of the lasers' manuals.
"""

from __future__ import annotations

import math

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
    steps = beams - 1 if beams % 2 else beams
    return -0.5 * fov_rad + np.arange(beams) * fov_rad / max(1, steps)


def flaser_angles(
    beams: int, resolution_deg: float | None, fov_deg: float | None
) -> tuple[FloatArray, str]:
    """Compute the directions of a FLASER line's beams; the line itself does not have them.

    Args:
        beams: number of beams.
        resolution_deg: step by the log's PARAM laser_front_laser_resolution; None without.
        fov_deg: field of view by its PARAM laser_front_laser_fov; None without.

    Returns:
        (beams,) angles in the laser's frame, rad; and what was assumed, empty if nothing.
    """
    steps, given = max(1, beams - 1 if beams % 2 else beams), (resolution_deg, fov_deg)
    if resolution_deg is not None and resolution_deg * (beams - 1) <= math.degrees(_FULL_TURN):
        if fov_deg is None:
            return beam_angles(beams, math.radians(resolution_deg * steps)), ""
        if abs(fov_deg - resolution_deg * (beams - 1)) <= 0.5 * resolution_deg:
            step = math.radians(resolution_deg)  # both ends are covered
            return np.asarray(step * (np.arange(beams) - 0.5 * (beams - 1)), np.float64), ""
        if abs(fov_deg - resolution_deg * beams) <= 0.5 * resolution_deg:
            return beam_angles(beams, math.radians(resolution_deg * steps)), ""
    if fov_deg is not None and resolution_deg is None:
        return beam_angles(beams, math.radians(fov_deg)), ""
    # The parameters are missing, or are those of another laser, e.g. of CARMEN's default settings.
    known = _KNOWN_STEPS_DEG.get(beams)
    if known is not None:
        angles, source = beam_angles(beams, math.radians(known * steps)), "the number of beams"
    elif fov_deg is not None:
        angles, source = beam_angles(beams, math.radians(fov_deg)), "laser_front_laser_fov"
    else:
        angles, source = beam_angles(beams), "the most common field of view"
    if known is not None and given == (None, None):
        return angles, ""
    why = "the log has no PARAM laser_front_laser_resolution or laser_front_laser_fov that fits"
    covered = math.degrees(angles[-1] - angles[0])
    return angles, f"{why} {beams} beams: they are put on {covered:.4g} degrees, by {source}"


def robotlaser_angles(
    beams: int, start_rad: float, step_rad: float, fov_rad: float
) -> tuple[FloatArray, str] | None:
    """Compute the directions of a ROBOTLASER1 or RAWLASER1 line's beams.

    Args:
        beams: number of beams.
        start_rad: direction of the first beam.
        step_rad: angle between two beams.
        fov_rad: field of view.

    Returns:
        (beams,) angles in the laser's frame, rad; and what was assumed, empty if nothing. None if
        the line's numbers make no sweep.
    """
    start_good = abs(start_rad) <= _FULL_TURN  # False for NaN
    if start_good and step_rad > 0.0 and step_rad * (beams - 1) <= _FULL_TURN:
        return np.asarray(start_rad + step_rad * np.arange(beams), np.float64), ""
    if 0.0 < fov_rad <= _FULL_TURN:
        note = (
            f"the laser lines say a start of {start_rad:.4g} rad and a resolution of "
            f"{step_rad:.4g} rad: no sweep; their field of view of {fov_rad:.4g} rad is used"
        )
        return beam_angles(beams, fov_rad), note
    return None
