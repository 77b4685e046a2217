"""Read XML files as trees: without entities, and only up to a depth and a number of elements."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as Xml
from xml.parsers import expat

from simloop.common.errors import InputError
from simloop.common.input_files import read_bytes
from simloop.common.limits import ELEMENTS, NESTING, check_limit

_MOST_BYTES = 32 * 2**20  # a tree takes up to thirty times the memory of its file
# Nothing in these elements is part of a world's collision shapes. Their content is not kept,
# because it is most of a large file.
_CONTENT_UNUSED = frozenset(
    ("visual", "sensor", "plugin", "inertial", "light", "gui", "scene", "physics", "battery")
)


def read_tree(file: Path) -> Xml.Element:
    """Read an XML file.

    Args:
        file: the file.

    Returns:
        The root element. Tags keep their prefix; a default namespace is ignored, as Gazebo does.

    Raises:
        InputError: the file cannot be read, is not XML, or defines a document type or entities,
            which could expand it. The text has one line.
    """
    # Gazebo accepts blank lines before the XML declaration.
    return parse_tree(read_bytes(file, _MOST_BYTES).lstrip(b" \t\r\n"), str(file))


def parse_tree(data: bytes, where: str) -> Xml.Element:
    """Parse the content of an XML file.

    Args:
        data: the content.
        where: name of the file, for the error text.

    Returns:
        The root element.

    Raises:
        InputError: as in ``read_tree``.
    """
    builder = _Builder(where)
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.text
    parser.StartDoctypeDeclHandler = builder.refuse
    parser.EntityDeclHandler = builder.refuse
    try:
        parser.Parse(data, True)
    except InputError:
        raise
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise InputError(f"{where}: not XML: {error}") from None
    return builder.close()


class _Builder:
    """Build the tree from the parser's events, and stop where a limit is passed."""

    def __init__(self, where: str) -> None:
        self._where, self._tree = where, Xml.TreeBuilder()
        self._depth, self._count = 0, 0
        self._unused_at = 0  # depth of the element whose content is not kept; 0: none

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self._depth += 1
        check_limit(self._depth, NESTING, f"{self._where}: depth of nested elements")
        if self._unused_at:
            return
        self._count += 1
        check_limit(self._count, ELEMENTS, f"{self._where}: elements")
        self._tree.start(tag, attributes)
        if tag in _CONTENT_UNUSED:
            self._unused_at = self._depth

    def end(self, tag: str) -> None:
        if not self._unused_at or self._unused_at == self._depth:
            self._unused_at = 0
            self._tree.end(tag)
        self._depth -= 1

    def text(self, data: str) -> None:
        if not self._unused_at:
            self._tree.data(data)

    def refuse(self, *_: object) -> None:
        raise InputError(f"{self._where}: defines a document type or its own entities: refused")

    def close(self) -> Xml.Element:
        return self._tree.close()
