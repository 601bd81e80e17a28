# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""ShardTable, the index of a section of a map: where each record lies, its size and checksum."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry.frame import INDEX_LIMIT
from maxcon.map.layout import TILE_VOXELS, TileKey

__all__ = ["MOST_KEY", "ShardFile", "ShardTable"]

MOST_KEY = INDEX_LIMIT // TILE_VOXELS
"""Largest |x| or |y| of a tile: beyond it voxels would have indices that no map can have."""
NUMBERS = {
    "x": "int32", "y": "int32", "n_rows": "int32", "n_points": "int64",
    "shard": "int32", "offset": "int64", "length": "int64",
}  # fmt: skip
"""Columns of the index file and their types; that of the checksums follows."""
RECORDS = b"records"
"""Key in the metadata of the index file whose value is the schema of the records."""
CHECKSUM_BYTES = 32
SMALL_ROWS, MOST_ROWS_A_BYTE = 2**20, 16
"""Most rows of a record: so many, and so many more for each of its bytes; more is refused, as it takes memory."""
Row = tuple[TileKey, int, int, int, int, int, bytes]
"""One record: key, n_rows, n_points, shard, offset, length, SHA-256."""


@dataclass(frozen=True, slots=True)
class ShardFile:
    """A file that records lie in: its name in the map, and its size."""

    name: str
    n_bytes: int


