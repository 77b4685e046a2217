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
    """The output files of a run. A file that is not requested is None.

    Attributes:
        recording: Recording for the rerun viewer.
        snapshots: Folder for pictures.
        result: Metrics as JSON.
        config: Effective scenario, beside the result.
    """

    recording: Path | None = None
    snapshots: Path | None = None
    result: Path | None = None
    config: Path | None = None

    def check(self, source: Path | None = None) -> None:
        """Check that everything can be written. Nothing is left on the disk.

        Args:
            source: The file that describes the run. No output may replace it.

        Raises:
            InputError: An output cannot be written, or it would replace another file of the run.
        """
        taken = {} if source is None else {source.resolve(): "the scenario itself"}
        named = (("--record", self.recording), ("--json", self.result), ("config", self.config))
        for flag, file in named:
            if file is not None and not (file.exists() and not file.is_file()):
                if file.resolve() in taken:
                    raise InputError(f"{flag} {file}: would overwrite {taken[file.resolve()]}")
                taken[file.resolve()] = f"the output of {flag}"
        for flag, file in (("--record", self.recording), ("--json", self.result)):
            if file is not None:
                check_file(file, flag)
        if self.config is not None:
            check_file(self.config, "--json")
        if self.snapshots is not None:
            check_directory(self.snapshots, "--snapshots")
        if self.recording is not None and self.recording.suffix not in ("", ".rrd"):
            raise InputError(f"--record {self.recording}: a recording for rerun must end in .rrd")

    def prepare(self) -> None:
        """Create the folders of the files.

        Raises:
            InputError: A folder cannot be created.
        """
        for file in (self.recording, self.result, self.config):
            if file is not None:
                _make(file.parent)
        if self.snapshots is not None:
            _make(self.snapshots)

    def write_result(self, metrics: Mapping[str, Any]) -> None:
        """Write the metrics as JSON.

        Args:
            metrics: The metrics of the run.

        Raises:
            InputError: The file cannot be written.
        """
        if self.result is not None:
            write_text(self.result, json.dumps(metrics, indent=2, allow_nan=False) + "\n")

    def write_config(self, scenario: Scenario, versions: Mapping[str, str]) -> None:
        """Write the effective scenario. ``simloop run`` repeats the run from it.

        Args:
            scenario: The scenario of the run.
            versions: Versions of the packages.

        Raises:
            InputError: The file cannot be written.
        """
        if self.config is not None:
            write_text(self.config, to_toml(scenario, versions))


def _make(directory: Path) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{directory}: cannot be created: {error.strerror}") from None
