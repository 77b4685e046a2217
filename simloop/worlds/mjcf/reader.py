"""Read an arena: only what stands and lies in it, with none of its own physics.

An arena is parsed and compiled by itself, as MuJoCo alone reads it. What would change the vehicle's
physics is left out, and named: options, sizes, joints' defaults, contact rules, actuators.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from simloop.common.errors import InputError, printable
from simloop.common.limits import LOOSE_BODIES, check_limit
from simloop.physics.engine import warnings_heard
from simloop.worlds.mjcf.files import settle_files
from simloop.worlds.mjcf.scan import scan

_LONGEST = 8  # names that are listed in a note
_SIZES = (
    "nuser_body", "nuser_jnt", "nuser_geom", "nuser_site", "nuser_cam", "nuser_tendon",
    "nuser_actuator", "nuser_sensor",
)  # fmt: skip
_MASS_RULES = {"settotalmass": -1.0, "boundmass": 0.0, "boundinertia": 0.0, "balanceinertia": 0}
_STRUCTURE_RULES = ("discardvisual", "fusestatic")


def read_spec(path: Path) -> tuple[mujoco.MjSpec, mujoco.MjModel, list[str]]:
    """Parse an arena and compile it by itself.

    Args:
        path: the arena's file.

    Returns:
        The specification, which has only bodies, geoms, cameras, lights, sites, assets and
        numerics; its compiled model, in which a geom has the number that is its ``id``; and what
        was left out, for the user.

    Raises:
        InputError: the file cannot be used. The text has one line.
    """
    source = scan(path)
    said: list[str] = []
    if source.left_out:
        said.append(
            f"left out, because an arena only stands and lies: {', '.join(source.left_out)}"
        )
    with _warnings_kept(said):
        spec = _quietly(path, mujoco.MjSpec.from_string, source.text, include=source.included)
        check_limit(len(spec.joints), LOOSE_BODIES, f"{path.name}: joints")
        spec.modelfiledir = str(path.resolve().parent)
        settle_files(spec, path.resolve().parent)
        said += _drop_rules(spec)
        _check_elements(spec)
        model = _quietly(path, spec.compile)
    if not np.all(np.isfinite(model.geom_pos)) or not np.all(np.isfinite(model.geom_size)):
        raise InputError("a geom has a position or size that is not a number")
    return spec, model, said


def _quietly(path: Path, function: Any, *arguments: Any, **named: Any) -> Any:
    """Call MuJoCo, and make one line of its error."""
    try:
        return function(*arguments, **named)
    except (ValueError, TypeError, RuntimeError, mujoco.FatalError) as error:
        raise InputError(f"{path.name}: {error}") from None


@contextmanager
def _warnings_kept(said: list[str]) -> Iterator[None]:
    """Collect MuJoCo's warnings, from its log and from its compiler."""
    with warnings_heard() as heard, warnings.catch_warnings(record=True) as raised:
        warnings.simplefilter("always")
        yield
    texts = dict.fromkeys([*heard, *(str(one.message) for one in raised)])
    said += [f"MuJoCo: {printable(text, 300)}" for text in texts]


def _drop_rules(spec: mujoco.MjSpec) -> list[str]:
    """Set options, sizes and the compiler's rules of mass to MuJoCo's own, and name them."""
    plain, names = mujoco.MjSpec(), []
    for key in fields_of(spec.option):
        theirs, ours = getattr(spec.option, key), getattr(plain.option, key)
        if not np.array_equal(theirs, ours, equal_nan=True):
            names += _flags(key, int(theirs)) if key.endswith("ableflags") else [f"option {key}"]
            setattr(spec.option, key, ours)
    for key, none in _MASS_RULES.items():
        if getattr(spec.compiler, key) != none:
            names.append(f"compiler {key}")
            setattr(spec.compiler, key, none)
    for key in _STRUCTURE_RULES:
        if getattr(spec.compiler, key):
            names.append(f"compiler {key}")
            setattr(spec.compiler, key, 0)
    for key in ("memory", "njmax", "nconmax", "nstack", "nuserdata", "nkey", *_SIZES):
        if getattr(spec, key) != getattr(plain, key):
            names.append(f"size {key}")
            setattr(spec, key, getattr(plain, key))
    spec.compiler.conflict = plain.compiler.conflict
    for key in ("meaninertia", "meanmass", "meansize"):
        setattr(spec.stat, key, getattr(plain.stat, key))
    if not names:
        return []
    return [f"not used, because the vehicle's own are: {', '.join(names)}"]


def fields_of(section: Any) -> list[str]:
    """List the attributes of a part of a specification, e.g. its options.

    Args:
        section: the part.

    Returns:
        Their names.
    """
    return [name for name in dir(section) if not name.startswith("_")]


def _flags(key: str, bits: int) -> list[str]:
    """Name the flags that differ from MuJoCo's, e.g. ``flag contact``."""
    kinds = mujoco.mjtDisableBit if key == "disableflags" else mujoco.mjtEnableBit
    return [
        f"option flag {name.removeprefix('mjDSBL_').removeprefix('mjENBL_').lower()}"
        for name, kind in kinds.__members__.items()
        if not name.startswith("mjN") and bits & int(kind.value)
    ]


def _check_elements(spec: mujoco.MjSpec) -> None:
    """Raise InputError for what `scan` should have refused or left out, should it miss a way in."""
    kinds = ("flexes", "skins", "plugins", "sensors", "actuators", "tendons", "equalities")
    for kind in (*kinds, "excludes", "pairs", "keys"):
        if len(getattr(spec, kind)):
            raise InputError(f"{kind} cannot be used in an arena")


def listed(names: list[str]) -> str:
    """Join names for a note.

    Args:
        names: names from a file; an empty one is a geom without a name.

    Returns:
        At most the first eight, safe to print.
    """
    shown = [printable(name, 40) or "(no name)" for name in names[:_LONGEST]]
    more = len(names) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")
