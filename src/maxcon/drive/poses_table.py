"""Tables of poses, one row per epoch, localized or not: POSES.csv of a drive, and a Parquet dataset of many."""

import csv
import hashlib
import io
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_file, locked, write_json
from maxcon._system.checked import checked, read_json
from maxcon._system.regular_file import sha256_of_file
from maxcon._system.resumable import ResumableTable, differences
from maxcon.drive.localize import EpochEstimate
from maxcon.errors import FileError, OptionError
from maxcon.estimate import Status
from maxcon.map.manifest import MANIFEST, MAX_MANIFEST_BYTES
from maxcon.map.storage import address_of, open_storage
from maxcon.scan.trajectory import Trajectory

if TYPE_CHECKING:
    import pyarrow

UNKNOWNS = ("x", "y", "z", "roll", "pitch", "heading")
COVARIANCES = tuple(f"cov_{UNKNOWNS[row]}_{UNKNOWNS[column]}" for row in range(6) for column in range(row, 6))
PROTECTION_LEVELS = ("protection_along", "protection_across")
SHIFTS = ("shift_x", "shift_y", "shift_z", "shift_heading_deg")
SIGMAS = ("sigma_x", "sigma_y", "sigma_z", "sigma_heading_deg")
FORMATS = {
    "time": ".9f", "epoch": "d", "scan": "", "x": ".4f", "y": ".4f", "z": ".4f",
    "roll": ".9f", "pitch": ".9f", "heading": ".9f",
    "score": ".6g", "status": "", "ms": ".2f",
    **dict.fromkeys((*SHIFTS, *SIGMAS, *PROTECTION_LEVELS), ".4f"), **dict.fromkeys(COVARIANCES, ".6g"), "crs": "",
    "reason": "",
}  # fmt: skip
"""The columns, and how their numbers are rounded in POSES.csv: tenths of a millimetre, nanoradians; none of texts."""
COLUMNS = tuple(FORMATS)
OPTIONS, SOURCES = "_options.json", "_drives.json"
LARGEST_HASHED = 2**26  # bytes; larger files (recordings) are known by path and size instead of their checksum


def pose_values(epoch: EpochEstimate) -> dict[str, Any]:
    """Return what is known of an epoch, by the names of the columns, not rounded; a column left out has no value."""
    texts = {"scan": epoch.raw.name, "status": epoch.status.value, "reason": epoch.reason}  # not all is UTF-8 in names
    values: dict[str, Any] = {"time": epoch.raw.time, "epoch": epoch.epoch, "ms": epoch.milliseconds}
    values |= {name: " ".join(text.encode(errors="replace").decode().split()) for name, text in texts.items()}
    if epoch.estimate is not None:
        values["score"] = epoch.estimate.score
    if epoch.pose_global is None or epoch.estimate is None:
        return values
    values |= {name: getattr(epoch.pose_global, name) for name in UNKNOWNS} | {"crs": epoch.crs}
    if epoch.prior is not None:
        x, y, z, *_, turn = epoch.estimate.pose.less(epoch.prior)
        values |= dict(zip(SHIFTS, (x, y, z, math.degrees(turn)), strict=True))
    covariance = epoch.estimate.covariance[np.triu_indices(6)]
    if np.isfinite(covariance).all():
        values |= dict(zip(COVARIANCES, covariance.tolist(), strict=True))
        *sigmas, turn = np.sqrt(np.diagonal(epoch.estimate.covariance))[[0, 1, 2, 5]].tolist()
        values |= dict(zip(SIGMAS, (*sigmas, math.degrees(turn)), strict=True))
        levels = zip(PROTECTION_LEVELS, epoch.estimate.protection_level, strict=True)
        values |= {name: level for name, level in levels if math.isfinite(level)}
    return values


def localized_trajectory(epochs: Sequence[EpochEstimate]) -> Trajectory | None:
    """Return the localized poses as a trajectory, None if there is none."""
    found = [(epoch.raw.time, epoch.pose_global) for epoch in epochs if epoch.pose_global is not None]
    return Trajectory.from_poses([time for time, _ in found], [pose for _, pose in found]) if found else None


def write_poses(path: str | os.PathLike[str], epochs: Sequence[EpochEstimate]) -> None:
    """Write POSES.csv of epochs; FileError if it cannot be written.

    Pose, level and covariance are empty unless the status is "localized": a row cannot be mistaken for a pose.
    """
    with atomic_file(path) as partial:
        partial.write_bytes(_encoded([COLUMNS]) + _encoded(map(_cells, epochs)))


