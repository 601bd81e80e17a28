# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The manifest of a map and the indices of its sections: what it is made of, and where each record lies (D10)."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from maxcon._system.checked import checked
from maxcon.errors import MapError
from maxcon.map.ground import ground_voxels
from maxcon.map.layout import CELLS, TILE_VOXELS, UNKNOWN_SIGMA, TileKey
from maxcon.map.storage import ByteRange, MapStorage, open_storage

__all__ = [
    "CLASSES", "FORMAT", "FORMAT_VERSION", "GROUND", "MANIFEST", "MAP_NAMES", "MAX_MANIFEST_BYTES", "REBUILD", "TILES",
    "Manifest", "ShardFile", "ShardTable", "checksum_of_manifest", "file_names", "read_manifest", "write_manifest",
]  # fmt: skip

FORMAT = "maxcon map"
FORMAT_VERSION = 3
MANIFEST = "manifest.json"
MAX_MANIFEST_BYTES = 2**30
TILES, GROUND = "tiles", "ground"
"""Sections of every map."""
CLASSES = "classes"
"""Section of a map that was updated: of the tiles in which anything is gone or new."""
MAP_NAMES = (MANIFEST, TILES, GROUND, CLASSES)
"""Names of the files and folders in the folder of a map."""
REBUILD = "Build the map again with `maxcon map build`."
CHECKSUM_BYTES = 32
NUMBERS = {
    "x": "int32", "y": "int32", "n_rows": "int32", "n_points": "int64",
    "shard": "int32", "offset": "int64", "length": "int64",
}  # fmt: skip
"""Columns of an index and their types; that of the checksums follows."""
RECORDS = b"records"
"""Key in the metadata of an index whose value is the schema of the records."""


class ShardFile(Struct, frozen=True):
    """A file that records lie in: its name in the map, and its size in bytes."""

    name: Annotated[str, Meta(pattern=r"\A[a-z][a-z_]*/[0-9A-Za-z_-]+(\.[0-9A-Za-z_-]+)*\Z")]
    n_bytes: Annotated[int, Meta(ge=0, lt=2**62)] = msgspec.field(name="bytes")


@dataclass(frozen=True, slots=True, eq=False)
class ShardTable:
    """The index of a section: a row for each record, by ascending key.

    schema: arrow IPC message of the schema of all records.
    files: the shards.
    keys: shape (n, 2), int32; (x, y) of the tiles.
    n_rows, n_points: shape (n,), int32 and int64; rows of each record, voxels or heights, and map points in its voxels.
    shards, offsets, lengths: shape (n,), int32, int64, int64; number of the file that each record lies in, its first
        byte there, and its number of bytes.
    checksums: shape (n, 32), uint8; SHA-256 of its bytes.
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

    @classmethod
    def of_rows(cls, schema: bytes, files: tuple[ShardFile, ...], rows: list[tuple[Any, ...]]) -> "ShardTable":
        """Return the table of rows (key, n_rows, n_points, shard, offset, length, SHA-256) in any order."""
        keys, *numbers, checksums = zip(*sorted(rows), strict=True) if rows else [()] * 7
        n_rows, n_points, shards, offsets, lengths = (np.array(column, np.int64) for column in numbers)
        packed = np.frombuffer(b"".join(checksums), np.uint8).reshape(-1, CHECKSUM_BYTES)
        tiles = np.array(keys, np.int32).reshape(-1, 2)
        return cls(
            schema, files, tiles, n_rows.astype(np.int32), n_points, shards.astype(np.int32), offsets, lengths, packed
        )

    @classmethod
    def empty(cls) -> "ShardTable":
        """Return the table of a section without records."""
        return cls.of_rows(b"", (), [])

    def rows_by_key(self) -> dict[TileKey, int]:
        """Return the number of each record's row."""
        return dict(zip(zip(*self.keys.T.tolist(), strict=True), range(len(self)), strict=True))

    def range_of(self, row: int) -> ByteRange:
        """Return where the record of a row lies."""
        return ByteRange(self.files[self.shards[row]].name, int(self.offsets[row]), int(self.lengths[row]))

    def to_bytes(self) -> bytes:
        """Return the table as an Arrow IPC file, the schema of the records among its metadata."""
        import pyarrow as pa

        checksums = [None, pa.py_buffer(self.checksums.tobytes())]
        packed = pa.FixedSizeBinaryArray.from_buffers(pa.binary(CHECKSUM_BYTES), len(self), checksums)
        x, y = np.ascontiguousarray(self.keys.T)
        numbers = (x, y, self.n_rows, self.n_points, self.shards, self.offsets, self.lengths)
        batch = pa.record_batch([*map(pa.array, numbers), packed], schema=_index_schema())
        batch = batch.replace_schema_metadata({RECORDS: self.schema})
        sink = pa.BufferOutputStream()
        with pa.ipc.new_file(sink, batch.schema) as writer:
            writer.write_batch(batch)
        content: bytes = sink.getvalue().to_pybytes()
        return content

    @classmethod
    def from_bytes(cls, content: Any, files: tuple[ShardFile, ...]) -> "ShardTable":
        """Return the table that `to_bytes` wrote, of records in these files; their checksum was verified before."""
        import pyarrow as pa

        with pa.ipc.open_file(pa.py_buffer(content)) as file:
            schema, batch = file.schema.metadata[RECORDS], file.get_batch(0)
        *numbers, checksums = batch.columns
        x, y, n_rows, n_points, shards, offsets, lengths = (column.to_numpy() for column in numbers)
        packed = np.frombuffer(checksums.buffers()[1], np.uint8, CHECKSUM_BYTES * len(checksums))
        packed = packed.reshape(-1, CHECKSUM_BYTES)
        return cls(schema, files, np.column_stack([x, y]), n_rows, n_points, shards, offsets, lengths, packed)


