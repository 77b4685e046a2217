"""The certificate of the tracks: checks of the simulated vehicle against closed forms.

Each family of checks is a generator. The closed forms are in `track_theory` and `turning_theory`,
which use no code of the simulator. docs/tracks.md explains the forms and their ranges.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from simloop.certify.checks import Check

Family = Callable[[], Iterator[Check]]


def families() -> dict[str, Family]:
    """List the families of checks.

    Returns:
        All families by name, in the order of the table.
    """
    from simloop.certify import ground, native, pulling, slopes, turning

    return {
        "spin": turning.spin,
        "turn": turning.steady,
        "moment": turning.sideways,
        "payload": turning.payload,
        "straight": pulling.straight,
        "slip": pulling.slip_curve,
        "bollard": pulling.bollard,
        "motor": pulling.motors,
        "wheels": pulling.free_wheels,
        "brakes": slopes.braked,
        "shorted": slopes.unpowered,
        "climbing": slopes.climbing,
        "slopes": slopes.driven,
        "braking": slopes.braking,
        "tipping": slopes.tipping,
        "energy": ground.energy,
        "steps": ground.steps,
        "timestep": ground.steps_agree,
        "ramps": ground.ramps,
        "rough": ground.rough,
        "zones": ground.zones,
        "loose": ground.loose,
        "walls": ground.walls,
        "native": native.native,
    }


def run(only: Sequence[str] = ()) -> Iterator[Check]:
    """Run the checks, one by one.

    Args:
        only: names of families to run; empty: all.

    Yields:
        Each check when it is done.
    """
    for name, family in families().items():
        if not only or name in only:
            yield from family()


def passed(checks: Sequence[Check]) -> bool:
    """Tell whether the certificate holds.

    Args:
        checks: the checks that were run.

    Returns:
        True if every check holds that is not informative only.
    """
    return all(check.ok for check in checks if not check.informative)


def figures(checks: Sequence[Check]) -> dict[str, Any]:
    """Collect the results for ``--json``, without versions and machine.

    Args:
        checks: the checks that were run.

    Returns:
        ``ok``, the ``checks``, and the ``comparison`` with MuJoCo's own friction.
    """
    return {
        "ok": passed(checks),
        "checks": [check.as_dict() for check in checks if not check.informative],
        "comparison": [check.as_dict() for check in checks if check.informative],
    }
