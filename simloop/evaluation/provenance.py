"""Where a figure comes from: versions and machine."""

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
    """Of Python and of every package that can change a run."""
    found = {"simloop": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    return {"cpu": _cpu_name(), "cores": os.cpu_count(), "platform": platform.platform(terse=True)}


def _cpu_name() -> str:
    try:
        import cpuinfo
    except ImportError:
        return platform.processor() or platform.machine()
    return str(cpuinfo.get_cpu_info().get("brand_raw") or platform.machine())
