"""Journal: a campaign's folder with the request and every finished run.

campaign.json     the request, with hashes of all files that it names, and the versions
journal.jsonl     one line for each finished run, written to disk before the next run counts; a line
                  that a kill cut off is dropped, and its run is repeated
results.parquet   all rows in the order of the request, written when the campaign stops
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Protocol

from simloop.campaign.journal_lines import Damaged, scan
from simloop.campaign.spec import RunSpec
from simloop.campaign.summary import wrong_column
from simloop.campaign.work import ERROR, Row
from simloop.common.errors import InputError
from simloop.common.files import check_directory, write_bytes, write_text
from simloop.common.input_files import read_text
from simloop.common.limits import JOURNAL_BYTES, check_limit

_NEEDED = {
    "scenario": str, "planner": str, "sweep": str, "seed": int, "outcome": str, "success": bool,
}  # fmt: skip
_REPAIR = "--repair keeps what is whole"


class Asked(Protocol):
    """What a journal needs to know of a request."""

    def to_table(self) -> dict[str, Any]:
        """Convert the request for JSON.

        Returns:
            Its values by name, among them ``scenarios`` and ``seeds``.
        """
        ...

    def refusal(self, mine: dict[str, Any], other: dict[str, Any]) -> str:
        """Tell why the runs of a saved request cannot be used for this one.

        Args:
            mine: This request, in the form of ``to_table``.
            other: The saved request, in the same form.

        Returns:
            The reason; empty if they can be used.
        """
        ...

    def cells(self) -> Sequence[RunSpec]:
        """List one run of each cell.

        Returns:
            The runs.
        """
        ...


class Journal:
    """The finished runs of a campaign. Use it as a context; only one process may open a folder.

    Attributes:
        rows: The row of each finished run, by ``RunSpec.key``.
        notes: What was dropped or repaired, a line each, for the user.
    """

    def __init__(self, folder: Path, request: Asked, *, repair: bool = False) -> None:
        """Prepare a journal. Nothing is read or written before the context is entered.

        Args:
            folder: The campaign's folder.
            request: What the campaign runs.
            repair: Whether damaged files are repaired. A copy of each is kept.
        """
        self._folder, self._request, self._repair = folder, request, repair
        self.rows: dict[str, Row] = {}
        self.notes: list[str] = []
        self._file: IO[bytes] | None = None
        self._made: list[Path] = []

    @property
    def _path(self) -> Path:
        return self._folder / "journal.jsonl"

    def __enter__(self) -> Journal:
        """Lock the folder and read the finished runs.

        Raises:
            InputError: If the folder cannot be written, another process is using it, it holds
                another campaign, or its files are damaged.
        """
        check_directory(self._folder, "--out")
        missing = [one for one in (self._folder, *self._folder.parents) if not one.exists()]
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._made = [*reversed(missing)]
            self._file = self._lock()
            self._take_over(self._file)
        except InputError:
            self._leave(undo=True)
            raise
        except OSError as error:
            self._leave(undo=True)
            raise InputError(f"{self._path}: cannot be used: {error.strerror}") from None
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self._leave(undo=kind is not None and issubclass(kind, InputError) and not self.rows)

    def add(self, spec: RunSpec, row: Row) -> None:
        """Add a finished run. Once this returns, the run is on the disk and cannot be lost.

        Args:
            spec: The run.
            row: Its row.

        Raises:
            RuntimeError: If the journal's context is not entered.
            InputError: If the line cannot be written, e.g. because the disk is full.
        """
        if self._file is None:
            raise RuntimeError("the journal is not open")
        _append(self._file, json.dumps({"key": spec.key, "row": row}).encode() + b"\n", self._path)
        self.rows[spec.key] = row

    def missing(self, specs: Sequence[RunSpec]) -> list[RunSpec]:
        """Choose the runs that are not finished yet.

        Args:
            specs: Runs.

        Returns:
            Those of them that the journal lacks, in their order.
        """
        return [spec for spec in specs if spec.key not in self.rows]

    def forget_errors(self, specs: Sequence[RunSpec]) -> int:
        """Count the runs with the outcome ``error`` as not finished, so that they are done again.

        Their lines stay in the file, and the new ones follow.

        Args:
            specs: Runs.

        Returns:
            The number of those of them that ended so.
        """
        wrong = [spec.key for spec in specs if self.rows.get(spec.key, {}).get("outcome") == ERROR]
        for key in wrong:
            del self.rows[key]
        return len(wrong)

    def _lock(self) -> IO[bytes]:
        is_new = not self._path.exists()
        if not is_new and not self._path.is_file():
            raise InputError(f"{self._path}: not a regular file")
        # Unbuffered: after a failed write, nothing is left that a close would write once more.
        file = self._path.open("a+b", buffering=0)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            raise InputError(
                f"{self._folder}: another process is running a campaign there"
            ) from None
        except OSError as error:
            file.close()
            raise InputError(f"{self._path}: cannot be locked: {error.strerror}") from None
        if not self._path.exists() or not os.path.samestat(
            os.fstat(file.fileno()), self._path.stat()
        ):
            file.close()  # removed by a campaign that ended between the two lines above
            raise InputError(f"{self._folder}: another process has just used it; try again")
        self._made += [self._path] if is_new else []
        return file

    def _leave(self, *, undo: bool) -> None:
        """Close the file. ``undo`` also removes what was made, if no run is lost with it."""
        made = reversed(self._made) if undo else ()
        for path in made:
            with suppress(OSError):  # a folder that is not empty stays
                path.rmdir() if path.is_dir() else path.unlink()
        if self._file is not None:
            self._file.close()
            self._file = None

    def _take_over(self, file: IO[bytes]) -> None:
        """Check the request, read all lines and write the present request."""
        check_limit(os.fstat(file.fileno()).st_size, JOURNAL_BYTES, f"{self._path}: size", "bytes")
        mine, asked = self._request.to_table(), self._folder / "campaign.json"
        before = self._read_request(asked)
        if before is not None and (reason := self._request.refusal(mine, before)):
            scenarios, seeds = before["scenarios"], before["seeds"]
            raise InputError(
                f"{self._folder}: holds another campaign ({', '.join(scenarios)}, seeds "
                f"{seeds[0]}:{seeds[1]}); {reason}, so give another --out"
            )
        self._read_lines(file)
        if before is None and self.rows:
            self._check_keys(asked)
        self._made += [] if asked.exists() else [asked]
        write_text(asked, json.dumps(mine, indent=2) + "\n")

    def _read_request(self, asked: Path) -> dict[str, Any] | None:
        """Read the saved request; None if there is none, or a damaged one is put aside."""
        if not asked.exists():
            return None
        try:
            before = json.loads(read_text(asked))
            seeds, scenarios = before["seeds"], before["scenarios"]
            good = len(seeds) == 2 and all(type(seed) is int for seed in seeds)
            if good and all(isinstance(name, str) for name in scenarios):
                return dict(before)
        except (ValueError, KeyError, TypeError, RecursionError):
            pass
        if not self._repair:
            raise InputError(f"{asked}: cannot be read as a campaign's request; {_REPAIR}")
        copy = _copy(asked)
        self.notes.append(f"{asked}: not a campaign's request; made anew, the old file is {copy}")
        return None

    def _check_keys(self, asked: Path) -> None:
        """Refuse runs whose request is lost, unless they are runs of this one."""
        if not self._repair:
            raise InputError(f"{asked}: missing, although there are runs; --repair makes it anew")
        cells = {json.dumps(json.loads(one.key)[:-1]) for one in self._request.cells()}
        if any(json.dumps(json.loads(key)[:-1]) not in cells for key in self.rows):
            raise InputError(f"{self._path}: holds runs of another campaign; give another --out")

    def _read_lines(self, file: IO[bytes]) -> None:
        """Read all rows. What is damaged is refused, or repaired if that is asked for."""
        wrong: list[tuple[int, Damaged]] = []
        ended = True
        with self._path.open("rb") as lines:
            for found in scan(lines):
                line, error = found.line, found.error
                if error is not None and line.torn and not found.entries and not wrong:
                    # The last line, cut off by a kill: its run is repeated.
                    file.truncate(line.start)
                    self.notes.append(
                        f"{self._path}, byte {line.start}: the last line is cut off "
                        f"({len(line.data)} bytes); dropped, its run is repeated"
                    )
                elif error is not None:
                    wrong.append((line.start + error.offset, error))
                    if not self._repair:
                        raise InputError(f"{self._path}, byte {wrong[0][0]}: {error}; {_REPAIR}")
                else:
                    ended = line.ended
                self.rows |= {key: row for _, key, row in found.entries}
        if wrong:
            self._rewrite(file, wrong)
        elif not ended:  # the last line lacks nothing but its line break
            _append(file, b"\n", self._path)

    def _rewrite(self, file: IO[bytes], wrong: Sequence[tuple[int, Damaged]]) -> None:
        """Write the whole lines, after a copy of the damaged file is on the disk."""
        copy, kept = _copy(self._path), 0
        # Written in place: a new file would not be locked.
        file.truncate(0)
        with copy.open("rb") as lines:
            for found in scan(lines):
                _append(file, b"".join(data for data, *_ in found.entries), self._path, sync=False)
                kept += len(found.entries)
        os.fsync(file.fileno())
        at, reason = wrong[0]
        self.notes.append(
            f"{self._path}: {len(wrong)} damaged lines, the first at byte {at} ({reason}); "
            f"{kept} whole ones are kept, the old file is {copy}"
        )


def _append(file: IO[bytes], data: bytes, path: Path, *, sync: bool = True) -> None:
    """Write to the end of the file and to the disk, or write nothing."""
    size = os.fstat(file.fileno()).st_size
    try:
        rest = memoryview(data)
        while rest:
            rest = rest[file.write(rest) :]
        if sync:
            os.fsync(file.fileno())
    except OSError as error:
        with suppress(OSError):
            file.truncate(size)
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def _copy(path: Path) -> Path:
    """Keep a copy of a damaged file, under a name that is not taken."""
    number = 1
    while True:
        copy = path.with_name(f"{path.name}.damaged{'' if number == 1 else f'-{number}'}")
        try:
            with path.open("rb") as old, copy.open("xb") as file:
                shutil.copyfileobj(old, file)
                file.flush()
                os.fsync(file.fileno())
            return copy
        except FileExistsError:
            number += 1
        except OSError as error:
            raise InputError(f"{copy}: cannot be written: {error.strerror}") from None


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
    file = folder / "results.parquet"
    write_bytes(file, parquet_of(rows))
    return file


def parquet_of(rows: Sequence[Row]) -> bytes:
    """Make a Parquet file of rows.

    Args:
        rows: The rows. A column that a row lacks is empty there.

    Returns:
        The content of the file.
    """
    import io

    import pyarrow as pa
    from pyarrow import parquet

    names = dict.fromkeys(name for row in rows for name in row)
    columns = {name: _column(pa, [row.get(name) for row in rows]) for name in names}
    data = io.BytesIO()
    parquet.write_table(pa.table(columns), data)
    return data.getvalue()


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
    if not rows or not all(
        type(row.get(name)) is kind for row in rows for name, kind in _NEEDED.items()
    ):
        columns = ", ".join(f"{name} ({kind.__name__})" for name, kind in _NEEDED.items())
        raise InputError(f"{file}: not a campaign's results; it needs rows with {columns}")
    if name := wrong_column(rows):
        raise InputError(f"{file}: column {name}: not a number in every row")
    return rows


def _column(pa: Any, values: list[Any]) -> Any:
    """Make a column; a figure may be an int in one row and a float in another."""
    if any(isinstance(value, float) for value in values):
        values = [None if value is None else float(value) for value in values]
    return pa.array(values)
