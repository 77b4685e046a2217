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
    ATTRIBUTE_CHARACTERS,
    HEIGHT_POINTS,
    MJCF_BODIES,
    MJCF_CLASSES,
    MJCF_ELEMENTS,
    MJCF_GEOMS,
    MJCF_NUMERIC,
    MJCF_OTHERS,
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
_SHORT = 4  # characters; a shorter text holds no length beyond the largest
_MOST_INCLUDES = 1000
_MOST_PARAMETER = 64  # of a built-in mesh: MuJoCo makes its square or its power of four in faces
_LEFT_OUT = {
    "actuator": "actuators",
    "contact": "contact pairs and exclusions",
    "equality": "equalities",
    "keyframe": "keyframes",
    "sensor": "sensors",
    "tendon": "tendons",
}
"""Sections that an arena may have, and that have no part in a run. They are never parsed."""
_MOST = {"geom": MJCF_GEOMS, "body": MJCF_BODIES, "default": MJCF_CLASSES}
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
        left_out: what was taken out of both, in words.
    """

    text: str
    included: dict[str, bytes]
    left_out: tuple[str, ...]


@dataclass(slots=True)
class _Scan:
    """What has been counted so far, over all files."""

    main: Path
    seen: set[str] = field(default_factory=set)
    included: dict[str, bytes] = field(default_factory=dict)
    left_out: dict[str, None] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    elements: int = 0
    pixels: int = 0
    points: int = 0
    numbers: int = 0


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
    text = _scan_file(state, path, 0, 1)
    return Source(text, state.included, tuple(state.left_out))


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
        self._edits: list[tuple[int, int, bytes]] = []  # start and end in the text, what to write
        self._out: tuple[int, int] | None = None  # depth and start of a section that is left out
        self._data = b""
        self._parser = parser = expat.ParserCreate()
        parser.StartElementHandler, parser.EndElementHandler = self._start, self._end
        parser.StartDoctypeDeclHandler = self._refuse_doctype

    def read(self, text: str) -> str:
        # The declaration's encoding is not used: the file has been read as UTF-8.
        self._data = data = re.sub(rb"^\s*<\?xml.*?\?>", _blank, text.encode(), count=1)
        try:
            self._parser.Parse(data, True)
        except expat.ExpatError as error:
            raise InputError(f"{self._path.name}: not XML: {error}") from None
        for start, end, new in reversed(self._edits):
            lines = data.count(b"\n", start, end) - new.count(b"\n")
            data = data[:start] + new + b"\n" * lines + data[end:]
        return data.decode()

    def _refuse_doctype(self, *_: object) -> None:
        raise InputError(f"{self._where()}: a DOCTYPE is not read")

    def _where(self) -> str:
        return f"{self._path.name}, line {self._parser.CurrentLineNumber}"

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        state, copies = self._state, self._copies[-1]
        depth = self._depth + len(self._copies)
        check_limit(depth, NESTING, f"{self._where()}: depth of nested elements")
        state.elements += copies if self._out is None else 1
        check_limit(state.elements, MJCF_ELEMENTS, f"{self._where()}: elements and their copies")
        if self._out is None and tag in _LEFT_OUT and len(self._copies) == 2:
            self._out = len(self._copies), self._parser.CurrentByteIndex
            state.left_out[_LEFT_OUT[tag]] = None
        if self._out is None:
            copies = self._check(tag, attributes, depth, copies)
        self._copies.append(copies)

    def _check(self, tag: str, attributes: dict[str, str], depth: int, copies: int) -> int:
        """Check one element; return how often what is in it is copied."""
        state = self._state
        if tag in _REFUSED:
            raise InputError(
                f"{self._where()}: <{tag}> cannot be used in an arena: {_REFUSED[tag]}"
            )
        state.counts[tag] = state.counts.get(tag, 0) + copies
        most = _MOST.get(tag, MJCF_OTHERS)
        check_limit(state.counts[tag], most, f"{self._where()}: number of <{printable(tag, 40)}>")
        self._check_numbers(attributes, tag == "numeric")
        self._check_sizes(tag, attributes)
        if tag == "include":
            self._include(attributes.get("file", ""), depth, copies)
        if tag == "replicate":
            copies *= max(1, int(_number(attributes.get("count", "1"))))
            check_limit(copies, MJCF_BODIES, f"{self._where()}: copies of an element")
        return copies

    def _end(self, _: str) -> None:
        self._copies.pop()
        if self._out is not None and self._out[0] == len(self._copies):
            end = self._data.index(b">", self._parser.CurrentByteIndex) + 1
            self._edits.append((self._out[1], end, b""))
            self._out = None

    def _include(self, name: str, depth: int, copies: int) -> None:
        state = self._state
        path = find_include(name, state.main, self._path, self._where())
        if os.path.realpath(path) in state.seen:
            raise InputError(f"{self._where()}: {printable(name, 200)} is included twice")
        key = f"included_{len(state.included)}.xml"
        state.included[key] = b""  # takes the name before the files that this one includes
        state.included[key] = _scan_file(state, path, depth, copies).encode()
        start = self._parser.CurrentByteIndex
        end = self._data.index(b">", start)
        end -= self._data[end - 1 : end] == b"/"
        self._edits.append((start, end, b'<include file="' + key.encode() + b'"'))

    def _check_numbers(self, attributes: dict[str, str], is_numeric: bool) -> None:
        """Refuse numbers that are not finite, and lengths that are too far away."""
        for key, value in attributes.items():
            where = f"{self._where()}: {key}"
            check_limit(len(value), ATTRIBUTE_CHARACTERS, f"{where}: characters")
            lengths = key in _LENGTHS and not is_numeric and len(value) > _SHORT
            if key in _TEXTS and not is_numeric:
                continue
            if not lengths and not _NOT_FINITE.search(value):
                continue
            for word in value.split():
                if _NOT_FINITE.fullmatch(word):
                    raise InputError(f"{where}: {word} is not a number to use")
                if lengths:
                    check_limit(abs(_number(word)), MJCF_REACH_M, where, "m")

    def _check_sizes(self, tag: str, attributes: dict[str, str]) -> None:
        """Refuse what takes much memory, and is written in few characters."""
        state, where = self._state, self._where()
        if tag == "texture":
            width, height = (_number(attributes.get(key, "0")) for key in ("width", "height"))
            flat = attributes.get("type") == "2d"
            state.pixels += int(abs(width * height) if flat else 6.0 * width * width)
            check_limit(state.pixels, TEXTURE_PIXELS, f"{where}: pixels of textures")
        if tag == "hfield":
            rows, columns = (_number(attributes.get(key, "0")) for key in ("nrow", "ncol"))
            state.points += int(abs(rows * columns))
            check_limit(state.points, HEIGHT_POINTS, f"{where}: points of height fields")
        if tag == "numeric":
            written = len(attributes.get("data", "").split())
            state.numbers += int(max(written, abs(_number(attributes.get("size", "0")))))
            check_limit(state.numbers, MJCF_NUMERIC, f"{where}: numbers of <numeric>")
        if tag == "mesh" and "builtin" in attributes:
            for word in attributes.get("params", "").split():
                check_limit(abs(_number(word)), _MOST_PARAMETER, f"{where}: params")


def _blank(found: re.Match[bytes]) -> bytes:
    """Replace a match by as many spaces, and keep its line breaks."""
    return re.sub(rb"[^\n]", b" ", found.group())


def _number(word: str) -> float:
    """Read a number as MuJoCo does; 0 for what is none, which MuJoCo refuses itself."""
    try:
        number = float(word)
    except ValueError:
        return 0.0
    return max(-1e150, min(number, 1e150)) if math.isfinite(number) else 1e150
