"""The output files of a run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simloop.common.errors import InputError
from simloop.common.files import check_directory, check_file, write_text
from simloop.scenario.save import to_toml
from simloop.scenario.scenario import Scenario


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where a run's results go; None where nobody asked. ``config`` lies beside the result."""

    recording: Path | None = None
    snapshots: Path | None = None
    result: Path | None = None
    config: Path | None = None

    def check(self, source: Path | None = None) -> None:
        """Raise InputError for anything that cannot be written; leaves no trace.

        source: the file that the run is described in, which no output may take the place of.
        """
        taken = {} if source is None else {source.resolve(): "the scenario itself"}
        named = (("--record", self.recording), ("--json", self.result), ("config", self.config))
        for flag, file in named:
            if file is not None and not (file.exists() and not file.is_file()):
                if file.resolve() in taken:
                    raise InputError(f"{flag} {file}: would overwrite {taken[file.resolve()]}")
                taken[file.resolve()] = f"what {flag} writes"
        for flag, file in (("--record", self.recording), ("--json", self.result)):
            if file is not None:
                check_file(file, flag)
        if self.config is not None:
            check_file(self.config, "--json")
        if self.snapshots is not None:
            check_directory(self.snapshots, "--snapshots")

    def prepare(self) -> None:
        """Make the directories that the files need."""
        for file in (self.recording, self.result, self.config):
            if file is not None:
                _make(file.parent)
        if self.snapshots is not None:
            _make(self.snapshots)

    def write_result(self, metrics: Mapping[str, Any]) -> None:
        """The metrics as JSON."""
        if self.result is not None:
            write_text(self.result, json.dumps(metrics, indent=2, allow_nan=False) + "\n")

    def write_config(self, scenario: Scenario, versions: Mapping[str, str]) -> None:
        """The effective scenario, which ``simloop run`` takes again for the same run."""
        if self.config is not None:
            write_text(self.config, to_toml(scenario, versions))


def choose(
    out: Path | None, recording: Path | None, snapshots: Path | None, result: Path | None
) -> Outputs:
    """What the options ask for: ``--out DIR`` means everything, unless named apart."""
    if result is not None and not result.name:
        raise InputError(f"--json '{result}': not a file")
    if out is not None:
        check_directory(out, "--out")
        recording = recording or out / "run.rrd"
        snapshots = snapshots or out / "snapshots"
        result = result or out / "result.json"
        return Outputs(recording, snapshots, result, out / "config.toml")
    config = result.with_suffix(".config.toml") if result else None
    return Outputs(recording, snapshots, result, config)


def _make(directory: Path) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{directory}: cannot be made: {error.strerror}") from None
