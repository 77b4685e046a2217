"""An open recording file of rerun, and the methods that write a run to it."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from simloop.common.errors import InputError
from simloop.common.files import temporary_name
from simloop.messages import FloatArray
from simloop.recording.columns import lifted

if TYPE_CHECKING:
    import rerun.blueprint as rrb

TIMELINE = "sim_time"
_FLUSH_TIMEOUT_S = 10.0
_PARTING_S = 2.0

_log = logging.getLogger(__name__)


class RecordingFile:
    """A recording that stays readable up to its last flush after any failure.

    It is written under a temporary name beside its own, ``run.partial-<random>.rrd``, and gets its
    own name when it is whole. A recording that was cut keeps the temporary name.

    Attributes:
        rr: The recording library.
        is_open: Whether the file still accepts data.
        path: The file as it is named now.
    """

    def __init__(self, path: Path, blueprint: rrb.Blueprint, title: str) -> None:
        """Open the file.

        Args:
            path: The file.
            blueprint: Arrangement of the recording in the viewer.
            title: Title of the recording; may be empty.

        Raises:
            OSError: The file cannot be opened.
        """
        # Make the file here first, because the library's error for a bad path is not an OSError.
        special = path.exists() and not path.is_file()  # a device or a FIFO cannot be replaced
        try:
            str(path).encode("utf-8")  # the library takes no other names
            self.path = path if special else temporary_name(path)
        except UnicodeEncodeError:
            raise OSError(f"cannot record to {path}: its name is not UTF-8") from None
        except InputError as error:
            raise OSError(str(error)) from None
        self._target = path
        # On a full disk the library's own log has three lines. ``_give_up`` writes one line.
        os.environ.setdefault("RUST_LOG", "off")
        import rerun as rr

        self.rr, self.is_open = rr, True
        self._flushed_bytes = 0
        self._stream = rr.RecordingStream("simloop")
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        try:
            self._stream.save(self.path, blueprint)
        except RuntimeError as error:
            self._stream.disconnect()
            self._remove()
            raise OSError(f"cannot record to {path}: {error}") from None
        if title:
            self._stream.send_recording_name(title)

    def log_static(self, entity: str, *what: Any) -> None:
        """Write something that does not change during the run.

        Args:
            entity: Its path in the recording.
            what: Archetypes of the library.
        """
        self._stream.log(entity, *what, static=True)

    def log_at(self, entity: str, t_ns: int, what: Any) -> None:
        """Write something for one instant.

        Args:
            entity: Its path in the recording.
            t_ns: Simulated time, ns.
            what: An archetype of the library.
        """
        self._stream.set_time(TIMELINE, duration=np.timedelta64(t_ns, "ns"))
        self._stream.log(entity, what)

    def send(self, entity: str, t_ns: Sequence[int] | FloatArray, columns: Any) -> None:
        """Write many instants at once. This costs the library as much as one instant.

        Args:
            entity: Path in the recording.
            t_ns: (N,) simulated times, ns.
            columns: Columns of the library, N rows.
        """
        times = np.asarray(t_ns, dtype=np.int64).astype("timedelta64[ns]")
        column = self.rr.TimeColumn(TIMELINE, duration=times)
        self.rr.send_columns(entity, [column], columns, recording=self._stream)

    def send_scalars(self, entity: str, t_ns: Sequence[int] | FloatArray, values: Any) -> None:
        """Write a plot.

        Args:
            entity: Path below ``plots/``.
            t_ns: (N,) simulated times, ns.
            values: (N,) values, or (N, k) for k lines.
        """
        self.send(f"plots/{entity}", t_ns, self.rr.Scalars.columns(scalars=values))

    def send_strips(
        self,
        entity: str,
        t_ns: Sequence[int],
        rows: Sequence[Sequence[FloatArray]],
        height_m: float,
    ) -> None:
        """Write line strips in a horizontal plane.

        Args:
            entity: Path in the recording.
            t_ns: (N,) simulated times, ns.
            rows: N lists of strips (n, 2), m.
            height_m: Height of the plane.
        """
        flat = [lifted(strip, height_m) for row in rows for strip in row]
        columns = self.rr.LineStrips3D.columns(strips=flat)
        self.send(entity, t_ns, columns.partition([len(row) for row in rows]))

    def send_points(
        self, entity: str, t_ns: Sequence[int], rows: Sequence[FloatArray], height_m: float
    ) -> None:
        """Write points in a horizontal plane.

        Args:
            entity: Path in the recording.
            t_ns: (N,) simulated times, ns.
            rows: N arrays of points (n, 2), m.
            height_m: Height of the plane.
        """
        columns = self.rr.Points3D.columns(positions=lifted(np.concatenate(rows), height_m))
        self.send(entity, t_ns, columns.partition([len(row) for row in rows]))

    def send_transforms(
        self, entity: str, t_ns: Sequence[int], places_m: FloatArray, wxyz: FloatArray
    ) -> None:
        """Write poses in the parent's frame.

        Args:
            entity: Path in the recording.
            t_ns: (N,) simulated times, ns.
            places_m: (N, 3) positions, m.
            wxyz: (N, 4) attitudes.
        """
        xyzw = wxyz[:, [1, 2, 3, 0]]
        columns = self.rr.Transform3D.columns(translation=places_m, quaternion=xyzw)
        self.send(entity, t_ns, columns)

    def flush(self) -> None:
        """Write to disk. If that fails, log one line and accept no more data."""
        try:
            self._stream.flush(timeout_sec=_FLUSH_TIMEOUT_S)
            self._flushed_bytes = self.path.stat().st_size
        except (RuntimeError, TimeoutError, ValueError, OSError) as error:
            self._give_up(error)

    def close(self, whole: bool = True) -> None:
        """Write the footer and close. May be called twice.

        Args:
            whole: Whether the recording is complete, so that the file gets its own name.

        Raises:
            OSError: The file cannot be renamed.
        """
        if self.is_open:
            self.is_open = False
            self._stream.disconnect()
            if whole and self.path != self._target:
                self.path.replace(os.path.realpath(self._target))
                self.path = self._target

    def _remove(self) -> None:
        """Remove a recording that could not begin."""
        if self.path != self._target:
            self.path.unlink(missing_ok=True)

    def _give_up(self, error: Exception) -> None:
        """Log the error, and cut off the incomplete end, which a strict reader rejects."""
        self.is_open = False
        _log.error(
            "recording stopped, it is kept up to its last complete write in %s: %s",
            self.path,
            error,
        )
        # The library may wait for ever for its dead writer, here and again when Python exits.
        parting = threading.Thread(target=self._stream.disconnect, daemon=True)
        parting.start()
        parting.join(_PARTING_S)
        if parting.is_alive():
            self.rr.unregister_shutdown()
        with contextlib.suppress(OSError):
            os.truncate(self.path, self._flushed_bytes)
