"""Records of tiles: written into the shards of a map, read from them when asked for and checked, and copied (D10).

A record is one message of the Arrow IPC stream format, its buffers compressed with LZ4 (docs/map_format.md).
"""

import hashlib
import os
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from maxcon._system import Progress
from maxcon._system.atomic import atomic_folder, check_replaceable
from maxcon._system.engine import in_threads
from maxcon.errors import FileError, MapError, OptionError
from maxcon.map.ground import GroundTile, ground_voxels
from maxcon.map.layout import TILE_VOXELS, SurfaceClass, TileKey
from maxcon.map.manifest import (
    CLASSES,
    GROUND,
    INDEX,
    MANIFEST,
    MAP_NAMES,
    REBUILD,
    TILES,
    Manifest,
    ShardFile,
    ShardTable,
    read_manifest,
    write_manifest,
)
from maxcon.map.storage import Folder, MapStorage, Remote, address_of, open_storage
from maxcon.map.tile import PREFETCH_THREADS, TileCache, VoxelTile

END_OF_STREAM = b"\xff\xff\xff\xff\0\0\0\0"  # how a stream of the Arrow IPC format ends
GROUND_BYTES = 2**24  # size of the cache of the tiles of the ground
SHARD_BYTES = 2**27  # largest size of a shard of several records


@dataclass(frozen=True, slots=True)
class Record:
    """What a section of a map keeps of one tile."""

    section: str  # lower-case letters and underscores
    key: TileKey  # of the tile
    n_rows: int  # of the record batch
    n_points: int  # map points that the rows stand for; 0 where they stand for none
    schema: bytes  # arrow IPC message, the same for all records of a section
    content: bytes | memoryview  # arrow IPC message of the record batch
    sha256: bytes  # of the content

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


class Section:
    """The records of a section, checked when read; none if the map lacks it. MapError if its columns differ."""

    def __init__(self, storage: MapStorage, manifest: Manifest, name: str) -> None:
        import pyarrow as pa

        self.name = name
        self._storage = storage
        self._table = manifest.sections.get(name) or ShardTable()
        self.keys = frozenset(self._table.numbers)
        """Keys of the tiles that have a record."""
        if not self.keys:
            return
        self._schema = pa.ipc.read_schema(pa.py_buffer(self._table.schema))
        if name in (TILES, GROUND, CLASSES) and not self._schema.equals(_schema(name)):
            raise MapError(
                f"Expected the {name} of {storage.where('')} to have columns of types that this version knows, but they"
                f" have not. {REBUILD}"
            )

    def where(self, key: TileKey) -> str:
        """Return where a record lies, for messages."""
        return f"tile {key} in {self._storage.where(self._table.range_of(key).name)}"

    def columns(self, key: TileKey) -> list[NDArray[Any]]:
        """Return the columns of a record, in private memory: later changes of the file do no harm."""
        import pyarrow as pa

        batch = pa.ipc.read_record_batch(pa.py_buffer(self.record(key).content), self._schema)
        return [
            column.flatten().to_numpy().reshape(-1, column.type.list_size)
            if pa.types.is_fixed_size_list(column.type)
            else column.to_numpy()
            for column in batch.columns
        ]

    def record(self, key: TileKey) -> Record:
        """Return the record of a tile, checked, to write it into another map."""
        table, row = self._table, self._table.rows[self._table.numbers[key]]
        try:
            content = self._storage.read_range(table.range_of(key))
        except OSError as error:
            words = f"got: {error.strerror or error}. {self._storage.remedy}"
            raise MapError(f"Expected {self.where(key)} to be of the map, {words}") from None
        checksum = hashlib.sha256(content).digest()
        if checksum != row["sha256"].tobytes():
            raise MapError(f"Expected {self.where(key)} to be as it was written, got another checksum. {REBUILD}")
        return Record(self.name, key, int(row["n_rows"]), int(row["n_points"]), table.schema, content, checksum)

    def records(self) -> Iterator[Record]:
        """Return all records, checked, in the order in which they lie in the shards; several are read at a time."""
        rows = self._table.rows
        keys = [(x, y) for x, y in rows["key"][np.lexsort((rows["offset"], rows["shard"]))].tolist()]
        return in_threads(self.record, keys, PREFETCH_THREADS)


