# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""POSES.csv: one row per epoch of a drive, localized or not."""

import csv
import io
import math
import os
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_file, locked
from maxcon.drive.localize import EpochEstimate
from maxcon.errors import FileError
from maxcon.estimate import Status
from maxcon.scan.trajectory import Trajectory

UNKNOWNS = ("x", "y", "z", "roll", "pitch", "heading")
COVARIANCES = tuple(f"cov_{UNKNOWNS[row]}_{UNKNOWNS[column]}" for row in range(6) for column in range(row, 6))
PROTECTION_LEVELS = ("protection_along", "protection_across")
COLUMNS = ("time", *UNKNOWNS, "score", "status", "ms", *PROTECTION_LEVELS, *COVARIANCES, "reason")
FORMATS = {
    "time": ".9f", "ms": ".2f", "score": ".6g",
    **dict.fromkeys(("x", "y", "z", *PROTECTION_LEVELS), ".4f"),
    **dict.fromkeys(("roll", "pitch", "heading"), ".9f"),
    **dict.fromkeys(COVARIANCES, ".6g"),
}  # fmt: skip
"""How the numbers of a column are rounded: tenths of a millimetre, nanoradians."""
# A row has some 400 characters; a longer line is another kind of file.
MAX_ROW = 10_000


def write_poses(path: str | os.PathLike[str], epochs: Sequence[EpochEstimate]) -> None:
    """Write time (s), pose (global, m, rad), score, status and milliseconds of every epoch, and how sure it is.

    That is the protection level along and across the heading, m, and the upper triangle of the covariance of x, y, z,
    roll, pitch and heading, row by row, axes of the CRS, m^2, m rad and rad^2. Pose, level and covariance are empty
    unless the status is "localized": a row cannot be mistaken for a pose. The reason is empty where the status says
    all. FileError if it cannot be written.
    """
    with atomic_file(path) as partial:
        partial.write_bytes(_encoded([list(COLUMNS), *map(_row, epochs)]))


def _encoded(rows: list[list[str]]) -> bytes:
    text = io.StringIO(newline="")
    csv.writer(text).writerows(rows)
    return text.getvalue().encode("utf-8")


@dataclass(frozen=True, slots=True)
class RowsThere:
    """The part of a table that an earlier call has written.

    n_rows: whole rows, below the header.
    n_localized: how many of them have the status "localized".
    n_bytes, size: bytes of the header and the whole rows, and of the file: a killed writer may have left a part of a
        row.
    """

    n_rows: int = 0
    n_localized: int = 0
    n_bytes: int = 0
    size: int = 0


def rows_there(path: str | os.PathLike[str], times: NDArray[np.float64]) -> RowsThere:
    """Return the part of a table of scans at `times` (s) that has been written; empty if there is no file.

    FileError if it cannot be read, or its rows are not those of the first scans.
    """
    try:
        with Path(path).open("rb") as file:
            return _rows_of(Path(path), file, times)
    except FileNotFoundError:
        return RowsThere()
    except OSError as error:
        raise FileError(f"Expected to be able to read {path}, got: {error.strerror}. Name another.") from error


def _rows_of(path: Path, file: BinaryIO, times: NDArray[np.float64]) -> RowsThere:
    def refuse(got: str) -> FileError:
        return FileError(
            f"Expected {path} to be a table of these scans, to go on with it, got {got}. Was it made of another"
            " drive, or by another version? Name another, or replace it (--overwrite)."
        )

    n_rows, n_localized, n_bytes = -1, 0, 0
    while line := file.readline(MAX_ROW):
        if not line.endswith(b"\n"):
            if len(line) == MAX_ROW:
                raise refuse(f"a line of over {MAX_ROW} characters")
            if n_rows < 0:
                raise refuse("no header")
            break  # the rest of a row whose writer was killed
        try:
            cells = next(csv.reader([line.decode("utf-8").rstrip("\r\n")], strict=True), [])
        except (UnicodeDecodeError, csv.Error):
            raise refuse("bytes that are no table") from None
        if n_rows < 0 and tuple(cells) != COLUMNS:
            raise refuse(f"another header, {line[:40].decode(errors='replace').strip()!r}")
        if n_rows >= 0:
            if n_rows == len(times) or len(cells) != len(COLUMNS) or cells[0] != f"{times[n_rows]:.9f}":
                raise refuse(f"row {n_rows} of the time {cells[0][:20] if cells else ''!r}")
            n_localized += cells[COLUMNS.index("status")] == Status.LOCALIZED.value
        n_rows += 1
        n_bytes += len(line)
    return RowsThere(max(n_rows, 0), n_localized, n_bytes, file.seek(0, 2))


