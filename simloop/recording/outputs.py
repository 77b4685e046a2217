"""The output files of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simloop.common.errors import InputError
from simloop.common.files import FilePlan, make_directory, write_text, written_together
from simloop.common.json_text import json_text
from simloop.scenario.save import to_toml
from simloop.scenario.scenario import Scenario

PICTURES = (*(f"moment_{number}.png" for number in range(1, 9)), "contact_sheet.png")
"""Names of the pictures in the folder ``snapshots``."""


@dataclass(frozen=True, slots=True)
class Outputs:
    """The output files of a run. A file that is not requested is None.

    Attributes:
        recording: Recording for the rerun viewer.
        snapshots: Folder for pictures.
        result: Metrics as JSON.
        config: Effective scenario, beside the result.
        folder: Folder of all of them, which no other process may use meanwhile.
    """

    recording: Path | None = None
    snapshots: Path | None = None
    result: Path | None = None
    config: Path | None = None
    folder: Path | None = None

    def check(self, read: Path | Mapping[Path, str] | None = None) -> None:
        """Check that everything can be written. Nothing is left on the disk.

        Args:
            read: What each file is that describes the run, see `scenario.inputs`; or the
                scenario's file alone. No output may replace one of them.

        Raises:
            InputError: An output cannot be written, or it would replace another file of the run.
        """
        plan = FilePlan()
        if isinstance(read, Path):
            plan.reads(read, "the scenario itself")
        elif read is not None:
            plan.reads_all(read)
        plan.writes_into(self.folder, "--out")
        plan.writes(self.recording, "--record")
        plan.writes(self.result, "--json")
        plan.writes(self.config, "config")
        plan.writes_into(self.snapshots, "--snapshots", PICTURES)
        plan.check()
        if self.recording is not None and self.recording.suffix not in ("", ".rrd"):
            raise InputError(f"--record {self.recording}: a recording for rerun must end in .rrd")

    def prepare(self) -> None:
        """Create the folders of the files.

        Raises:
            InputError: A folder cannot be created.
        """
        for file in (self.recording, self.result, self.config):
            if file is not None:
                make_directory(file.parent)
        for folder in (self.folder, self.snapshots):
            if folder is not None:
                make_directory(folder)

    def write_result(
        self,
        metrics: Mapping[str, Any],
        scenario: Scenario | None = None,
        versions: Mapping[str, str] | None = None,
    ) -> None:
        """Write the metrics as JSON, together with the effective scenario.

        Args:
            metrics: The metrics of the run.
            scenario: The scenario of the run; None to leave the file of the scenario as it is.
            versions: Versions of the packages.

        Raises:
            InputError: A file cannot be written. Then there is neither, unless both are those of
                an earlier run.
        """
        if self.result is None:
            return
        old = self.result.exists()
        try:
            with written_together() as files:
                files.write_text(self.result, json_text(dict(metrics)))
                if self.config is not None and scenario is not None:
                    files.write_text(self.config, to_toml(scenario, versions))
        except InputError:
            if not old and self.config is not None and self.config.is_file():
                self.config.unlink()
            raise

    def announce(self, scenario: Scenario, versions: Mapping[str, str]) -> None:
        """Write the effective scenario before the run, unless an earlier result is beside it.

        Then the two would not belong together until the run ends.

        Args:
            scenario: The scenario of the run.
            versions: Versions of the packages.

        Raises:
            InputError: The file cannot be written.
        """
        if self.result is not None and not self.result.exists():
            self.write_config(scenario, versions)

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