def _cells(epoch: EpochEstimate) -> list[str]:
    """The cells of an epoch's row; empty where there is no value."""
    values = pose_values(epoch)
    return [format(values[name], FORMATS[name]) if name in values else "" for name in COLUMNS]


def _encoded(rows: Iterable[Sequence[str]]) -> bytes:
    text = io.StringIO(newline="")
    csv.writer(text).writerows(rows)
    return text.getvalue().encode("utf-8")


@dataclass(frozen=True, slots=True)
class RowsThere:
    """The part of a table that an earlier call has written."""

    n_rows: int = 0  # whole rows, below the header
    n_localized: int = 0  # how many of them have the status "localized"
    n_bytes: int = 0  # of the header and the whole rows: a killed writer may have left a part of a row behind them


def rows_there(path: str | os.PathLike[str], times: NDArray[np.float64]) -> RowsThere:
    """Return the part of a table of scans at `times` (s) that was written; FileError if it is of other scans."""
    n_rows, n_localized, n_bytes = -1, 0, 0  # the header is none
    line = b""
    try:
        with Path(path).open("rb") as file:
            for line in file:
                if not line.endswith(b"\n"):
                    break
                cells = next(csv.reader([line.decode("utf-8").rstrip("\r\n")], strict=True), [])
                wanted = COLUMNS if n_rows < 0 else (f"{times[n_rows]:.9f}", *cells[1:]) if n_rows < len(times) else ()
                if tuple(cells) != wanted or len(cells) != len(COLUMNS):
                    raise ValueError
                n_localized += cells[COLUMNS.index("status")] == Status.LOCALIZED.value
                n_rows += 1
                n_bytes += len(line)
        if n_rows < 0:
            raise ValueError
    except FileNotFoundError:
        return RowsThere()
    except OSError as error:
        raise FileError(f"Expected to be able to read {path}, got: {error.strerror}. Name another.") from error
    except (ValueError, csv.Error) as error:
        raise FileError(
            f"Expected {path} to be a table of these scans, to go on with it, got {line[:40]!r} in line {n_rows + 2}."
            " Was it made of another drive, or by another version? Name another, or replace it (--overwrite)."
        ) from error
    return RowsThere(n_rows, n_localized, n_bytes)


class GrowingTable(ExitStack):
    """POSES.csv while a drive is localized: each row is in the file once its epoch is done, to go on with after a kill.

    The first row makes or replaces the file. Rows of scans that cannot be read wait for the first that can.
    """

    def __init__(self, path: str | os.PathLike[str], there: RowsThere | None = None) -> None:
        """Begin a table anew, or go on with the rows `there`."""
        super().__init__()
        self._path = Path(path)
        self._there = there or RowsThere()
        self._waiting: list[EpochEstimate] = []
        self._file: BinaryIO | None = None
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
            self.enter_context(locked(lock, f"the table {self._path}"))
            if self.n_rows == 0:
                write_poses(self._path, rows)
            self._file = self.enter_context(self._path.open("ab"))
            if self.n_rows > 0:
                self._file.truncate(self._there.n_bytes)
        if self.n_rows > 0:
            self._append(self._file, _encoded(map(_cells, rows)))
        self.n_rows += len(rows)

    def _append(self, file: BinaryIO, left: bytes) -> None:
        size = file.seek(0, 2)
        try:
            while left:  # a disk that is nearly full takes a part
                left = left[os.write(file.fileno(), left) :]
        except OSError as error:
            with suppress(OSError):
                file.truncate(size)
            raise FileError(
                f"Expected to be able to write a row to {self._path}, got: {error.strerror}. Make room for it."
            ) from error


def poses_schema() -> "pyarrow.Schema":
    """Arrow schema of the poses: the columns of POSES.csv."""
    import pyarrow

    kinds = {name: pyarrow.float64() if digits else pyarrow.string() for name, digits in FORMATS.items()}
    return pyarrow.schema(kinds | {"epoch": pyarrow.int32()})