def _index_schema() -> Any:
    import pyarrow as pa

    numbers = [pa.field(name, getattr(pa, kind)(), nullable=False) for name, kind in NUMBERS.items()]
    return pa.schema([*numbers, pa.field("sha256", pa.binary(CHECKSUM_BYTES), nullable=False)])


@dataclass(frozen=True, slots=True, eq=False)
class Manifest:
    """What a map is made of; `maxcon map info` prints it.

    cell: voxel edge, m.
    origin: global coordinates of the local frame's origin, m.
    crs: WKT.
    is_signed: whether normals are turned to the sensor's side.
    sections: by name, where the records of each section lie: "tiles", of voxels, and "ground", of the ground grid,
        without records where it is not known; others that were written.
    build: how it was made: sources, points read and dropped, the program's version, where sigma is from.
    sigma: standard deviation of the map's position along any axis, m.
    sha256: its checksum, where it was read; empty where it is made.
    """

    cell: float
    origin: tuple[float, float, float]
    crs: str | None
    is_signed: bool
    sections: Mapping[str, ShardTable]
    build: Mapping[str, Any] = field(default_factory=dict)
    sigma: float = UNKNOWN_SIGMA
    sha256: str = ""

    @property
    def tiles(self) -> ShardTable:
        """The tiles of voxels."""
        return self.sections[TILES]

    @property
    def ground(self) -> ShardTable:
        """The tiles of the ground grid."""
        return self.sections[GROUND]

    @property
    def n_points(self) -> int:
        """Points in all voxels."""
        return int(self.tiles.n_points.sum())

    @property
    def n_voxels(self) -> int:
        """Occupied voxels."""
        return int(self.tiles.n_rows.sum())

    @property
    def n_heights(self) -> int:
        """Heights of the ground."""
        return int(self.ground.n_rows.sum())


# What JSON must hold for `maxcon map info` to print it and a search to use it; other entries are kept as they are.
Count = Annotated[int, Meta(ge=0, lt=2**62)]
ClassNumber = Annotated[int, Meta(ge=0, lt=256)]
ClassText = Annotated[str, Meta(pattern=r"\A[0-9]{1,3}\Z")]
Metres = Annotated[float, Meta(ge=-1e12, le=1e12)]


class _Section(Struct):
    index: Annotated[str, Meta(pattern=r"\A[a-z][a-z_]*/index-[0-9a-f]+\.arrow\Z")]
    index_bytes: Annotated[int, Meta(ge=0, lt=2**32)]
    index_sha256: str
    shards: tuple[ShardFile, ...]


class _Source(Struct):
    name: str
    n_points: Count
    n_kept: Count
    n_invalid: Count
    n_without_side: Count
    n_dropped: dict[ClassText, Count]
    is_classified: bool
    n_thinned: Count = 0
    n_withheld: Count = 0


class _Found(Struct):
    n_points: dict[ClassText, Count]
    dropped: list[ClassNumber]
    temporary: str


class _Given(Struct, tag_field="from", tag="given"):
    pass


class _Aligned(Struct, tag_field="from", tag="alignment"):
    pass


class _Assumed(Struct, tag_field="from", tag="assumed"):
    reason: str


class _FromPasses(Struct, tag_field="from", tag="passes"):
    n_passes: int
    sigma_of_pass: float
    n_places: int


class _UpdateDrive(Struct):
    name: str
    n_looks: int


class _Parent(Struct):
    name: str
    sha256: str


class _Update(Struct):
    drives: list[_UpdateDrive]
    parent: _Parent
    n_judged: int
    n_now_gone: int
    n_now_new: int
    n_back: int
    n_known: int
    n_gone: int
    n_new: int


class _Build(Struct):
    sources: list[_Source] = []
    found: _Found | None = None
    sigma: _Given | _Aligned | _Assumed | _FromPasses | None = None
    updates: list[_Update] = []


