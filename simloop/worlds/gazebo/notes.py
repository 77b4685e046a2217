"""Collect what the reader of a Gazebo world leaves out or assumes, to tell it in a few lines."""

from __future__ import annotations

_SHOWN = 3  # names in a line, at most


class Notes:
    """What to tell, with the names of the models that it is about."""

    def __init__(self) -> None:
        """Begin without notes."""
        self._names: dict[str, list[str]] = {}

    def add(self, text: str, name: str) -> None:
        """Add a model to a note.

        Args:
            text: what is left out or assumed. Equal texts become one line.
            name: name of the model.
        """
        names = self._names.setdefault(text, [])
        if not names or names[-1] != name:
            names.append(name)

    def lines(self, file: str) -> tuple[str, ...]:
        """Write the notes.

        Args:
            file: name of the world's file.

        Returns:
            One line for each text.
        """
        return tuple(f"{file}: {text}: {_list(names)}" for text, names in self._names.items())


def _list(names: list[str]) -> str:
    names = list(dict.fromkeys(names))
    more = len(names) - _SHOWN
    return ", ".join(names[:_SHOWN]) + (f" and {more} more" if more > 0 else "")