def stored_tiles(
    storage: MapStorage, manifest: Manifest, *, cache_bytes: int, left_out: Collection[SurfaceClass] | None = None
) -> TileCache[VoxelTile]:
    """Return the tiles of a map, checked when read, in an LRU cache; voxels of classes `left_out` are not in them."""
    tiles, classes = Section(storage, manifest, TILES), Section(storage, manifest, CLASSES)

    def read(key: TileKey) -> VoxelTile:
        columns, layers, counts, normals, means = tiles.columns(key)  # views of the record
        tile = VoxelTile(key, columns, layers, counts, normals, means)
        if not tile.is_in_order:
            raise MapError(f"Expected voxels of {tiles.where(key)} in the order of the search, got another. {REBUILD}")
        if key not in classes.keys:
            return tile
        (of_voxels,) = classes.columns(key)
        if len(of_voxels) != len(tile) or not np.isin(of_voxels, list(SurfaceClass)).all():
            raise MapError(
                f"Expected a class for each of {len(tile):,} voxels in {classes.where(key)}, got other numbers."
                " Update the map it was made of again with `maxcon map update`."
            )
        tile = replace(tile, classes=of_voxels)
        return tile if left_out is None else tile.without(left_out)

    return TileCache(read, cache_bytes, tiles.keys)


def stored_ground(storage: MapStorage, manifest: Manifest) -> TileCache[GroundTile]:
    """Return the ground of a map, checked when it is read, behind an LRU cache."""
    section, n_cells = Section(storage, manifest, GROUND), TILE_VOXELS // ground_voxels(manifest.cell)

    def read(key: TileKey) -> GroundTile:
        columns, heights = section.columns(key)
        return GroundTile.from_rows(key, columns, heights, n_cells)

    return TileCache(read, GROUND_BYTES, section.keys)


class MapWriter(ExitStack):
    """Writes a map into an empty folder: `put` the records of its tiles, then `finish`; before that it is no map."""

    def __init__(self, folder: Path, *, shard_bytes: int = SHARD_BYTES) -> None:
        super().__init__()
        self._folder = folder
        self._shard_bytes = shard_bytes
        self._sections: dict[str, _SectionWriter] = {}

    def put(self, record: Record) -> None:
        """Write a record into its section: one of each tile, all of one schema."""
        if record.section not in self._sections:
            self._sections[record.section] = _SectionWriter(self, self._folder, record, self._shard_bytes)
        self._sections[record.section].put(record)

    def finish(self, manifest: Manifest) -> Manifest:
        """Complete the shards, write their indices and a manifest that names them and says the same; return that."""
        sections = {TILES: ShardTable(), GROUND: ShardTable()}
        sections |= {name: section.finish() for name, section in self._sections.items()}
        manifest = replace(manifest, sections=sections, sha256="")
        write_manifest(self._folder, manifest)
        return manifest


def map_folder(out: str | os.PathLike[str], *, overwrite: bool) -> AbstractContextManager[Path]:
    """Folder to fill with a map, which appears at `out` when all is done; a map that is there is replaced if asked."""
    if overwrite:
        check_replaceable(out, "a map", MAP_NAMES)
    return atomic_folder(out, overwrite=overwrite)