@dataclass(frozen=True, slots=True, eq=False)
class ShardTable:
    """The records of a section, a row each, by ascending key.

    Parameters
    ----------
    schema : bytes
        Arrow IPC message of the schema of all records.
    files : tuple of ShardFile
        The shards.
    keys : array, shape (n, 2), int32
        (x, y) of the tiles.
    n_rows : array, shape (n,), int32
        Rows of each record: voxels, or heights.
    n_points : array, shape (n,), int64
        Map points in the voxels of each record.
    shards : array, shape (n,), int32
        Number of the file that each record lies in.
    offsets, lengths : array, shape (n,), int64
        First byte of each record in its file, and its number of bytes.
    checksums : array, shape (n, 32), uint8
        SHA-256 of its bytes.
    """

    schema: bytes
    files: tuple[ShardFile, ...]
    keys: NDArray[np.int32]
    n_rows: NDArray[np.int32]
    n_points: NDArray[np.int64]
    shards: NDArray[np.int32]
    offsets: NDArray[np.int64]
    lengths: NDArray[np.int64]
    checksums: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.keys)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ShardTable):
            return NotImplemented
        return (self.schema, self.files) == (other.schema, other.files) and all(
            np.array_equal(mine, theirs) for mine, theirs in zip(self._arrays(), other._arrays(), strict=True)
        )

    __hash__ = None  # type: ignore[assignment]  # arrays have none

    def _arrays(self) -> tuple[NDArray[Any], ...]:
        """Columns of the file, in its order."""
        x, y = np.ascontiguousarray(self.keys.T)
        return x, y, self.n_rows, self.n_points, self.shards, self.offsets, self.lengths, self.checksums

    @classmethod
    def empty(cls) -> "ShardTable":
        """Return the table of a section without records."""
        return cls.of_rows(b"", (), [])

    @classmethod
    def of_rows(cls, schema: bytes, files: tuple[ShardFile, ...], rows: list[Row]) -> "ShardTable":
        """Return the table of rows in any order."""
        rows = sorted(rows)
        keys, *numbers, checksums = zip(*rows, strict=True) if rows else [()] * 7
        n_rows, n_points, shards, offsets, lengths = (np.array(column, np.int64) for column in numbers)
        return cls(
            schema,
            files,
            np.array(keys, np.int32).reshape(-1, 2),
            n_rows.astype(np.int32),
            n_points,
            shards.astype(np.int32),
            offsets,
            lengths,
            np.frombuffer(b"".join(checksums), np.uint8).reshape(-1, CHECKSUM_BYTES),
        )

    def rows_by_key(self) -> dict[TileKey, int]:
        """Return the number of each record's row."""
        return dict(zip(zip(*self.keys.T.tolist(), strict=True), range(len(self)), strict=True))

    def to_bytes(self) -> bytes:
        """Return the table as an Arrow IPC file, the schema of the records among its metadata."""
        import pyarrow as pa

        *numbers, checksums = self._arrays()
        packed = pa.FixedSizeBinaryArray.from_buffers(
            pa.binary(CHECKSUM_BYTES), len(self), [None, pa.py_buffer(checksums.tobytes())]
        )
        batch = pa.record_batch([*map(pa.array, numbers), packed], schema=_file_schema())
        batch = batch.replace_schema_metadata({RECORDS: self.schema})
        sink = pa.BufferOutputStream()
        with pa.ipc.new_file(sink, batch.schema) as writer:
            writer.write_batch(batch)
        content: bytes = sink.getvalue().to_pybytes()
        return content

    @classmethod
    def from_bytes(cls, content: Any, files: tuple[ShardFile, ...]) -> "ShardTable":
        """Return the table that `to_bytes` wrote, of records in these files.

        Raises
        ------
        ValueError
            If it is no table, or contradicts itself: two records of a tile, a record beyond the end of its file.
        """
        import pyarrow as pa

        try:
            with pa.ipc.open_file(pa.py_buffer(content)) as file:
                metadata = file.schema.metadata or {}
                if not file.schema.equals(_file_schema()) or file.num_record_batches != 1 or RECORDS not in metadata:
                    raise ValueError("not the columns of an index")
                batch = file.get_batch(0)
            batch.validate()
        except (EOFError, OSError, pa.ArrowException) as error:
            raise ValueError(str(error).partition("\n")[0]) from None
        if any(column.null_count for column in batch.columns):
            raise ValueError("rows without values")
        *numbers, checksums = batch.columns
        x, y, n_rows, n_points, shards, offsets, lengths = (column.to_numpy() for column in numbers)
        packed = np.frombuffer(checksums.buffers()[1], np.uint8, CHECKSUM_BYTES * len(checksums))
        packed = packed.reshape(-1, CHECKSUM_BYTES)
        keys = np.column_stack([x, y])
        table = cls(metadata[RECORDS], files, keys, n_rows, n_points, shards, offsets, lengths, packed)
        table._check()
        return table

    def _check(self) -> None:
        """Raise ValueError for rows that contradict each other, the files, or the limits of a map."""
        if not len(self):
            return
        if np.abs(self.keys.astype(np.int64)).max() > MOST_KEY:
            raise ValueError(f"a tile beyond {MOST_KEY:,}")
        x, y = self.keys.T.astype(np.int64)
        if not (np.diff(x * 2**32 + y) > 0).all():
            raise ValueError("tiles that do not ascend")
        if self.n_rows.min() < 0 or self.n_points.min() < 0 or self.n_points.max() >= 2**62:
            raise ValueError("a count that is none")
        if self.shards.min() < 0 or self.shards.max() >= len(self.files):
            raise ValueError("a record in a file that there is not")
        sizes = np.array([file.n_bytes for file in self.files], np.int64)[self.shards]
        is_inside = (self.offsets >= 0) & (self.lengths > 0) & (self.lengths <= sizes)
        if not (is_inside & (self.offsets <= sizes - self.lengths)).all():
            raise ValueError("a record beyond the end of its file")
        if (self.n_rows.astype(np.int64) > SMALL_ROWS + MOST_ROWS_A_BYTE * self.lengths).any():
            raise ValueError("a record of more rows than its bytes can hold")


def _file_schema() -> Any:
    import pyarrow as pa

    numbers = [pa.field(name, getattr(pa, kind)(), nullable=False) for name, kind in NUMBERS.items()]
    return pa.schema([*numbers, pa.field("sha256", pa.binary(CHECKSUM_BYTES), nullable=False)])
