# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Records: what a map keeps of one tile, as bytes that can be written anywhere (docs/map_format.md).

A record is one message of the Arrow IPC stream format, its buffers compressed with LZ4: a shard, the schema's message
and then records, is such a stream. Records are made by any thread or process, and do not depend on which.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.map.ground import GroundTile
from maxcon.map.layout import TileKey
from maxcon.map.tile import VoxelTile

__all__ = [
    "CLASSES",
    "END_OF_STREAM",
    "GROUND",
    "TILES",
    "Record",
    "classes_of_batch",
    "classes_record",
    "classes_schema",
    "ground_record",
    "ground_schema",
    "record_of",
    "tile_of_batch",
    "tile_record",
    "tile_schema",
]

TILES, GROUND = "tiles", "ground"
"""Sections of every map."""
CLASSES = "classes"
"""Section of a map that was updated: of the tiles in which anything is gone or new (decision 31)."""
END_OF_STREAM = b"\xff\xff\xff\xff\0\0\0\0"
"""How a stream of the Arrow IPC format ends."""


@dataclass(frozen=True, slots=True)
class Record:
    """What a section of a map keeps of one tile.

    Parameters
    ----------
    section : str
        "tiles", "ground", or that of others: lower-case letters and underscores.
    key : tuple of 2 int
        The tile's (x, y) index.
    n_rows, n_points : int
        Rows of the record batch, and the map points they stand for; 0 where they stand for none.
    schema : bytes
        Arrow IPC message of the schema, the same for all records of a section.
    content : bytes
        Arrow IPC message of the record batch.
    sha256 : bytes
        Of the content.
    """

    section: str
    key: TileKey
    n_rows: int
    n_points: int
    schema: bytes
    content: bytes
    sha256: bytes


def record_of(section: str, key: TileKey, batch: Any, n_points: int = 0) -> Record:
    """Return the record of an Arrow record batch; columns are of any types but dictionaries."""
    import hashlib

    import pyarrow as pa

    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema, options=_write_options()) as writer:
        writer.write_batch(batch)
    schema = _schema_message(batch.schema)
    content = sink.getvalue()[len(schema) : -len(END_OF_STREAM)].to_pybytes()
    return Record(section, key, batch.num_rows, n_points, schema, content, hashlib.sha256(content).digest())


@cache
def _write_options() -> Any:
    import pyarrow as pa

    return pa.ipc.IpcWriteOptions(compression="lz4", use_threads=False)


@cache
def _schema_message(schema: Any) -> bytes:
    """Return the Arrow IPC message of a schema."""
    message: bytes = schema.serialize().to_pybytes()
    return message


@cache
def tile_schema() -> Any:
    """Return the Arrow schema of the voxels of a tile."""
    import pyarrow as pa

    return pa.schema(
        [
            pa.field("column", pa.list_(pa.field("item", pa.int16(), nullable=False), 2), nullable=False),
            pa.field("layer", pa.int32(), nullable=False),
            pa.field("count", pa.int32(), nullable=False),
            pa.field("normal", pa.list_(pa.field("item", pa.float32(), nullable=False), 3), nullable=False),
            pa.field("mean", pa.list_(pa.field("item", pa.uint8(), nullable=False), 3), nullable=False),
        ]
    )


@cache
def ground_schema() -> Any:
    """Return the Arrow schema of the ground of a tile."""
    import pyarrow as pa

    return pa.schema(
        [
            pa.field("column", pa.list_(pa.field("item", pa.int16(), nullable=False), 2), nullable=False),
            pa.field("height", pa.float32(), nullable=False),
        ]
    )


def tile_record(tile: VoxelTile) -> Record:
    """Return the record of the voxels of a tile."""
    import pyarrow as pa

    schema = tile_schema()
    batch = pa.record_batch(
        [
            pa.FixedSizeListArray.from_arrays(tile.columns.reshape(-1), type=schema.field("column").type),
            pa.array(tile.layers),
            pa.array(tile.counts),
            pa.FixedSizeListArray.from_arrays(tile.normals.reshape(-1), type=schema.field("normal").type),
            pa.FixedSizeListArray.from_arrays(tile.means.reshape(-1), type=schema.field("mean").type),
        ],
        schema=schema,
    )
    return record_of(TILES, tile.key, batch, int(tile.counts.sum(dtype=np.int64)))


def tile_of_batch(key: TileKey, batch: Any) -> VoxelTile:
    """Return the tile of a record batch of `tile_schema`; its arrays are views of the batch."""
    return VoxelTile(
        key,
        batch.column("column").flatten().to_numpy().reshape(-1, 2),
        batch.column("layer").to_numpy(),
        batch.column("count").to_numpy(),
        batch.column("normal").flatten().to_numpy().reshape(-1, 3),
        batch.column("mean").flatten().to_numpy().reshape(-1, 3),
    )


def ground_record(tile: GroundTile) -> Record:
    """Return the record of the ground of a tile."""
    import pyarrow as pa

    columns, heights = tile.rows()
    schema = ground_schema()
    cells = pa.FixedSizeListArray.from_arrays(columns.reshape(-1), type=schema.field("column").type)
    return record_of(GROUND, tile.key, pa.record_batch([cells, pa.array(heights)], schema=schema))


def classes_schema() -> Any:
    """Return the Arrow schema of the classes of the voxels of a tile."""
    import pyarrow as pa

    return pa.schema([pa.field("class", pa.uint8(), nullable=False)])


def classes_record(tile: VoxelTile) -> Record:
    """Return the record of the classes of a tile that has them, a row for each of its voxels."""
    import pyarrow as pa

    batch = pa.record_batch([pa.array(tile.classes)], schema=classes_schema())
    return record_of(CLASSES, tile.key, batch)


def classes_of_batch(batch: Any) -> NDArray[np.uint8]:
    """Return the classes of a record batch of `classes_schema`."""
    classes: NDArray[np.uint8] = batch.column("class").to_numpy()
    return classes
