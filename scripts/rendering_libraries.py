"""Make sure that pictures can be drawn without a display: EGL or OSMesa must be there.

Where neither is, install Debian's packages if root; otherwise print the line to run.
Needs nothing but the standard library, and never fails: a run without pictures is a run.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys

PACKAGES = ("libegl1", "libgl1", "libgl1-mesa-dri", "libosmesa6")


def loads(library: str) -> bool:
    """Whether the dynamic loader finds the library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def can_render() -> bool:
    """Whether MuJoCo has an offscreen back end to draw with."""
    egl = loads("libEGL.so.1") and loads("libGL.so.1")
    return egl or loads("libOSMesa.so.8") or loads("libOSMesa.so.6")


def install() -> None:
    """Install the packages one by one: releases differ in which of them exist."""
    env = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    subprocess.run(["apt-get", "update", "-qq"], env=env, check=False)
    for package in PACKAGES:
        command = ["apt-get", "install", "-qq", "-y", "--no-install-recommends", package]
        subprocess.run(command, env=env, check=False, stdout=subprocess.DEVNULL)


def main() -> None:
    if sys.platform != "linux" or can_render():
        return
    if shutil.which("apt-get") and os.geteuid() == 0:
        print("installing Debian's offscreen rendering libraries")
        install()
    if not can_render():
        print(
            "no offscreen rendering library found, so no pictures; to have them:\n"
            f"  sudo apt-get update && sudo apt-get install -y {' '.join(PACKAGES)}"
        )


if __name__ == "__main__":
    main()
