"""Journal: a campaign's folder with the request and every finished run.

campaign.json     the request
journal.jsonl     one line for each finished run, written to disk before the next run counts; a line
                  that a kill cut off is dropped, and its run is repeated
results.parquet   all rows in the order of the request, written when the campaign stops
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Protocol

from simloop.campaign.spec import RunSpec
from simloop.campaign.work import Row
from simloop.common.errors import InputError
from simloop.common.files import check_directory, write_bytes, write_text


class Asked(Protocol):
    """What a journal needs to know of a request.

    Attributes:
        condition: Why a saved request is refused, for the error message.
    """

    @property
    def condition(self) -> str: ...

    def to_table(self) -> dict[str, Any]:
        """Convert the request for JSON.

        Returns:
            Its values by name, among them ``scenarios`` and ``seeds``.
        """
        ...

    def extends(self, other: dict[str, Any]) -> bool:
        """Tell whether the runs of a saved request can be used for this one.

        Args:
            other: The saved request, in the form of ``to_table``.

        Returns:
            True if they can.
        """
        ...


class Journal:
    """The finished runs of a campaign. Use it as a context; only one process may open a folder.

    Attributes:
        rows: The row of each finished run, by ``RunSpec.key``.
    """

    def __init__(self, folder: Path, request: Asked) -> None:
        """Prepare a journal. Nothing is read or written before the context is entered.

        Args:
            folder: The campaign's folder.
            request: What the campaign runs.
        """
        self._folder, self._request = folder, request
        self.rows: dict[str, Row] = {}
        self._file: IO[bytes] | None = None

    def __enter__(self) -> Journal:
        """Lock the folder and read the finished runs.

        Raises:
            InputError: If the folder cannot be written, another process is using it, it holds
                another campaign, or its files are damaged.
        """
        check_directory(self._folder, "--out")
        self._folder.mkdir(parents=True, exist_ok=True)
        file = (self._folder / "journal.jsonl").open("a+b")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            file.close()
            raise InputError(
                f"{self._folder}: another process is running a campaign there"
            ) from None
        try:
            self._take_over(file)
        except InputError:
            file.close()
            raise
        self._file = file
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    def add(self, spec: RunSpec, row: Row) -> None:
        """Add a finished run. Once this returns, the run is on the disk and cannot be lost.

        Args:
            spec: The run.
            row: Its row.

        Raises:
            RuntimeError: If the journal's context is not entered.
            OSError: If the disk is full.
        """
        if self._file is None:
            raise RuntimeError("the journal is not open")
        line = json.dumps({"key": spec.key, "row": row}) + "\n"
        self._file.write(line.encode())
        self._file.flush()
        os.fsync(self._file.fileno())
        self.rows[spec.key] = row

    def missing(self, specs: Sequence[RunSpec]) -> list[RunSpec]:
        """Choose the runs that are not finished yet.

        Args:
            specs: Runs.

        Returns:
            Those of them that the journal lacks, in their order.
        """
        return [spec for spec in specs if spec.key not in self.rows]

    def _take_over(self, file: IO[bytes]) -> None:
        asked = self._folder / "campaign.json"
        if asked.exists():
            self._check_request(asked)
        write_text(asked, json.dumps(self._request.to_table(), indent=2) + "\n")
        file.seek(0)
        whole = 0
        for line in file:
            if not line.endswith(b"\n"):
                break  # cut off by a kill: this run is repeated
            try:
                entry = json.loads(line)
                self.rows[entry["key"]] = entry["row"]
            except (ValueError, KeyError, TypeError):
                where = f"{self._folder}/journal.jsonl, byte {whole}"
                raise InputError(
                    f"{where}: not a line of a campaign's journal; the file is damaged"
                ) from None
            whole += len(line)
        file.truncate(whole)

    def _check_request(self, asked: Path) -> None:
        try:
            before = json.loads(asked.read_text(encoding="utf-8"))
            seeds, scenarios = before["seeds"], before["scenarios"]
        except (OSError, ValueError, KeyError, TypeError):
            raise InputError(f"{asked}: cannot be read as a campaign's request") from None
        if not self._request.extends(before):
            raise InputError(
                f"{self._folder}: holds another campaign ({', '.join(scenarios)}, seeds "
                f"{seeds[0]}:{seeds[1]}); {self._request.condition}, so give another --out"
            )


def write_results(folder: Path, rows: Sequence[Row]) -> Path:
    """Write ``results.parquet``. After an interruption, the file is either complete or missing.

    Args:
        folder: The campaign's folder.
        rows: The rows. A column that a row lacks is empty there.

    Returns:
        The file.

    Raises:
        InputError: If the file cannot be written.
    """
    import io

    import pyarrow as pa
    from pyarrow import parquet

    names = dict.fromkeys(name for row in rows for name in row)
    columns = {name: _column(pa, [row.get(name) for row in rows]) for name in names}
    data = io.BytesIO()
    parquet.write_table(pa.table(columns), data)
    file = folder / "results.parquet"
    write_bytes(file, data.getvalue())
    return file


def read_results(path: Path) -> list[Row]:
    """Read the results of a campaign.

    Args:
        path: The campaign's folder, or its Parquet file.

    Returns:
        The rows.

    Raises:
        InputError: If there is no such file, or it does not hold a campaign's results.
    """
    import pyarrow as pa
    from pyarrow import parquet

    file = path / "results.parquet" if path.is_dir() else path
    try:
        rows: list[Row] = parquet.read_table(file).to_pylist()
    except (OSError, pa.ArrowException) as error:
        reason = "no such file" if not file.exists() else str(error).splitlines()[0]
        raise InputError(f"{file}: {reason}") from None
    needed = {"scenario", "planner", "sweep", "seed", "outcome", "success"}
    if not rows or not needed <= rows[0].keys():
        columns = ", ".join(sorted(needed))
        raise InputError(f"{file}: not a campaign's results; it needs rows with {columns}")
    return rows


def _column(pa: Any, values: list[Any]) -> Any:
    """Make a column; a figure may be an int in one row and a float in another."""
    if any(isinstance(value, float) for value in values):
        values = [None if value is None else float(value) for value in values]
    return pa.array(values)
