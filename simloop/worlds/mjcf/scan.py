"""Look through an arena's XML before MuJoCo reads it.

MuJoCo takes the memory that a file asks for, reads every file that it names, and ends the process
on some inputs. So the text is looked through first: size, depth, number of elements, sizes of what
is made from numbers, files that are included, and elements that cannot be part of an arena.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from simloop.common.errors import InputError, printable
from simloop.common.input_files import read_text
from simloop.common.limits import (
    MJCF_ELEMENTS,
    MJCF_REACH_M,
    NESTING,
    TEXTURE_PIXELS,
    check_limit,
)
from simloop.worlds.mjcf.files import find_include

_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_NOT_FINITE = re.compile(r"[+-]?(nan|inf)(inity|\([^)]*\))?", re.IGNORECASE)
_LENGTHS = frozenset(
    {
        "pos",
        "size",
        "fromto",
        "scale",
        "vertex",
        "offset",
        "refpos",
        "elevation",
        "extent",
        "center",
    }
)
_TEXTS = frozenset({"name", "class", "childclass", "model", "file", "data"})
_MOST_INCLUDES = 1000
_MOST_PARAMETER = 64  # of a built-in mesh: MuJoCo makes its square or its power of four in faces
_REFUSED = {
    "attach": "write <include> instead",
    "composite": "write its bodies out",
    "deformable": "an arena is made of rigid geoms",
    "extension": "plugins are not loaded",
    "flexcomp": "an arena is made of rigid geoms",
    "model": "write <include> instead",
    "plugin": "plugins are not loaded",
    "skin": "an arena is made of rigid geoms",
}


@dataclass(frozen=True, slots=True)
class Source:
    """The text of an arena as MuJoCo gets it.

    Attributes:
        text: the arena's own file; its includes have the names that are keys of ``included``.
        included: the texts of the included files.
    """

    text: str
    included: dict[str, bytes]


@dataclass(slots=True)
class _Scan:
    """What has been counted so far, over all files."""

    main: Path
    seen: set[str] = field(default_factory=set)
    included: dict[str, bytes] = field(default_factory=dict)
    elements: int = 0
    pixels: int = 0


def scan(path: Path) -> Source:
    """Read an arena's file and all that it includes, and check them.

    Args:
        path: the arena's file.

    Returns:
        The texts for MuJoCo.

    Raises:
        InputError: a file cannot be read, is too large or too deep, is not XML, includes a file
            from an unnamed folder, or has an element or a number that an arena must not have.
    """
    state = _Scan(path)
    return Source(_scan_file(state, path, 0, 1), state.included)


def _scan_file(state: _Scan, path: Path, depth: int, copies: int) -> str:
    """Check one file, and return it with its includes renamed. It stands at ``depth``."""
    if depth > NESTING or len(state.seen) > _MOST_INCLUDES:
        raise InputError(f"{path.name}: included too deeply, or too many files are included")
    state.seen.add(os.path.realpath(path))
    # MuJoCo accepts '--' within a comment, and XML does not.
    text = _COMMENT.sub(lambda found: "\n" * found.group().count("\n"), read_text(path))
    if "\0" in text:
        raise InputError(f"{path.name}: has a character NUL, so it is not XML")
    reader = _Reader(state, path, depth, copies)
    return reader.read(text)


class _Reader:
    """Reads one file with expat, which holds no tree, so that depth costs nothing."""

    def __init__(self, state: _Scan, path: Path, depth: int, copies: int) -> None:
        self._state, self._path, self._depth = state, path, depth
        self._copies = [copies]  # of what is inside each open element
        self._renamed: list[tuple[int, str]] = []  # places of includes in the text, in bytes
        self._parser = parser = expat.ParserCreate()
        parser.StartElementHandler, parser.EndElementHandler = self._start, self._end
        parser.StartDoctypeDeclHandler = self._refuse_doctype

    def read(self, text: str) -> str:
        data = text.encode()
        try:
            # The declaration's encoding is not used: the file has been read as UTF-8.
            self._parser.Parse(re.sub(rb"^\s*<\?xml.*?\?>", _blank, data, count=1), True)
        except expat.ExpatError as error:
            raise InputError(f"{self._path.name}: not XML: {error}") from None
        for at, name in reversed(self._renamed):
            end = data.index(b">", at)
            slash = b"/" if data[end - 1 : end] == b"/" else b""
            lines = b"\n" * data.count(b"\n", at, end)
            tag = b'<include file="' + name.encode() + b'"' + lines + slash
            data = data[:at] + tag + data[end:]
        return data.decode()

    def _refuse_doctype(self, *_: object) -> None:
        raise InputError(f"{self._where()}: a DOCTYPE is not read")

    def _where(self) -> str:
        return f"{self._path.name}, line {self._parser.CurrentLineNumber}"

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        state, copies = self._state, self._copies[-1]
        depth = self._depth + len(self._copies)
        check_limit(depth, NESTING, f"{self._where()}: depth of nested elements")
        if tag in _REFUSED:
            raise InputError(
                f"{self._where()}: <{printable(tag, 40)}> cannot be used in an arena: "
                f"{_REFUSED[tag]}"
            )
        state.elements += copies
        check_limit(state.elements, MJCF_ELEMENTS, f"{self._where()}: elements")
        self._check_numbers(tag, attributes)
        if tag == "include":
            self._include(attributes.get("file", ""), depth, copies)
        if tag == "replicate":
            copies *= max(1, int(_number(attributes.get("count", "1"))))
            check_limit(copies, MJCF_ELEMENTS, f"{self._where()}: copies of an element")
        self._copies.append(copies)

    def _end(self, _: str) -> None:
        self._copies.pop()

    def _include(self, name: str, depth: int, copies: int) -> None:
        state = self._state
        path = find_include(name, state.main, self._path, self._where())
        if os.path.realpath(path) in state.seen:
            raise InputError(f"{self._where()}: {printable(name, 200)} is included twice")
        key = f"included_{len(state.included)}.xml"
        state.included[key] = b""  # takes the name before the files that this one includes
        state.included[key] = _scan_file(state, path, depth, copies).encode()
        self._renamed.append((self._parser.CurrentByteIndex, key))

    def _check_numbers(self, tag: str, attributes: dict[str, str]) -> None:
        """Refuse what is not finite or too far away, and sizes that take much memory."""
        for key, value in attributes.items():
            if key in _TEXTS and not (tag == "numeric" and key == "data"):
                continue
            if not _NOT_FINITE.search(value) and (key not in _LENGTHS or len(value) < 5):
                continue
            for word in value.split():
                if _NOT_FINITE.fullmatch(word):
                    raise InputError(f"{self._where()}: {key}: {word} is not a number to use")
                if key in _LENGTHS and tag != "numeric":
                    far = f"{self._where()}: {key}"
                    check_limit(abs(_number(word)), MJCF_REACH_M, far, "m")
        if tag == "texture":
            width, height = (_number(attributes.get(key, "0")) for key in ("width", "height"))
            flat = attributes.get("type") == "2d"
            self._state.pixels += int(abs(width * height) if flat else 6.0 * width * width)
            check_limit(self._state.pixels, TEXTURE_PIXELS, f"{self._where()}: pixels of textures")
        if tag == "hfield":
            cells = _number(attributes.get("nrow", "0")) * _number(attributes.get("ncol", "0"))
            check_limit(cells, TEXTURE_PIXELS, f"{self._where()}: points of a height field")
        if tag == "mesh" and "builtin" in attributes:
            for word in attributes.get("params", "").split():
                check_limit(abs(_number(word)), _MOST_PARAMETER, f"{self._where()}: params")


def _blank(found: re.Match[bytes]) -> bytes:
    """Replace a match by as many spaces, and keep its line breaks."""
    return re.sub(rb"[^\n]", b" ", found.group())


def _number(word: str) -> float:
    """Read a number as MuJoCo does; 0 for what is none, which MuJoCo refuses itself."""
    try:
        number = float(word)
    except ValueError:
        return 0.0
    return min(number, 1e300) if math.isfinite(number) else 1e300
