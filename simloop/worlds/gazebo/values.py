"""Read the values of SDF elements: numbers, flags, names and poses.

A pose is a homogeneous transform (4, 4): lengths in m, from the element's frame to the frame in
which the pose is given. The format is described at http://sdformat.org/spec.
"""

from __future__ import annotations

import math
from xml.etree import ElementTree as Xml

import numpy as np

from simloop.common.errors import InputError
from simloop.common.limits import NAME_CHARACTERS
from simloop.messages import FloatArray

_MOST = 1e6  # a larger number is no length or angle of a world


def numbers(where: str, what: str, text: str | None, count: int) -> list[float]:
    """Read numbers that are separated by spaces.

    Args:
        where: file and model, for the error text.
        what: name of the value, for the error text.
        text: the text of an element.
        count: how many numbers it must have.

    Returns:
        The numbers.

    Raises:
        InputError: the text does not have that many finite, plausible numbers.
    """
    words = (text or "").split(maxsplit=count)
    try:
        # Python alone accepts an underscore between digits.
        values = [float(word) for word in words if "_" not in word]
    except ValueError:
        values = []
    if len(words) != count or len(values) != count or not all(abs(v) <= _MOST for v in values):
        shown = (text or "").strip()[:40]
        raise InputError(f"{where}: {what} '{shown}': not {count} numbers up to {_MOST:g}")
    return values


def child_numbers(where: str, element: Xml.Element, tag: str, count: int) -> list[float]:
    """Read the numbers of an element's child.

    Args:
        where: file and model, for the error text.
        element: the element that has the child.
        tag: name of the child.
        count: how many numbers it must have.

    Returns:
        The numbers.

    Raises:
        InputError: the child is missing, or is not that many numbers.
    """
    return numbers(where, f"{element.tag} {tag}", element.findtext(tag), count)


def is_true(where: str, what: str, text: str | None, otherwise: bool) -> bool:
    """Read a flag.

    Args:
        where: file and model, for the error text.
        what: name of the flag, for the error text.
        text: the text; None or "" if the flag is missing.
        otherwise: the value of a missing flag.

    Returns:
        The flag.

    Raises:
        InputError: the text is neither true nor false.
    """
    word = (text or "").strip().lower()
    if not word:
        return otherwise
    if word not in ("0", "1", "true", "false"):
        raise InputError(f"{where}: {what} '{word[:40]}': must be true or false")
    return word in ("1", "true")


def name_of(element: Xml.Element) -> str:
    """Read the name of an element.

    Args:
        element: any element.

    Returns:
        Its name, or "?"; a long name is cut.
    """
    return (element.get("name") or "?")[:NAME_CHARACTERS]


def relative_to(element: Xml.Element) -> str:
    """Read the name of the frame in which an element's pose is given.

    Args:
        element: an element with a pose.

    Returns:
        The name; "" if none is given. SDF before 1.7 calls it ``frame``.
    """
    pose = element.find("pose")
    return "" if pose is None else (pose.get("relative_to") or pose.get("frame") or "").strip()


def pose_of(where: str, element: Xml.Element) -> FloatArray:
    """Read the pose of an element, in the frame that ``relative_to`` names.

    Args:
        where: file and model, for the error text.
        element: an element with or without a pose.

    Returns:
        (4, 4) the pose; the identity if it is missing or empty.

    Raises:
        InputError: the pose is not one.
    """
    pose = element.find("pose")
    if pose is None or not (pose.text or "").strip():
        return np.eye(4)
    form = pose.get("rotation_format", "euler_rpy").strip()
    degrees = is_true(where, "pose degrees", pose.get("degrees"), False)
    if form == "euler_rpy":
        values = numbers(where, "pose", pose.text, 6)
        angles = [math.radians(v) if degrees else v for v in values[3:]]
        return transform(values[:3], _of_angles(*angles))
    if form == "quat_xyzw" and not degrees:
        values = numbers(where, "pose", pose.text, 7)
        length = math.hypot(*values[3:])
        if not 0.5 <= length <= 2.0:
            raise InputError(f"{where}: pose: its quaternion has length {length:g}, not 1")
        return transform(values[:3], _of_quaternion(*(v / length for v in values[3:])))
    raise InputError(
        f"{where}: pose: rotation_format '{form[:40]}'{' in degrees' if degrees else ''}: "
        "choices: euler_rpy, quat_xyzw (without degrees)"
    )


def transform(
    position_m: list[float] | FloatArray, rotation: FloatArray | None = None
) -> FloatArray:
    """Make a homogeneous transform.

    Args:
        position_m: (3,) position, m.
        rotation: (3, 3) rotation; None: none.

    Returns:
        (4, 4) the transform.
    """
    made = np.eye(4)
    made[:3, 3] = position_m
    if rotation is not None:
        made[:3, :3] = rotation
    return made


def inverse(pose: FloatArray) -> FloatArray:
    """Invert a pose.

    Args:
        pose: (4, 4) a rotation and a position, without scale.

    Returns:
        (4, 4) the inverse.
    """
    turned = pose[:3, :3].T
    return transform(-turned @ pose[:3, 3], turned)


def _of_angles(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Make a rotation (3, 3): about the fixed x, then y, then z axis."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _of_quaternion(x: float, y: float, z: float, w: float) -> FloatArray:
    """Make a rotation (3, 3) of a unit quaternion."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
