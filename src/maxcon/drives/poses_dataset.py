# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PosesDataset: the poses of many drives as a Parquet dataset, a folder for each drive that is done."""

import math
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from maxcon.atomic import atomic_file, make_folder, remove_partials
from maxcon.drive import EpochEstimate
from maxcon.errors import FileError, OptionError
from maxcon.poses_table import COLUMNS, COVARIANCES, UNKNOWNS

if TYPE_CHECKING:
    import pyarrow

__all__ = ["PosesDataset", "pose_row", "poses_schema", "table_of_drive"]

TEXTS = ("status", "reason")


def poses_schema() -> "pyarrow.Schema":
    """Arrow schema of the poses: the columns of POSES.csv, and the number of the epoch before them."""
    import pyarrow

    fields = [pyarrow.field("epoch", pyarrow.int32())]
    fields += [
        pyarrow.field(name, pyarrow.string() if name in TEXTS else pyarrow.float64()) for name in COLUMNS
    ]
    return pyarrow.schema(fields)


def pose_row(epoch: EpochEstimate) -> dict[str, Any]:
    """Return the values of an epoch by the names of the columns: those of its row in POSES.csv, not rounded."""
    row: dict[str, Any] = {"epoch": epoch.epoch, "time": epoch.raw.time, "status": epoch.status.value}
    row |= {"ms": epoch.milliseconds, "reason": " ".join(epoch.reason.split())}
    if epoch.estimate is not None:
        row["score"] = epoch.estimate.score
    if epoch.pose_global is None or epoch.estimate is None:
        return row
    row |= {name: getattr(epoch.pose_global, name) for name in UNKNOWNS}
    covariance = epoch.estimate.covariance[np.triu_indices(6)]
    if np.isfinite(covariance).all():
        row |= dict(zip(COVARIANCES, covariance.tolist(), strict=True))
        names = ("protection_along", "protection_across")
        levels = zip(names, epoch.estimate.protection_level, strict=True)
        row |= {name: level for name, level in levels if math.isfinite(level)}
    return row


class PosesDataset:
    """The dataset in a folder. A drive is in it once all of its epochs are done; until then its rows wait in _parts.

    Parameters
    ----------
    folder : Path
        `drive=NAME/poses.parquet` for each drive.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._parts = folder / "_parts"

    def path(self, name: str) -> Path:
        """Where the poses of a drive are, once it is done."""
        return self.folder / f"drive={name}" / "poses.parquet"

    def is_done(self, name: str) -> bool:
        """Whether a drive is done."""
        return self.path(name).exists()

    def has_rows(self, name: str) -> bool:
        """Whether a drive has rows, done or not."""
        return self.is_done(name) or bool(self._parts_of(name))

    def has_any_rows(self) -> bool:
        """Whether any drive has rows, done or not."""
        return any(self._parts.glob("*/[!.]*.parquet")) or any(self.folder.glob("drive=*/poses.parquet"))

    def add(self, name: str, epochs: Sequence[EpochEstimate]) -> None:
        """Keep rows of a drive that is not done yet.

        Raises
        ------
        FileError
            If they cannot be written.
        """
        import pyarrow

        make_folder(self._parts / name)
        part = self._parts / name / f"{epochs[0].epoch:09d}.parquet"
        rows = [pose_row(epoch) for epoch in epochs]
        self._write(part, pyarrow.Table.from_pylist(rows, schema=poses_schema()))

    def rows(self, name: str) -> "pyarrow.Table":
        """Return the rows that are there of a drive, done or not, by epoch.

        Raises
        ------
        FileError
            If a file of it is broken.
        """
        import pyarrow

        if self.is_done(name):
            return _read(self.path(name))
        parts = [_read(path) for path in self._parts_of(name)]
        table = pyarrow.concat_tables([poses_schema().empty_table(), *parts]).sort_by("epoch")
        epochs = table.column("epoch").to_numpy()
        is_first = np.ones(len(epochs), bool)
        is_first[1:] = epochs[1:] != epochs[:-1]
        return table.filter(pyarrow.array(is_first))

    def publish(self, name: str, table: "pyarrow.Table") -> None:
        """Put a drive, of which all rows are there, into the dataset, in one step; nobody else may be at it.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        make_folder(self.path(name).parent)
        remove_partials(self.path(name))
        self._write(self.path(name), table)
        self.clear(name)

    def clear(self, name: str) -> None:
        """Remove what waited of a drive that is done."""
        shutil.rmtree(self._parts / name, ignore_errors=True)
        if self._parts.exists() and not any(self._parts.iterdir()):
            self._parts.rmdir()

    def _parts_of(self, name: str) -> list[Path]:
        """Files with rows of a drive that is not done."""
        return sorted((self._parts / name).glob("[!.]*.parquet"))

    @staticmethod
    def _write(path: Path, table: "pyarrow.Table") -> None:
        import pyarrow.parquet

        with atomic_file(path) as partial:
            pyarrow.parquet.write_table(table, partial, compression="zstd")


def table_of_drive(folder: Path, name: str | None) -> Path:
    """Return the file with the poses of a drive in a dataset; of the only one there, if none is named.

    Raises
    ------
    FileError
        If the folder is no such dataset.
    OptionError
        If the drive is not in it, or not done, or none is named of several.
    """
    dataset = PosesDataset(folder)
    names = sorted(path.parent.name.removeprefix("drive=") for path in folder.glob("drive=*/poses.parquet"))
    if not names:
        raise FileError(
            f"Expected POSES.csv, or a folder of maxcon localize --drives with a drive in it that is done, got {folder}"
            " with none. Name another."
        )
    if name is None and len(names) > 1:
        raise OptionError(
            f"Expected --drive NAME with one of the drives in {folder}, {_few(names)}, got none. Name it."
        )
    if name is not None and name not in names:
        is_begun = (folder / "_parts").is_dir() and name in {
            path.name for path in (folder / "_parts").iterdir()
        }
        raise OptionError(
            f"Expected --drive to be one of the drives in {folder} that are done, {_few(names)}, got {name!r}."
            f" {'Go on with it by the same localize command' if is_begun else 'Name one of them'}."
        )
    return dataset.path(name or names[0])


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


def _read(path: Path) -> "pyarrow.Table":
    import pyarrow
    import pyarrow.parquet

    try:
        return pyarrow.parquet.ParquetFile(path).read().cast(poses_schema())
    except (OSError, ValueError, pyarrow.ArrowException) as error:
        raise FileError(
            f"Expected poses of a drive in {path}, got: {error}. If it is broken, remove it: the same command makes its"
            " rows anew."
        ) from error
