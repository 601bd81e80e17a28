# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The rows of a drive in a Parquet file, as `maxcon localize --drives` writes one for each drive."""

import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from maxcon.drive.poses_table import COLUMNS
from maxcon.errors import FileError

__all__ = ["PARQUET", "parquet_values"]

PARQUET = ".parquet"
ROWS_AT_ONCE = 10_000


def parquet_values(file: Path) -> Iterator[dict[str, Any]]:
    """Yield the values of each row by the names of the columns of POSES.csv; those that are not known are left out.

    Raises
    ------
    FileError
        If it cannot be read, or is another kind of file.
    """
    import pyarrow
    import pyarrow.parquet

    try:
        if not stat.S_ISREG(file.stat().st_mode):  # a FIFO would wait for ever
            raise _refused(file, "no file")
        with pyarrow.parquet.ParquetFile(file) as opened:
            missing = [name for name in COLUMNS if name not in opened.schema_arrow.names]
            if missing:
                raise _refused(file, f"no column {missing[0]}")
            for batch in opened.iter_batches(ROWS_AT_ONCE, columns=list(COLUMNS)):
                for row in batch.to_pylist():
                    yield {name: value for name, value in row.items() if value is not None}
    except (OSError, ValueError, pyarrow.ArrowException) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())[:200]
        raise _refused(file, reason) from None


def _refused(file: Path, got: str) -> FileError:
    return FileError(
        f"Expected the poses of a drive in {file}, as maxcon localize --drives writes them, got: {got}. Name another."
    )
