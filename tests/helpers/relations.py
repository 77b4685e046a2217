"""Relations files for tests of replay."""

from __future__ import annotations


def format_relations(relations):
    """Lines of a relations file from rows of 5 or 8 numbers."""
    return "".join(" ".join(f"{number:.9g}" for number in row) + "\n" for row in relations)
