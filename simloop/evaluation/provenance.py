"""Record the origin of a result: versions of the packages, and the machine."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from typing import Any

from simloop import __version__

_PACKAGES = (
    "mujoco",
    "numpy",
    "numba",
    "scipy",
    "filterpy",
    "opencv-python-headless",
    "rerun-sdk",
)


def versions() -> dict[str, str]:
    """List the versions of Python and of every package that can change a run.

    Returns:
        Name to version; ``not installed`` for a missing package.
    """
    found = {"simloop": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def machine() -> dict[str, Any]:
    """Describe the machine on which a result is measured.

    Returns:
        ``cpu``, ``cores`` and ``platform``.
    """
    return {"cpu": _cpu_name(), "cores": os.cpu_count(), "platform": platform.platform(terse=True)}


def _cpu_name() -> str:
    """Read the processor's name, from the optional package py-cpuinfo if it is installed."""
    try:
        import cpuinfo
    except ImportError:
        return platform.processor() or platform.machine()
    return str(cpuinfo.get_cpu_info().get("brand_raw") or platform.machine())
