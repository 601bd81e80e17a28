# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Localized drives as they are named on the command line: scans with a table of poses, or datasets."""

import os
from collections.abc import Sequence
from pathlib import Path

from maxcon.errors import OptionError
from maxcon.export import PARQUET
from maxcon.io.scans import Scans, open_scans
from maxcon.lab.dataset import DESCRIPTION, Dataset
from maxcon.mapping.update import LocalizedDrive

__all__ = ["open_drives"]


def open_drives(paths: Sequence[str | os.PathLike[str]]) -> list[LocalizedDrive]:
    """Return the drives of scans and tables in turn: SCANS POSES.csv, SCANS POSES.csv, ...

    A table may be the Parquet file of a drive, `drive=NAME/poses.parquet`, as `maxcon localize --drives` writes it.
    SCANS may be a dataset, which may stand without a table: its reference poses are taken then.
    """
    left, drives = [Path(path) for path in paths], list[LocalizedDrive]()
    while left:
        scans = left.pop(0)
        if _is_table(scans):
            raise OptionError(
                f"Expected scans before the table {scans}, got it alone. Name drives as SCANS POSES.csv, in turn."
            )
        dataset = Dataset.open(scans) if _is_dataset(scans) else None
        if left and _is_table(left[0]):
            drives.append(LocalizedDrive.open(_scans_of(dataset) if dataset else scans, left.pop(0)))
        elif dataset:
            drives.append(LocalizedDrive.of_reference(_scans_of(dataset), dataset.reference))
        else:
            raise OptionError(
                f"Expected the table of poses of {scans} behind it (POSES.csv or poses.parquet, as maxcon localize"
                f" writes it), got {left[0] if left else 'nothing'}. Localize the drive first."
            )
    if not drives:
        raise OptionError("Expected at least one drive, got none. Name it as SCANS POSES.csv.")
    return drives


def _is_dataset(path: Path) -> bool:
    """Whether a path is that of a dataset's description, or of the folder it is in."""
    return path.suffix == ".toml" or (path / DESCRIPTION).is_file()


def _scans_of(dataset: Dataset) -> Scans:
    return open_scans(dataset.scans, dataset.times)


def _is_table(path: Path) -> bool:
    return path.suffix.lower() in (".csv", PARQUET)
