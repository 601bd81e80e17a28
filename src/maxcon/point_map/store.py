# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The map on disk: a folder with a JSON manifest and Arrow IPC tiles that are mapped, not copied (D10).

```
city.map/
  manifest.json          format version, CRS, origin, cell, what was dropped, sources, a checksum per tile
  tiles/{x}_{y}.arrow    one record batch: column (int16 x 2), layer (int32), count (int32), normal (float x 3)
```
"""

import hashlib
import json
import math
import os
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from maxcon.errors import MapError
from maxcon.point_map.tile import TILE_VOXELS, TileKey, VoxelTile

__all__ = [
    "FORMAT",
    "FORMAT_VERSION",
    "MAP_NAMES",
    "Manifest",
    "TileEntry",
    "TileStore",
    "read_manifest",
    "write_manifest",
    "write_tile",
]

FORMAT = "maxcon map"
FORMAT_VERSION = 1
MANIFEST = "manifest.json"
MAP_NAMES = (MANIFEST, "tiles")
"""All that the folder of a map holds."""
REBUILD = "Build the map again with `maxcon map build`."


@dataclass(frozen=True, slots=True)
class TileEntry:
    """What the manifest knows of a tile."""

    key: TileKey
    n_voxels: int
    n_points: int
    sha256: str


@dataclass(frozen=True, slots=True)
class Manifest:
    """What a map is made of; `maxcon map info` prints it.

    Parameters
    ----------
    cell : float
        Voxel edge, m.
    origin : tuple of 3 float
        Global coordinates of the local frame's origin, m.
    crs : str or None
        WKT.
    is_signed : bool
        Whether normals are turned to the sensor's side.
    tiles : tuple of TileEntry
        One per tile file.
    build : mapping
        How it was made: sources, points read and dropped, the program's version.
    """

    cell: float
    origin: tuple[float, float, float]
    crs: str | None
    is_signed: bool
    tiles: tuple[TileEntry, ...]
    build: Mapping[str, Any] = field(default_factory=dict)

    @property
    def n_points(self) -> int:
        """Points in all voxels."""
        return sum(tile.n_points for tile in self.tiles)

    @property
    def n_voxels(self) -> int:
        """Occupied voxels."""
        return sum(tile.n_voxels for tile in self.tiles)


def _tile_path(folder: Path, key: TileKey) -> Path:
    return folder / "tiles" / f"{key[0]}_{key[1]}.arrow"


def _schema() -> Any:
    import pyarrow as pa

    return pa.schema(
        [
            pa.field("column", pa.list_(pa.field("item", pa.int16(), nullable=False), 2), nullable=False),
            pa.field("layer", pa.int32(), nullable=False),
            pa.field("count", pa.int32(), nullable=False),
            pa.field("normal", pa.list_(pa.field("item", pa.float32(), nullable=False), 3), nullable=False),
        ]
    )


def write_tile(folder: Path, tile: VoxelTile) -> TileEntry:
    """Write one tile into the folder of a map and return its entry for the manifest."""
    import pyarrow as pa

    path = _tile_path(folder, tile.key)
    path.parent.mkdir(exist_ok=True)
    schema = _schema()
    batch = pa.record_batch(
        [
            pa.FixedSizeListArray.from_arrays(tile.columns.reshape(-1), type=schema.field("column").type),
            pa.array(tile.layers),
            pa.array(tile.counts),
            pa.FixedSizeListArray.from_arrays(tile.normals.reshape(-1), type=schema.field("normal").type),
        ],
        schema=schema,
    )
    with pa.OSFile(str(path), "wb") as sink, pa.ipc.new_file(sink, schema) as writer:
        writer.write_batch(batch)
    with path.open("rb") as file:
        checksum = hashlib.file_digest(file, "sha256").hexdigest()
    return TileEntry(tile.key, len(tile), int(tile.counts.sum(dtype=np.int64)), checksum)


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write the manifest: the last step of a build."""
    content = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "tile_voxels": TILE_VOXELS,
        **asdict(manifest),
    }
    (folder / MANIFEST).write_text(json.dumps(content, indent=1) + "\n")


