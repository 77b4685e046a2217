"""Make sure that images can be rendered without a display. This needs EGL or OSMesa.

If neither is installed, this script installs Debian's packages as root, or prints the command. It
needs only the standard library. It never fails, because a run is complete without images.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys

PACKAGES = ("libegl1", "libgl1", "libgl1-mesa-dri", "libosmesa6")


def loads(library: str) -> bool:
    """Tell whether the dynamic loader finds a library.

    Args:
        library: its file name.

    Returns:
        True if it can be loaded.
    """
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def can_render() -> bool:
    """Tell whether MuJoCo has an offscreen back end.

    Returns:
        True with EGL or OSMesa.
    """
    egl = loads("libEGL.so.1") and loads("libGL.so.1")
    return egl or loads("libOSMesa.so.8") or loads("libOSMesa.so.6")


def install() -> None:
    """Install the packages one by one, because not every release has all of them."""
    env = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    subprocess.run(["apt-get", "update", "-qq"], env=env, check=False)
    for package in PACKAGES:
        command = ["apt-get", "install", "-qq", "-y", "--no-install-recommends", package]
        subprocess.run(command, env=env, check=False, stdout=subprocess.DEVNULL)


def main() -> None:
    """Install the missing packages, or print the command for it."""
    if sys.platform != "linux" or can_render():
        return
    if shutil.which("apt-get") and os.geteuid() == 0:
        print("installing Debian's offscreen rendering libraries")
        install()
    if not can_render():
        print(
            "no offscreen rendering library found, so no images will be rendered; install one:\n"
            f"  sudo apt-get update && sudo apt-get install -y {' '.join(PACKAGES)}"
        )


if __name__ == "__main__":
    main()