class _Content(Struct):
    cell: Annotated[float, Meta(ge=CELLS[0], le=CELLS[1])]
    origin: tuple[Metres, Metres, Metres]
    crs: str | None
    is_signed: bool
    sigma: Annotated[float, Meta(ge=0.0, le=1e12)]
    tile_voxels: Literal[512]
    ground_voxels: int
    build: _Build
    sections: dict[Annotated[str, Meta(pattern=r"\A[a-z][a-z_]*\Z")], _Section]


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write the indices of the sections that have records, and the manifest: the last step of a build."""
    sections = {name: _write_index(folder, name, table) for name, table in manifest.sections.items() if len(table)}
    content = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "tile_voxels": TILE_VOXELS,
        "ground_voxels": ground_voxels(manifest.cell),
        "cell": manifest.cell,
        "origin": manifest.origin,
        "crs": manifest.crs,
        "is_signed": manifest.is_signed,
        "sigma": manifest.sigma,
        "build": manifest.build,
        "sections": sections,
    }
    content["sha256"] = checksum_of_manifest(content)
    (folder / MANIFEST).write_text(json.dumps(content, indent=1) + "\n")


def _write_index(folder: Path, name: str, table: ShardTable) -> dict[str, Any]:
    """Write the index of a section; return what the manifest says of it. Its name tells it from that of other maps."""
    content = table.to_bytes()
    checksum = hashlib.sha256(content).hexdigest()
    index = f"{name}/index-{checksum[:8]}.arrow"
    (folder / name).mkdir(exist_ok=True)
    (folder / index).write_bytes(content)
    shards = msgspec.to_builtins(table.files)
    return {"index": index, "index_bytes": len(content), "index_sha256": checksum, "shards": shards}


def checksum_of_manifest(content: Mapping[str, Any]) -> str:
    """SHA-256 of all entries of a manifest but itself, in a form that spaces and order do not change."""
    entries = {name: value for name, value in content.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(entries, sort_keys=True).encode()).hexdigest()


def read_manifest(map_: str | os.PathLike[str] | MapStorage) -> Manifest:
    """Read the manifest of a map (a path, an address, or opened) and the indices of its sections."""
    storage = open_storage(map_) if isinstance(map_, str | os.PathLike) else map_
    file, content = storage.where(MANIFEST), _read_json(storage)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise MapError(f"Expected {file} to say it is a {FORMAT}, but it does not. {REBUILD}")
    version = content.get("format_version")
    if version != FORMAT_VERSION:
        is_newer = isinstance(version, int) and version > FORMAT_VERSION
        raise MapError(
            f"Expected {storage.where('')} to have map format version {FORMAT_VERSION}, got {version!r}."
            f" {'Update maxcon, or build the map again with this version.' if is_newer else REBUILD}"
        )
    if content.get("sha256") != checksum_of_manifest(content):
        raise MapError(f"Expected {file} to be as it was written, got another checksum. {REBUILD}")
    found = checked(content, _Content, file, "a whole manifest", REBUILD.rstrip("."), MapError)
    sections = {name: _read_index(entry, storage) for name, entry in found.sections.items()}
    if TILES not in sections:
        raise MapError(f"Expected a map of at least one tile in {file}, got no tiles. {REBUILD}")
    if GROUND in sections and found.ground_voxels != ground_voxels(found.cell):
        wanted, got = ground_voxels(found.cell), found.ground_voxels
        raise MapError(f"Expected `ground_voxels` of {wanted} for these voxels in {file}, got {got}. {REBUILD}")
    sections = {GROUND: ShardTable.empty(), **sections}
    return Manifest(
        found.cell, found.origin, found.crs, found.is_signed, sections, content["build"], found.sigma, content["sha256"]
    )


def file_names(storage: MapStorage) -> list[str]:
    """Return the names of the files of a map, without the manifest, which was read before."""
    sections = _read_json(storage)["sections"].values()
    return [name for entry in sections for name in (*(shard["name"] for shard in entry["shards"]), entry["index"])]


def _read_json(storage: MapStorage) -> Any:
    file = storage.where(MANIFEST)
    try:
        return msgspec.json.decode(storage.read(MANIFEST, MAX_MANIFEST_BYTES))
    except (FileNotFoundError, NotADirectoryError) as error:
        raise MapError(
            f"Expected {storage.where('')} to be a map, got {storage.what_is_there(MANIFEST, error)}."
            " Build one with `maxcon map build`."
        ) from None
    except OSError as error:
        raise MapError(
            f"Expected to be able to read {file}, got: {error.strerror or error}. Check the path and its permissions."
        ) from None
    except (ValueError, RecursionError) as error:
        raise MapError(f"Expected {file} to be the manifest of a map, got: {error}. {REBUILD}") from None


def _read_index(entry: _Section, storage: MapStorage) -> ShardTable:
    """Read the index of a section, and verify its checksum."""
    where = storage.where(entry.index)
    try:
        content = storage.read(entry.index, entry.index_bytes)
    except OSError as error:
        raise MapError(
            f"Expected {where} to be the index of the map, got: {error.strerror or error}. {storage.remedy}"
        ) from None
    if hashlib.sha256(content).hexdigest() != entry.index_sha256:
        raise MapError(f"Expected {where} to be as it was written, got another checksum. {REBUILD}")
    table = ShardTable.from_bytes(content, entry.shards)
    if int(table.shards.max(initial=-1)) >= len(entry.shards):
        n = len(entry.shards)
        raise MapError(f"Expected all shards of {where} in {storage.where(MANIFEST)}, got {n} `shards`. {REBUILD}")
    return table