def read_manifest(path: str | os.PathLike[str]) -> Manifest:
    """Read the manifest of a map.

    Raises
    ------
    MapError
        If `path` is not a map, its format version is another, or its manifest is broken.
    """
    file = Path(path) / MANIFEST
    try:
        content = json.loads(file.read_text())
    except (FileNotFoundError, NotADirectoryError):
        what = "a file" if Path(path).is_file() else "no such folder"
        what = f"no {MANIFEST} in it" if Path(path).is_dir() else what
        raise MapError(
            f"Expected {path} to be a map, got {what}. Build one with `maxcon map build`."
        ) from None
    except OSError as error:
        raise MapError(
            f"Expected to be able to read {file}, got: {error.strerror}. Check the path and its permissions."
        ) from None
    except (ValueError, RecursionError) as error:
        raise MapError(f"Expected {file} to be the manifest of a map, got: {error}. {REBUILD}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise MapError(f"Expected {file} to say it is a {FORMAT}, but it does not. {REBUILD}")
    version = content.get("format_version")
    if version != FORMAT_VERSION:
        raise MapError(
            f"Expected {path} to have map format version {FORMAT_VERSION}, got {version!r}. {REBUILD}"
        )
    try:
        return _parse_manifest(content)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        words = f"no {error}" if isinstance(error, KeyError) else f"a broken entry: {error}"
        raise MapError(f"Expected a whole manifest in {file}, got {words}. {REBUILD}") from None


def _parse_manifest(content: Mapping[str, Any]) -> Manifest:
    cell = float(content["cell"])
    x, y, z = (float(value) for value in content["origin"])
    if not (cell > 0.0 and all(map(math.isfinite, (cell, x, y, z)))):
        raise ValueError(f"cell {cell}, origin {(x, y, z)}")
    if content["tile_voxels"] != TILE_VOXELS:
        raise ValueError(f"tile_voxels {content['tile_voxels']}")
    crs = content["crs"]
    if not (crs is None or isinstance(crs, str)):
        raise TypeError("crs")
    if not isinstance(content["is_signed"], bool):
        raise TypeError("is_signed")
    tiles = []
    for entry in content["tiles"]:
        key_x, key_y = (int(value) for value in entry["key"])
        tiles.append(
            TileEntry((key_x, key_y), int(entry["n_voxels"]), int(entry["n_points"]), str(entry["sha256"]))
        )
    if not tiles:
        raise ValueError("no tiles")
    build = dict(content["build"])
    _check_sources(build.get("sources", []))
    return Manifest(cell, (x, y, z), crs, bool(content["is_signed"]), tuple(tiles), build)


def _check_sources(sources: Sequence[Mapping[str, Any]]) -> None:
    for source in sources:
        numbers = [source[name] for name in ("n_points", "n_kept", "n_invalid", "n_without_side")]
        numbers += [number for pair in source["n_dropped"].items() for number in (int(pair[0]), pair[1])]
        if not (isinstance(source["name"], str) and isinstance(source["is_classified"], bool)):
            raise TypeError("sources")
        if not all(isinstance(number, int) for number in numbers):
            raise TypeError("sources")


class TileStore:
    """Tiles of a map on disk, mapped when asked for and kept in a bounded cache.

    Parameters
    ----------
    path : path
        The map's folder.
    manifest : Manifest
        Its manifest.
    cache_bytes : int
        Size of all kept tiles and their indices; the ones used longest ago go first.
    """

    def __init__(self, path: str | os.PathLike[str], manifest: Manifest, *, cache_bytes: int) -> None:
        self._folder = Path(path)
        self._entries = {tile.key: tile for tile in manifest.tiles}
        self._keys = frozenset(self._entries)
        self._cache: OrderedDict[TileKey, VoxelTile] = OrderedDict()
        self._cache_bytes = cache_bytes
        self._used_bytes = 0

    @property
    def keys(self) -> frozenset[TileKey]:
        """Keys of the tiles there are."""
        return self._keys

    def load(self, key: TileKey) -> VoxelTile:
        """Return a tile, from the cache or from disk.

        Raises
        ------
        MapError
            If its file is missing, or is not what was written.
        """
        tile = self._cache.get(key)
        if tile is not None:
            self._cache.move_to_end(key)
            return tile
        tile = self._read(self._entries[key])
        self._cache[key] = tile
        self._used_bytes += tile.n_bytes
        while self._used_bytes > self._cache_bytes and len(self._cache) > 1:
            _, oldest = self._cache.popitem(last=False)
            self._used_bytes -= oldest.n_bytes
        return tile

    def _read(self, entry: TileEntry) -> VoxelTile:
        import pyarrow as pa

        path = _tile_path(self._folder, entry.key)
        try:
            with path.open("rb") as file:
                checksum = hashlib.file_digest(file, "sha256").hexdigest()
            if checksum != entry.sha256:
                raise MapError(f"Expected {path} to be as it was written, got another checksum. {REBUILD}")
            batch = pa.ipc.open_file(pa.memory_map(str(path))).get_batch(0)
        except (OSError, pa.ArrowException) as error:
            words = getattr(error, "strerror", None) or str(error).partition("\n")[0]
            raise MapError(f"Expected {path} to be a tile of the map, got: {words}. {REBUILD}") from None
        if not batch.schema.equals(_schema()) or batch.num_rows != entry.n_voxels:
            raise MapError(f"Expected {entry.n_voxels} voxels in {path}, got {batch.num_rows}. {REBUILD}")
        tile = VoxelTile(
            entry.key,
            batch.column("column").flatten().to_numpy().reshape(-1, 2),
            batch.column("layer").to_numpy(),
            batch.column("count").to_numpy(),
            batch.column("normal").flatten().to_numpy().reshape(-1, 3),
        )
        if not tile.is_in_order:
            raise MapError(
                f"Expected the voxels of {path} in the order of the search, got another. {REBUILD}"
            )
        return tile
