"""The manifest of a map and the indices of its sections: what it is made of, and where each record lies (D10)."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
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

FORMAT, FORMAT_VERSION = "maxcon map", 3
MANIFEST = "manifest.json"
MAX_MANIFEST_BYTES = 2**30
TILES, GROUND = "tiles", "ground"  # sections of every map
CLASSES = "classes"  # section of a map that was updated: of the tiles in which anything is gone or new
MAP_NAMES = (MANIFEST, TILES, GROUND, CLASSES)  # names of the files and folders in the folder of a map
REBUILD = "Build the map again with `maxcon map build`."
RECORDS = b"records"  # key in the metadata of an index whose value is the schema of the records
INDEX = np.dtype(
    [
        ("key", np.int32, 2), ("n_rows", np.int32), ("n_points", np.int64), ("shard", np.int32),
        ("offset", np.int64), ("length", np.int64), ("sha256", "V32"),
    ]
)  # fmt: skip
"""A row of an index: key (x, y) of the tile; rows of the record, voxels or heights, and map points they stand for;
number of the file that it lies in, its first byte there, its number of bytes, and their SHA-256."""
NUMBERS = ("n_rows", "n_points", "shard", "offset", "length")


class ShardFile(Struct, frozen=True):
    """A file that records lie in: its name in the map, and its size in bytes."""

    name: Annotated[str, Meta(pattern=r"\A[a-z][a-z_]*/[0-9A-Za-z_-]+(\.[0-9A-Za-z_-]+)*\Z")]
    n_bytes: Annotated[int, Meta(ge=0, lt=2**62)] = msgspec.field(name="bytes")


@dataclass(frozen=True, eq=False)
class ShardTable:
    """The index of a section: a row for each record, by ascending key."""

    schema: bytes = b""  # arrow IPC message of the schema of all records
    files: tuple[ShardFile, ...] = ()  # the shards
    rows: NDArray[np.void] = field(default_factory=lambda: np.empty(0, INDEX))  # (n,)
    name: str = ""  # of its own file, where it was read

    def __len__(self) -> int:
        return len(self.rows)

    @cached_property
    def numbers(self) -> dict[TileKey, int]:
        """Number of the row of each key."""
        return {(x, y): number for number, (x, y) in enumerate(self.rows["key"].tolist())}

    def range_of(self, key: TileKey) -> ByteRange:
        """Return where a record lies."""
        row = self.rows[self.numbers[key]]
        return ByteRange(self.files[row["shard"]].name, int(row["offset"]), int(row["length"]))

    def to_bytes(self) -> bytes:
        """Return the table as an Arrow IPC file, the schema of the records among its metadata."""
        import pyarrow as pa

        columns = dict(zip("xy", self.rows["key"].T, strict=True))
        columns |= {name: self.rows[name] for name in NUMBERS}
        arrays = [pa.array(np.ascontiguousarray(column)) for column in columns.values()]
        kind = pa.binary(INDEX["sha256"].itemsize)
        buffers = [None, pa.py_buffer(self.rows["sha256"].tobytes())]
        arrays.append(pa.FixedSizeBinaryArray.from_buffers(kind, len(self), buffers))
        fields = [pa.field(name, a.type, nullable=False) for name, a in zip([*columns, "sha256"], arrays, strict=True)]
        batch = pa.record_batch(arrays, schema=pa.schema(fields, metadata={RECORDS: self.schema}))
        sink = pa.BufferOutputStream()
        with pa.ipc.new_file(sink, batch.schema) as writer:
            writer.write_batch(batch)
        content: bytes = sink.getvalue().to_pybytes()
        return content

    @classmethod
    def from_bytes(cls, content: Any, files: tuple[ShardFile, ...], name: str = "") -> "ShardTable":
        """Return the table that `to_bytes` wrote, of records in these files; their checksum was verified before."""
        import pyarrow as pa

        with pa.ipc.open_file(pa.py_buffer(content)) as file:
            schema, batch = file.schema.metadata[RECORDS], file.get_batch(0)
        rows = np.empty(len(batch), INDEX)
        rows["key"] = np.column_stack([batch.column("x"), batch.column("y")])
        for each in NUMBERS:
            rows[each] = batch.column(each)
        rows["sha256"] = np.frombuffer(batch.column("sha256").buffers()[1], INDEX["sha256"], len(batch))
        return cls(schema, files, rows, name)


@dataclass(frozen=True, slots=True, eq=False)
class Manifest:
    """What a map is made of; `maxcon map info` prints it."""

    cell: float  # voxel edge, m
    origin: tuple[float, float, float]  # global coordinates of the local frame's origin, m
    crs: str | None  # WKT
    is_signed: bool  # whether normals are turned to the sensor's side
    # By name, where the records of each section lie: "tiles", of voxels, and "ground", of the ground grid, without
    # records where it is not known; others that were written
    sections: Mapping[str, ShardTable]
    # How it was made: sources, points read and dropped, the program's version, where sigma is from
    build: Mapping[str, Any] = field(default_factory=dict)
    sigma: float = UNKNOWN_SIGMA  # standard deviation of the map's position along any axis, m
    sha256: str = ""  # its checksum, where it was read; empty where it is made

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
        return int(self.tiles.rows["n_points"].sum())

    @property
    def n_voxels(self) -> int:
        """Occupied voxels."""
        return int(self.tiles.rows["n_rows"].sum())


class _Section(Struct):
    index: Annotated[str, Meta(pattern=r"\A[a-z][a-z_]*/index-[0-9a-f]+\.arrow\Z")]
    index_bytes: Annotated[int, Meta(ge=0, lt=2**32)]
    index_sha256: str
    shards: tuple[ShardFile, ...]


Metres = Annotated[float, Meta(ge=-1e12, le=1e12)]


class _Content(Struct):
    """What the manifest must hold for a search; how the map was built is believed to its checksum."""

    cell: Annotated[float, Meta(ge=CELLS[0], le=CELLS[1])]
    origin: tuple[Metres, Metres, Metres]
    crs: str | None
    is_signed: bool
    sigma: Annotated[float, Meta(ge=0.0, le=1e12)]
    tile_voxels: Literal[512]
    ground_voxels: int
    build: dict[str, Any]
    sections: dict[Annotated[str, Meta(pattern=r"\A[a-z][a-z_]*\Z")], _Section]


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write the indices of the sections that have records, and the manifest: the last step of a build."""
    sections = {name: _write_index(folder, name, table) for name, table in manifest.sections.items() if len(table)}
    content = {
        "format": FORMAT, "format_version": FORMAT_VERSION, "tile_voxels": TILE_VOXELS,
        "ground_voxels": ground_voxels(manifest.cell), "cell": manifest.cell, "origin": manifest.origin,
        "crs": manifest.crs, "is_signed": manifest.is_signed, "sigma": manifest.sigma, "build": manifest.build,
        "sections": sections,
    }  # fmt: skip
    content["sha256"] = checksum_of_manifest(content)
    (folder / MANIFEST).write_text(json.dumps(content, indent=1) + "\n")