class GrowingTable:
    """POSES.csv while a drive is localized: the row of each epoch is in the file once that is done.

    The first row makes the file, or replaces the one that was there, in one step; each other one is appended. What is
    there when the process is killed can be gone on with. Rows of scans that cannot be read wait for the first that can:
    where there is none, nothing is written.

    path: of the table.
    there: rows to continue; None to begin anew.
    """

    def __init__(self, path: str | os.PathLike[str], there: RowsThere | None = None) -> None:
        self._path = Path(path)
        self._there = there or RowsThere()
        self._waiting: list[EpochEstimate] = []
        self._file: BinaryIO | None = None
        self._stack = ExitStack()
        self.n_rows = self._there.n_rows
        """Rows in the file."""

    def add(self, epoch: EpochEstimate) -> None:
        """Write the row of the next epoch; FileError if it cannot be written, or another process is at the table."""
        self._waiting.append(epoch.without_points())
        if self.n_rows == 0 and epoch.status is Status.UNREADABLE:
            return
        rows, self._waiting = self._waiting, []
        if self._file is None:
            lock = self._path.with_name(f".{self._path.name}.lock")
            self._stack.enter_context(locked(lock, f"the table {self._path}"))
            if self.n_rows == 0:
                write_poses(self._path, rows)
            self._file = self._opened()
        if self.n_rows > 0:
            self._append(self._file, rows)
        self.n_rows += len(rows)

    def _opened(self) -> BinaryIO:
        """Return the file, to append to, without the part of a row at its end."""
        file = self._stack.enter_context(self._path.open("ab"))
        if self.n_rows > 0:
            if file.seek(0, 2) != self._there.size:
                raise FileError(
                    f"Expected {self._path} as it was a moment ago, but it has grown. Is another process at work on it?"
                )
            file.truncate(self._there.n_bytes)
        return file

    def _append(self, file: BinaryIO, rows: Sequence[EpochEstimate]) -> None:
        left, size = _encoded([_row(row) for row in rows]), file.seek(0, 2)
        try:
            while left:  # a disk that is nearly full takes a part
                left = left[os.write(file.fileno(), left) :]
        except OSError as error:
            with suppress(OSError):
                file.truncate(size)
            raise FileError(
                f"Expected to be able to write a row to {self._path}, got: {error.strerror}. Make room for it."
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()


def pose_values(epoch: EpochEstimate) -> dict[str, Any]:
    """Return what is known of an epoch, by the names of the columns, not rounded; a column left out has no value."""
    values: dict[str, Any] = {"time": epoch.raw.time, "status": epoch.status.value}
    values |= {"ms": epoch.milliseconds, "reason": " ".join(epoch.reason.split())}
    if epoch.estimate is not None:
        values["score"] = epoch.estimate.score
    if epoch.pose_global is None or epoch.estimate is None:
        return values
    values |= {name: getattr(epoch.pose_global, name) for name in UNKNOWNS}
    covariance = epoch.estimate.covariance[np.triu_indices(6)]
    if np.isfinite(covariance).all():
        values |= dict(zip(COVARIANCES, covariance.tolist(), strict=True))
        levels = zip(PROTECTION_LEVELS, epoch.estimate.protection_level, strict=True)
        values |= {name: level for name, level in levels if math.isfinite(level)}
    return values


def _row(epoch: EpochEstimate) -> list[str]:
    """Return the cells of an epoch's row, rounded as `FORMATS` says; empty where there is no value."""
    values = pose_values(epoch)
    return [format(values[name], FORMATS.get(name, "")) if name in values else "" for name in COLUMNS]


def localized_trajectory(epochs: Sequence[EpochEstimate]) -> Trajectory | None:
    """Return the localized poses as a trajectory, None if there is none."""
    found = [(epoch.raw.time, epoch.pose_global) for epoch in epochs if epoch.pose_global is not None]
    if not found:
        return None
    return Trajectory.from_poses([time for time, _ in found], [pose for _, pose in found])
