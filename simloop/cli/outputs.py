"""Convert the output options of ``simloop run`` into output files."""

from __future__ import annotations

from pathlib import Path

from simloop.common.errors import InputError
from simloop.common.input_files import is_special
from simloop.recording.outputs import Outputs


def choose(
    out: Path | None, recording: Path | None, snapshots: Path | None, result: Path | None
) -> Outputs:
    """Decide which files are written.

    Args:
        out: The folder of ``--out``, which selects all outputs. Another option may give a file a
            different place.
        recording: The file of ``--record``.
        snapshots: The folder of ``--snapshots``.
        result: The file of ``--json``. The effective scenario is written to the same directory,
            unless this is a device or a pipe, whose directory is not the user's.

    Returns:
        The output files.

    Raises:
        InputError: ``--json`` names no file.
    """
    if result is not None and not result.name:
        raise InputError(f"--json '{result}': not a file")
    if out is not None:
        recording = recording or out / "run.rrd"
        snapshots = snapshots or out / "snapshots"
        result = result or out / "result.json"
        return Outputs(recording, snapshots, result, out / "config.toml", out)
    beside = result is not None and not is_special(result)
    config = result.with_suffix(".config.toml") if result is not None and beside else None
    return Outputs(recording, snapshots, result, config)