def _write_index(folder: Path, name: str, table: ShardTable) -> dict[str, Any]:
    """Write the index of a section; return its entry in the manifest. Its name has a checksum of its content."""
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
    if TILES not in found.sections or found.ground_voxels != ground_voxels(found.cell):
        what = "`ground_voxels` that suit `cell`" if TILES in found.sections else "a map of at least one tile"
        raise MapError(f"Expected {what} in {file}, got none. {REBUILD}")
    sections = {GROUND: ShardTable()} | {name: _read_index(entry, storage) for name, entry in found.sections.items()}
    return Manifest(
        found.cell, found.origin, found.crs, found.is_signed, sections, found.build, found.sigma, content["sha256"]
    )


def _read_json(storage: MapStorage) -> Any:
    try:
        return msgspec.json.decode(storage.read(MANIFEST, MAX_MANIFEST_BYTES))
    except (FileNotFoundError, NotADirectoryError) as error:
        raise MapError(
            f"Expected {storage.where('')} to be a map, got no {MANIFEST} there ({error.strerror})."
            " Build one with `maxcon map build`."
        ) from None
    except (OSError, ValueError, RecursionError) as error:
        words = getattr(error, "strerror", None) or error
        raise MapError(
            f"Expected {storage.where(MANIFEST)} to be the manifest of a map, got: {words}. {storage.remedy}"
        ) from None


def _read_index(entry: _Section, storage: MapStorage) -> ShardTable:
    """Read the index of a section, and verify its checksum."""
    where = storage.where(entry.index)
    try:
        content = storage.read_range(ByteRange(entry.index, 0, entry.index_bytes))
    except OSError as error:
        raise MapError(
            f"Expected {where} to be the index of the map, got: {error.strerror or error}. {storage.remedy}"
        ) from None
    if hashlib.sha256(content).hexdigest() != entry.index_sha256:
        raise MapError(f"Expected {where} to be as it was written, got another checksum. {REBUILD}")
    return ShardTable.from_bytes(content, entry.shards, entry.index)