class PosesDataset:
    """A folder of `drive=NAME/poses.parquet`, each published once complete; until then its rows are in _parts."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._parts = folder / "_parts"

    def table(self, name: str) -> ResumableTable:
        """Return the table of a drive, done or not."""
        path, parts = self.folder / f"drive={name}" / "poses.parquet", self._parts / name
        return ResumableTable(path, parts, poses_schema(), ("epoch",), "poses of a drive")

    def is_done(self, name: str) -> bool:
        """Whether a drive is done."""
        return self.table(name).path.exists()

    def has_rows(self, name: str = "*") -> bool:
        """Whether a drive, or any, has rows, done or not."""
        patterns = (f"_parts/{name}/[!.]*.parquet", f"drive={name}/poses.parquet")
        return any(any(self.folder.glob(pattern)) for pattern in patterns)

    def add(self, name: str, epochs: Sequence[EpochEstimate]) -> None:
        """Write rows of a drive that is not done yet; FileError if they cannot be written."""
        self.table(name).add([pose_values(epoch) for epoch in epochs])

    def statuses(self, name: str) -> list[str]:
        """Return the status of each epoch of a drive that is done; no other column is read."""
        table = self.table(name)
        found: list[str] = table.read_file(table.path, ["status"]).column("status").to_pylist()
        return found

    def publish(self, name: str) -> None:
        """Publish a drive whose rows are complete, in one step; FileError if it cannot be written."""
        self.table(name).merge()
        self.clear_if_done(name)

    def clear_if_done(self, name: str) -> bool:
        """Return whether a drive is done; what a call that was killed then has left of its parts is removed."""
        if not self.is_done(name):
            return False
        self.table(name).clear()
        if self._parts.exists() and not any(self._parts.iterdir()):
            self._parts.rmdir()
        return True

    def check_options(self, wanted: dict[str, Any]) -> None:
        """Write down the options; OptionError if there are rows that were made with others: they cannot be compared."""
        path = self.folder / OPTIONS
        if not (path.exists() and self.has_rows()):
            write_json(path, wanted)
            return
        found = _read(path, dict[str, Any], "the options of a dataset")
        wanted = json.loads(json.dumps(wanted))
        if found != wanted:
            raise OptionError(
                f"Expected to go on with the poses in {self.folder} by the same maxcon with the same options, as"
                f" {path.name} there has them, {differences(found, wanted)}. Give the same, or name another folder."
            )

    def check_sources(self, drives: Mapping[str, Mapping[str, Path | str | None]]) -> None:
        """Write down the map, scans, prior, ... of drives; OptionError if one has rows that were made from others."""
        path = self.folder / SOURCES
        known = _read(path, dict[str, dict[str, Any]], "the sources of drives") if path.exists() else {}
        map_of = cache(_map_identity)  # many drives share one
        for name, sources in drives.items():
            wanted = {
                what: place and (map_of(place) if what == "map" else _file_identity(Path(place)))
                for what, place in sources.items()
            }
            found = known.get(name, wanted)
            if found != wanted and self.has_rows(name):
                raise OptionError(
                    f"Expected to go on with drive {name} in {self.folder} as it was begun, with"
                    f" {differences(found, wanted)}. Name another folder, or remove drive={name} (and _parts/{name})"
                    " there to localize it anew."
                )
            known[name] = wanted
        write_json(path, known)


def table_of_drive(folder: Path, name: str | None) -> Path:
    """Return the file with the poses of a drive that is done in a dataset, of the only one if none is named."""
    names = sorted(path.parent.name.removeprefix("drive=") for path in folder.glob("drive=*/poses.parquet"))
    if (name is None and len(names) == 1) or name in names:
        return PosesDataset(folder).table(name or names[0]).path
    few = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    raise OptionError(
        f"Expected POSES.csv, or a folder of maxcon localize --drives and --drive NAME of one that is done there, got"
        f" {folder} with {few or 'none'}, and {name or 'no NAME'}. Name one of them."
    )


def _read(path: Path, kind: Any, what: str) -> Any:
    return checked(read_json(path, what, "Name another folder"), kind, path, what, "Name another folder")


def _map_identity(place: Path | str) -> str:
    """Identity of a map: the checksum of its manifest, or where it should be if that cannot be read."""
    try:
        return hashlib.sha256(open_storage(place).read(MANIFEST, MAX_MANIFEST_BYTES)).hexdigest()
    except OSError:  # opening the drive will say that there is no map
        return address_of(place) or str(Path(place).absolute())


def _file_identity(place: Path) -> str:
    """Identity of a file: its checksum; the path of a folder; path and size of a large file."""
    path = place.absolute()
    try:
        if not path.is_file():
            return str(path)
        size = path.stat().st_size
        return sha256_of_file(path) if size <= LARGEST_HASHED else f"{path}, {size} bytes"
    except OSError:
        return str(path)  # that it cannot be read is said where the drive is opened
