"""Inputs after public reports, in a folder beside the clone that not every machine has."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

_BESIDE = Path(__file__).resolve().parents[2].parent / "shared"


def shared_case(name: str) -> Path:
    """Return a case's folder; skip the test if it is absent.

    Args:
        name: The folder's name below ``cases``.
    """
    folder = Path(os.environ.get("SIMLOOP_SHARED", _BESIDE)) / "cases" / name
    if not folder.is_dir():
        pytest.skip(f"{folder} is not on this machine")
    return folder
