"""The small inputs beside the repository that users' reports led to."""

from __future__ import annotations

from pathlib import Path

import pytest

_BESIDE = (Path(__file__).parents[2] / ".." / "shared" / "cases").resolve()


def case(name: str) -> Path:
    """Find the folder of a case, or skip the test.

    Args:
        name: The folder's name.

    Returns:
        The folder.
    """
    folder = _BESIDE / name
    if not folder.is_dir():
        pytest.skip(f"no folder ../shared/cases/{name} beside the repository")
    return folder
