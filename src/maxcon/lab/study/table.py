# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The table of a study: one row per epoch, method and prior; grown in parts, merged in the end (D10)."""

import shutil
import uuid
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from maxcon._system.atomic import atomic_file, make_folder
from maxcon.errors import FileError

if TYPE_CHECKING:
    import pyarrow

__all__ = ["COLUMNS", "Key", "Row", "TableParts", "table_schema"]

Row = Mapping[str, Any]
"""Values by the names of `COLUMNS`; what is left out is null."""

Key = tuple[str, str, int]
"""(prior, method, epoch): unique for each row."""

COLUMNS: dict[str, tuple[str, str]] = {
    "prior": ("string", "name of the prior in the dataset"),
    "method": ("string", "name of the method"),
    "epoch": ("int32", "number of the scan in its folder, from 0"),
    "time": ("float64", "s"),
    "scan": ("string", "name of the scan's file"),
    "n_points": ("int32", "points of the scan within the range limits"),
    "status": ("string", "the method's own word on its answer"),
    "reason": ("string", "why there is no answer, or what casts doubt on it, where the status does not say all"),
    "is_localized": ("bool", "whether the status says that the pose may be used"),
    "is_success": ("bool", "within 0.3 m and 1 degree of the reference, trusted or not; of several starts: all"),
    "x": ("float64", "answer, global, m; null without one; given whether trusted or not"),
    "y": ("float64", "m"),
    "z": ("float64", "m"),
    "roll": ("float64", "rad"),
    "pitch": ("float64", "rad"),
    "heading": ("float64", "rad"),
    "reference_x": ("float64", "reference pose, global, m"),
    "reference_y": ("float64", "m"),
    "reference_z": ("float64", "m"),
    "reference_heading": ("float64", "rad"),
    "prior_distance": ("float64", "of the prior from the reference in x and y, m"),
    "prior_heading_error": ("float64", "rad"),
    "distance": ("float64", "of the answer from the reference in x and y, m"),
    "along": ("float64", "error in the reference's heading, m"),
    "across": ("float64", "error to the left of it, m"),
    "heading_error": ("float64", "rad"),
    "height_error": ("float64", "m"),
    "sigma_along": ("float64", "predicted standard deviation in the reference's heading, m; null without a covariance"),
    "sigma_across": ("float64", "predicted, to the left of it, m"),
    "sigma_z": ("float64", "predicted, m"),
    "sigma_heading": ("float64", "predicted, rad"),
    "nees": ("float64", "normalized squared error of x and y: 2 in the mean where the covariance holds"),
    "protection_along": ("float64", "error along that is exceeded with at most the method's risk, m"),
    "protection_across": ("float64", "the same across, m"),
    "was_widened": ("bool", "whether the answer was in doubt and searched for farther around"),
    "score": ("float64", "in units of the method"),
    "share": ("float64", "of the scan's points that match, 0 to 1"),
    "runner_up": ("float64", "Helmert's score beyond 0.5 m over that of the answer"),
    "peak_ratio": ("float64", "second highest over highest score, beyond 0.3 m"),
    "kurtosis": ("float64", "of the scores along the significant ray"),
    "divergence": ("float64", "Kullback-Leibler, of the same from a Laplace distribution"),
    "spread": ("float64", "farthest cell that reaches 90 % of the highest score, m"),
    "n_starts": ("int32", "starts of a method with several"),
    "n_converged": ("int32", "of these, how many ended within 0.3 m and 1 degree of the reference"),
    "ms": ("float64", "from points in memory to the pose, scan normals included where used"),
}  # fmt: skip
"""Type and meaning of each column."""


def table_schema() -> "pyarrow.Schema":
    """Arrow schema of the table, the meaning of each column with it."""
    import pyarrow

    types = {
        "string": pyarrow.string(),
        "int32": pyarrow.int32(),
        "float64": pyarrow.float64(),
        "bool": pyarrow.bool_(),
    }
    return pyarrow.schema(
        [pyarrow.field(name, types[kind], metadata={"meaning": meaning}) for name, (kind, meaning) in COLUMNS.items()]
    )


class TableParts:
    """The table of a study folder: `table.parquet` and, while it grows, the files in `parts/`.

    folder: of the study.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.path = folder / "table.parquet"
        self.parts_folder = folder / "parts"

    def add(self, rows: Sequence[Row]) -> None:
        """Write rows as one more part: whole, or not at all."""
        import pyarrow

        make_folder(self.parts_folder)
        part = self.parts_folder / f"{uuid.uuid4().hex}.parquet"
        self._write(part, pyarrow.Table.from_pylist([dict(row) for row in rows], schema=table_schema()))

    def read(self) -> "pyarrow.Table":
        """Return all rows that are there, in order of prior, method and epoch; the first of equal keys."""
        import pyarrow
        import pyarrow.compute

        tables = [_read(path) for path in [self.path, *sorted(self.parts_folder.glob("*.parquet"))] if path.exists()]
        table = pyarrow.concat_tables([table_schema().empty_table(), *tables])
        first = {key: row for row, key in reversed(list(enumerate(keys_of(table))))}
        table = table.take(pyarrow.array(sorted(first.values()), pyarrow.int64()))
        order = [(name, "ascending") for name in ("prior", "method", "epoch")]
        return table.sort_by(order)

    def merge(self) -> "pyarrow.Table":
        """Put all parts into one table, and remove them."""
        table = self.read()
        if any(self.parts_folder.glob("*.parquet")):
            self._write(self.path, table)
        if self.parts_folder.exists():  # with what a kill may have left half written in it
            shutil.rmtree(self.parts_folder)
        return table

    @staticmethod
    def _write(path: Path, table: "pyarrow.Table") -> None:
        import pyarrow.parquet

        with atomic_file(path) as partial:
            pyarrow.parquet.write_table(table, partial, compression="zstd")


def keys_of(table: "pyarrow.Table") -> Iterable[Key]:
    """(prior, method, epoch) of each row."""
    columns = (table.column(name).to_pylist() for name in ("prior", "method", "epoch"))
    return zip(*columns, strict=True)


def _read(path: Path) -> "pyarrow.Table":
    import pyarrow
    import pyarrow.parquet

    try:
        return pyarrow.parquet.read_table(path, schema=table_schema())
    except (OSError, pyarrow.ArrowException) as error:
        raise FileError(
            f"Expected a part of a study's table in {path}, got: {error}. Is it readable? If it is broken, remove it:"
            " the same study command makes its rows anew."
        ) from error
