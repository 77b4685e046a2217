"""Where a figure comes from: versions and machine."""

from __future__ import annotations

import platform
from importlib import metadata

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
