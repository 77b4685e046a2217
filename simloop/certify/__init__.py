"""A certificate for the tracks: the simulated vehicle against closed forms, check by check.

Each family of checks is a generator; what theory says comes from ``track_theory``, which knows
nothing of the simulator. See docs/tracks.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from simloop.certify.checks import Check

Family = Callable[[], Iterator[Check]]


def families() -> dict[str, Family]:
    """Every family by its name, in the order of the table."""
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
    """The checks of the families named, or of all, one by one as they are done."""
    for name, family in families().items():
        if not only or name in only:
            yield from family()


def passed(checks: Sequence[Check]) -> bool:
    """Whether all hold that count."""
    return all(check.ok for check in checks if not check.informative)


def figures(checks: Sequence[Check]) -> dict[str, Any]:
    """What ``--json`` writes, but for versions and machine; comparison: MuJoCo's own friction."""
    return {
        "ok": passed(checks),
        "checks": [check.as_dict() for check in checks if not check.informative],
        "comparison": [check.as_dict() for check in checks if check.informative],
    }
