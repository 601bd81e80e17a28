# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Records of tiles, and the tiles and the ground of a map on disk: read when asked for, and checked (D10).

A record is what a section of a map keeps of one tile: one message of the Arrow IPC stream format, its buffers
compressed with LZ4 (docs/map_format.md). Records do not depend on the thread or process that makes them.
"""

import hashlib
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import MapError
from maxcon.map.ground import GroundTile, ground_voxels
from maxcon.map.layout import TILE_VOXELS, SurfaceClass, TileKey
from maxcon.map.manifest import CLASSES, GROUND, REBUILD, TILES, Manifest, ShardTable
from maxcon.map.storage import MapStorage
from maxcon.map.tile import TileCache, VoxelTile

END_OF_STREAM = b"\xff\xff\xff\xff\0\0\0\0"
"""How a stream of the Arrow IPC format ends."""
GROUND_CACHE_BYTES = 2**24
PREFETCHED_AROUND = 2
"""With the ground of a tile, that of so many tiles on each side is prefetched: it is likely to be needed next."""
UPDATE = "Update the map it was made of again with `maxcon map update`."


@dataclass(frozen=True, slots=True)
class Record:
    """What a section of a map keeps of one tile.

    section: "tiles", "ground", or that of others: lower-case letters and underscores.
    key: the tile's (x, y) index.
    n_rows, n_points: rows of the record batch, and the map points they stand for; 0 where they stand for none.
    schema: arrow IPC message of the schema, the same for all records of a section.
    content: arrow IPC message of the record batch.
    sha256: of the content.
    """

    section: str
    key: TileKey
    n_rows: int
    n_points: int
    schema: bytes
    content: bytes
    sha256: bytes

    @classmethod
    def of(cls, section: str, key: TileKey, columns: list[Any], n_points: int = 0) -> "Record":
        """Return the record of columns of a section: arrays of shape (n,) or (n, k)."""
        import pyarrow as pa

        schema, options = _schema(section), pa.ipc.IpcWriteOptions(compression="lz4", use_threads=False)
        arrays = [
            pa.FixedSizeListArray.from_arrays(column.reshape(-1), type=field.type)
            if column.ndim > 1 else pa.array(column)
            for field, column in zip(schema, columns, strict=True)
        ]  # fmt: skip
        batch, sink = pa.record_batch(arrays, schema=schema), pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, schema, options=options) as writer:
            writer.write_batch(batch)
        header = schema.serialize().to_pybytes()
        content = sink.getvalue()[len(header) : -len(END_OF_STREAM)].to_pybytes()
        return cls(section, key, batch.num_rows, n_points, header, content, hashlib.sha256(content).digest())


@cache
def _schema(section: str) -> Any:
    """Return the Arrow schema of the records of a section."""
    import pyarrow as pa

    def several(kind: Any, n: int) -> Any:
        return pa.list_(pa.field("item", kind, nullable=False), n)

    columns = {
        TILES: {
            "column": several(pa.int16(), 2), "layer": pa.int32(), "count": pa.int32(),
            "normal": several(pa.float32(), 3), "mean": several(pa.uint8(), 3),
        },
        GROUND: {"column": several(pa.int16(), 2), "height": pa.float32()},
        CLASSES: {"class": pa.uint8()},
    }  # fmt: skip
    return pa.schema([pa.field(name, kind, nullable=False) for name, kind in columns[section].items()])


def tile_record(tile: VoxelTile) -> Record:
    """Return the record of the voxels of a tile."""
    columns = [tile.columns, tile.layers, tile.counts, tile.normals, tile.means]
    return Record.of(TILES, tile.key, columns, int(tile.counts.sum(dtype=np.int64)))


def ground_record(tile: GroundTile) -> Record:
    """Return the record of the ground of a tile."""
    return Record.of(GROUND, tile.key, list(tile.rows()))


def classes_record(tile: VoxelTile) -> Record:
    """Return the record of the classes of a tile that has them, a row for each of its voxels."""
    return Record.of(CLASSES, tile.key, [tile.classes])


def classes_of_batch(batch: Any) -> NDArray[np.uint8]:
    """Return the classes of a record batch of the section of classes."""
    classes: NDArray[np.uint8] = batch.column("class").to_numpy()
    return classes


class Section:
    """The records of one section of a map, read when asked for and checked against their checksums.

    A section that the map does not have has no records. One of other columns than this version knows is a MapError.
    """

    def __init__(self, storage: MapStorage, manifest: Manifest, name: str) -> None:
        import pyarrow as pa

        self.name = name
        self._storage = storage
        self._table = manifest.sections.get(name) or ShardTable.empty()
        self._rows = self._table.rows_by_key()
        self.keys = frozenset(self._rows)
        """Keys of the tiles that have a record."""
        if not self._rows:
            return
        self._schema = pa.ipc.read_schema(pa.py_buffer(self._table.schema))
        if name in (TILES, GROUND, CLASSES) and not self._schema.equals(_schema(name)):
            raise MapError(
                f"Expected the {name} of {storage.where('')} to have columns of types that this version knows, but they"
                f" have not. {REBUILD}"
            )

    def prefetch(self, keys: Iterable[TileKey]) -> None:
        """Begin to fetch records that will be read soon, where the map is on a network."""
        self._storage.prefetch([self._table.range_of(self._rows[key]) for key in keys if key in self._rows])

    def keys_in_order(self) -> list[TileKey]:
        """Return the keys in the order in which the records lie in the shards."""
        order = np.lexsort((self._table.offsets, self._table.shards))
        return [(x, y) for x, y in self._table.keys[order].tolist()]

    def where(self, key: TileKey) -> str:
        """Return where a record lies, for messages."""
        return f"tile {key} in {self._storage.where(self._table.range_of(self._rows[key]).name)}"

    def batch(self, key: TileKey) -> Any:
        """Return the Arrow record batch of a tile, in private memory: later changes of the file do no harm."""
        import pyarrow as pa

        return pa.ipc.read_record_batch(pa.py_buffer(self._content(key)), self._schema)

    def record(self, key: TileKey) -> Record:
        """Return the record of a tile, checked as by `batch`, to write it into another map."""
        table, row = self._table, self._rows[key]
        n_rows, n_points = int(table.n_rows[row]), int(table.n_points[row])
        checksum = table.checksums[row].tobytes()
        return Record(self.name, key, n_rows, n_points, table.schema, bytes(self._content(key)), checksum)

    def _content(self, key: TileKey) -> memoryview:
        """Return the bytes of a record."""
        row = self._rows[key]
        try:
            content = self._storage.read_range(self._table.range_of(row))
        except OSError as error:
            words = f"got: {error.strerror or error}. {self._storage.remedy}"
            raise MapError(f"Expected {self.where(key)} to be of the map, {words}") from None
        if hashlib.sha256(content).digest() != self._table.checksums[row].tobytes():
            raise MapError(f"Expected {self.where(key)} to be as it was written, got another checksum. {REBUILD}")
        return content


class TileStore:
    """The tiles of a map on disk or on a network, checked when they are read, behind an LRU cache.

    storage: the map's files.
    manifest: its manifest.
    cache_bytes: size of the tiles that are kept, and of their indices.
    left_out: voxels of these classes are left out, and tiles have no classes then. Nothing is left out if None.
    """

    def __init__(
        self,
        storage: MapStorage,
        manifest: Manifest,
        *,
        cache_bytes: int,
        left_out: Collection[SurfaceClass] | None = None,
    ) -> None:
        self._section = Section(storage, manifest, TILES)
        self._classes = Section(storage, manifest, CLASSES)
        self._left_out = left_out
        self._cache: TileCache[VoxelTile] = TileCache(cache_bytes)

    @property
    def keys(self) -> frozenset[TileKey]:
        """Keys of the tiles there are."""
        return self._section.keys

    def load(self, key: TileKey) -> VoxelTile:
        """Return a tile; a MapError if its file is missing, or is not what was written."""
        return self._cache.load(key, lambda: self._read(key))

    def prefetch(self, keys: Iterable[TileKey]) -> None:
        """Begin to fetch tiles that will be needed soon, where the map is on a network."""
        wanted = [key for key in keys if key not in self._cache]
        self._section.prefetch(wanted)
        self._classes.prefetch(wanted)

    def _read(self, key: TileKey) -> VoxelTile:
        batch = self._section.batch(key)
        columns, normals, means = (
            batch.column(name).flatten().to_numpy().reshape(-1, n)
            for name, n in (("column", 2), ("normal", 3), ("mean", 3))
        )
        layers, counts = (batch.column(name).to_numpy() for name in ("layer", "count"))
        tile = VoxelTile(key, columns, layers, counts, normals, means)  # views of the batch
        if not tile.is_in_order:
            raise MapError(
                f"Expected the voxels of {self._section.where(key)} in the order of the search, got another. {REBUILD}"
            )
        if key not in self._classes.keys:
            return tile
        classes = classes_of_batch(self._classes.batch(key))
        if len(classes) != len(tile) or not np.isin(classes, list(SurfaceClass)).all():
            raise MapError(
                f"Expected a class for each of {len(tile):,} voxels in {self._classes.where(key)}, got other"
                f" numbers. {UPDATE}"
            )
        tile = replace(tile, classes=classes)
        return tile if self._left_out is None else tile.without(self._left_out)


class GroundStore:
    """The ground of a map on disk or on a network, behind an LRU cache."""

    def __init__(self, storage: MapStorage, manifest: Manifest) -> None:
        self._section = Section(storage, manifest, GROUND)
        self._n_cells = TILE_VOXELS // ground_voxels(manifest.cell)
        self._cache: TileCache[GroundTile] = TileCache(GROUND_CACHE_BYTES)

    @property
    def keys(self) -> frozenset[TileKey]:
        """Keys of the tiles that have ground."""
        return self._section.keys

    def load(self, key: TileKey) -> GroundTile:
        """Return the ground of a tile; a MapError if its file is missing, or is not what was written."""
        return self._cache.load(key, lambda: self._read(key))

    def _read(self, key: TileKey) -> GroundTile:
        around = range(-PREFETCHED_AROUND, PREFETCHED_AROUND + 1)
        near = [(key[0] + x, key[1] + y) for x in around for y in around]
        self._section.prefetch([other for other in near if other not in self._cache])
        batch = self._section.batch(key)
        columns = batch.column("column").flatten().to_numpy().reshape(-1, 2)
        return GroundTile.from_rows(key, columns, batch.column("height").to_numpy(), self._n_cells)