class _SectionWriter:
    """Writes the shards of one section, whose records have the schema of the first; `open_files` closes them, too."""

    def __init__(self, open_files: ExitStack, folder: Path, first: Record, shard_bytes: int) -> None:
        self._open_files = open_files
        self._folder = folder
        self._name = first.section
        self._schema = first.schema
        self._shard_bytes = shard_bytes
        self._files: list[ShardFile] = []
        self._rows: list[tuple[Any, ...]] = []
        self._partial = folder / first.section / "partial"
        self._partial.parent.mkdir()
        self._shard: BinaryIO | None = None
        self._n_bytes = 0

    def put(self, record: Record) -> None:
        if self._n_bytes + len(record.content) + len(END_OF_STREAM) > self._shard_bytes:
            self._complete()
        if self._shard is None:
            self._shard = self._open_files.enter_context(self._partial.open("wb"))
            self._n_bytes = self._shard.write(self._schema)
            self._checksums = hashlib.sha256(self._schema)
        place = (len(self._files), self._n_bytes, len(record.content), record.sha256)
        self._n_bytes += self._shard.write(record.content)
        self._checksums.update(record.sha256)
        self._rows.append((record.key, record.n_rows, record.n_points, *place))

    def finish(self) -> ShardTable:
        """Return the table of all records."""
        self._complete()
        return ShardTable(self._schema, tuple(self._files), np.array(sorted(self._rows), INDEX))

    def _complete(self) -> None:
        """Give the shard its name, of its number and its checksums: shards of two maps have different names."""
        if self._shard is None:
            return
        self._n_bytes += self._shard.write(END_OF_STREAM)
        self._shard.close()
        self._shard = None
        name = f"{self._name}/{len(self._files):05}-{self._checksums.hexdigest()[:8]}.arrows"
        self._partial.rename(self._folder / name)
        self._files.append(ShardFile(name, self._n_bytes))


def copy_map(
    source: str | os.PathLike[str], target: str | os.PathLike[str], *, overwrite: bool = False,
    progress: Progress | None = None,
) -> Manifest:  # fmt: skip
    """Copy a map to a folder, or from a folder to s3://; every record is checked. Return its manifest.

    At an address the manifest is written last, so that nobody sees half a map; files of a map that was there before
    stay, for those who are still reading it.
    """
    report = progress or (lambda step, done, total: None)
    address, storage = address_of(target), open_storage(source)
    if address is not None and not (address.startswith("s3://") and isinstance(storage, Folder)):
        raise OptionError(
            f"Expected to copy to a folder, or from a folder to s3://, got {source} and {address}. A web server is only"
            " read; between two object stores, copy to a folder first."
        )
    manifest = read_manifest(storage)
    if address is None:
        with map_folder(target, overwrite=overwrite) as folder, MapWriter(folder) as writer:
            for record in _records(storage, manifest, "copying tiles", report):
                writer.put(record)
            return writer.finish(manifest)
    for _ in _records(storage, manifest, "checking tiles", report):
        pass
    _publish(Path(source), manifest, address, overwrite, report)
    return manifest


def _records(storage: MapStorage, manifest: Manifest, step: str, report: Progress) -> Iterator[Record]:
    """Yield all records of a map, checked."""
    sections = [Section(storage, manifest, name) for name in manifest.sections]
    n_records = sum(len(section.keys) for section in sections)
    for done, record in enumerate((each for section in sections for each in section.records()), 1):
        yield record
        report(step, done, n_records)


def _publish(folder: Path, manifest: Manifest, address: str, overwrite: bool, report: Progress) -> None:
    """Write the files of a map to an address, without those that are there already, and the manifest last."""
    remote, tables = Remote(address), [table for table in manifest.sections.values() if len(table)]
    paths = {name: folder / name for table in tables for name in (*(file.name for file in table.files), table.name)}
    try:
        sizes = {name: path.stat().st_size for name, path in paths.items()}
        if not overwrite and remote.size(MANIFEST) is not None:
            raise FileError(
                f"Expected no map at {address} yet, but there is one. Name another place, or allow"
                " replacing it (--overwrite)."
            )
        done = 0
        for name, path in paths.items():
            if remote.size(name) != sizes[name]:
                remote.write(name, path)
            done += sizes[name]
            report("copying bytes", done, sum(sizes.values()))
        remote.write(MANIFEST, (folder / MANIFEST).read_bytes())
    except OSError as error:
        raise FileError(
            f"Expected to be able to write to {address}, got: {error.strerror or error}. What was written is no map"
            " yet; the same command goes on with it."
        ) from None
