"""Find the files that an arena names, and check them before MuJoCo reads them."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import mujoco

from simloop.common.data_files import models_dir
from simloop.common.errors import InputError, printable
from simloop.common.input_files import read_bytes
from simloop.common.limits import HEIGHT_POINTS, MESH_BYTES, TEXTURE_PIXELS, check_limit

MODEL_PATH = "SIMLOOP_MODEL_PATH"
"""Environment variable with further folders from which an arena may include files."""
_PNG = b"\x89PNG\r\n\x1a\n"


def find_include(name: str, main: Path, by: Path, where: str) -> Path:
    """Find a file that an arena includes.

    It is looked for beside the arena's own file, as MuJoCo does, beside the file that includes it,
    and among simloop's arenas, so that a copied arena finds what it includes.

    Args:
        name: the file as it is written in the arena.
        main: the arena's own file.
        by: the file with the ``<include>``.
        where: start of the error text.

    Returns:
        The file.

    Raises:
        InputError: it does not exist, or is in a folder that nobody has named.
    """
    own = models_dir() / "arenas"
    for folder in (main.parent, by.parent, own):
        if name and _is_file(folder / name):
            return _allowed(folder / name, main.parent, where)
    raise InputError(f"{where}: no file {printable(name, 200)!r} to include")


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # e.g. a name that is too long, or a loop of links
        return False


def _allowed(path: Path, folder: Path, where: str) -> Path:
    """Return the path if it is below the arena's folder, simloop's models or a named folder."""
    named = [Path(one) for one in os.environ.get(MODEL_PATH, "").split(os.pathsep) if one]
    at = Path(os.path.realpath(path))  # unlike Path.resolve, without an error for a loop of links
    folders = [os.path.realpath(one) for one in (folder, models_dir(), *named)]
    if not any(at.is_relative_to(one) for one in folders):
        raise InputError(
            f"{where}: {printable(str(at), 200)} is outside the arena's folder: to include it all "
            f"the same, name its folder in {MODEL_PATH}"
        )
    return path


def settle_files(spec: mujoco.MjSpec, folder: Path) -> None:
    """Give the files of meshes, textures and height fields their absolute paths, and check them.

    So the arena keeps its own ``meshdir`` and ``texturedir`` when it is joined with the vehicle,
    and the working directory does not matter.

    Args:
        spec: the arena, not compiled yet; changed.
        folder: the folder of the arena's file.

    Raises:
        InputError: a file does not exist or is too large.
    """
    pixels = 0
    for mesh in spec.meshes:
        if mesh.file:
            mesh.file = str(_find(mesh.file, spec, spec.compiler.meshdir, folder))
            read_bytes(Path(mesh.file), MESH_BYTES)
    for field in spec.hfields:
        if field.file:
            field.file = str(_find(field.file, spec, spec.compiler.meshdir, folder))
            check_limit(_pixels(Path(field.file)), HEIGHT_POINTS, f"{field.file}: points")
    for texture in spec.textures:
        if texture.file:
            texture.file = str(_find(texture.file, spec, spec.compiler.texturedir, folder))
            pixels += _pixels(Path(texture.file))
        for side, file in enumerate(texture.cubefiles):
            if file:
                found = _find(file, spec, spec.compiler.texturedir, folder)
                texture.cubefiles[side] = str(found)
                pixels += _pixels(found)
        check_limit(pixels, TEXTURE_PIXELS, f"texture {printable(texture.name, 80)}: pixels")


def _find(name: str, spec: mujoco.MjSpec, below: str, folder: Path) -> Path:
    """Find the file of an asset as MuJoCo does, or among simloop's arenas."""
    written = Path(name)
    if spec.strippath:
        written = Path(name.replace("\\", "/").rpartition("/")[2])
    for start in (folder, models_dir() / "arenas"):
        path = start / below / written
        if written.name and _is_file(path):
            return path.absolute()
    raise InputError(f"no file {printable(str(folder / below / written), 300)}")


def _pixels(path: Path) -> int:
    """Read the number of points of a PNG or of a height field, from the file's first bytes."""
    head = read_bytes(path, MESH_BYTES)[:24]
    if head.startswith(_PNG) and len(head) == 24:
        width, height = struct.unpack(">II", head[16:24])
        return int(width * height)
    rows, columns = struct.unpack("<ii", head[:8]) if len(head) >= 8 else (0, 0)
    # Of any other format, e.g. a texture without a head, the file's size is the limit.
    return int(rows * columns) if path.suffix.lower() not in (".ktx", ".png") else 0
