# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""PosesDataset: the poses of many drives as a Parquet dataset, a folder for each drive that is done."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maxcon._system.atomic import atomic_file, make_folder, sweep
from maxcon.drive.localize import EpochEstimate
from maxcon.drive.poses_table import COLUMNS, pose_values
from maxcon.errors import FileError, OptionError

if TYPE_CHECKING:
    import pyarrow

__all__ = ["PosesDataset", "poses_schema", "table_of_drive"]

TEXTS = ("status", "reason")


def poses_schema() -> "pyarrow.Schema":
    """Arrow schema of the poses: the columns of POSES.csv, and the number of the epoch before them."""
    import pyarrow

    fields = [pyarrow.field("epoch", pyarrow.int32())]
    fields += [pyarrow.field(name, pyarrow.string() if name in TEXTS else pyarrow.float64()) for name in COLUMNS]
    return pyarrow.schema(fields)


class PosesDataset:
    """The dataset in a folder. A drive is published once all its epochs are done; until then its rows are in _parts.

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
        """Write rows of a drive that is not done yet.

        Raises
        ------
        FileError
            If they cannot be written.
        """
        import pyarrow

        make_folder(self._parts / name)
        part = self._parts / name / f"{epochs[0].epoch:09d}.parquet"
        rows = [{"epoch": epoch.epoch, **pose_values(epoch)} for epoch in epochs]
        self._write(part, pyarrow.Table.from_pylist(rows, schema=poses_schema()))

    def rows(self, name: str) -> "pyarrow.Table":
        """Return the rows of a drive that have been written, done or not, by epoch.

        Raises
        ------
        FileError
            If a file of it is broken.
        """
        import pyarrow

        if self.is_done(name):
            return _read(self.path(name), poses_schema())
        parts = [_read(path, poses_schema()) for path in self._parts_of(name)]
        table = pyarrow.concat_tables([poses_schema().empty_table(), *parts]).sort_by("epoch")
        epochs = table.column("epoch").to_numpy()
        is_first = np.ones(len(epochs), bool)
        is_first[1:] = epochs[1:] != epochs[:-1]
        return table.filter(pyarrow.array(is_first))

    def statuses(self, name: str) -> list[str]:
        """Return the status of each epoch of a drive that is done; no other column is read.

        Raises
        ------
        FileError
            If its file is broken.
        """
        import pyarrow

        schema = pyarrow.schema([poses_schema().field("status")])
        found: list[str] = _read(self.path(name), schema).column("status").to_pylist()
        return found

    def publish(self, name: str, table: "pyarrow.Table") -> None:
        """Publish a drive whose rows are complete, in one step; nobody else may be at it.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        make_folder(self.path(name).parent)
        sweep(self.path(name).parent, self.path(name).name)
        self._write(self.path(name), table)
        self.clear(name)

    def clear(self, name: str) -> None:
        """Remove the parts of a drive that is done."""
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
        is_begun = (folder / "_parts").is_dir() and name in {path.name for path in (folder / "_parts").iterdir()}
        raise OptionError(
            f"Expected --drive to be one of the drives in {folder} that are done, {_few(names)}, got {name!r}."
            f" {'Go on with it by the same localize command' if is_begun else 'Name one of them'}."
        )
    return dataset.path(name or names[0])


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


def _read(path: Path, schema: "pyarrow.Schema") -> "pyarrow.Table":
    """Read the columns that a schema names."""
    import pyarrow
    import pyarrow.parquet

    try:
        return pyarrow.parquet.ParquetFile(path).read(schema.names).cast(schema)
    except (OSError, ValueError, pyarrow.ArrowException) as error:
        raise FileError(
            f"Expected poses of a drive in {path}, got: {error}. If it is broken, remove it: the same command makes its"
            " rows anew."
        ) from error
