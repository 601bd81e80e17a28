# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The tiles of a map on disk: Arrow IPC files that are mapped, not copied (D10).

```
city.map/
  manifest.json          format version, CRS, origin, cell, what was dropped, sources, a checksum per tile
  tiles/{x}_{y}.arrow    one record batch: column (int16 x 2), layer (int32), count (int32), normal (float x 3),
                         mean (uint8 x 3)
```
"""

import hashlib
import os
import threading
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np

from maxcon.errors import MapError
from maxcon.point_map.manifest import REBUILD, Manifest, TileEntry
from maxcon.point_map.tile import TileKey, VoxelTile

__all__ = ["TileStore", "write_tile"]


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
            pa.field("mean", pa.list_(pa.field("item", pa.uint8(), nullable=False), 3), nullable=False),
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
            pa.FixedSizeListArray.from_arrays(tile.means.reshape(-1), type=schema.field("mean").type),
        ],
        schema=schema,
    )
    with pa.OSFile(str(path), "wb") as sink, pa.ipc.new_file(sink, schema) as writer:
        writer.write_batch(batch)
    with path.open("rb") as file:
        checksum = hashlib.file_digest(file, "sha256").hexdigest()
    return TileEntry(tile.key, len(tile), int(tile.counts.sum(dtype=np.int64)), checksum)


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
        self._lock = threading.Lock()
        self._verified: set[TileKey] = set()

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
        with self._lock:
            tile = self._cache.get(key)
            if tile is not None:
                self._cache.move_to_end(key)
                return tile
            tile = self._read(self._entries[key])
            self._cache[key] = tile
            used_bytes = sum(kept.n_bytes for kept in self._cache.values())
            while used_bytes > self._cache_bytes and len(self._cache) > 1:
                _, oldest = self._cache.popitem(last=False)
                used_bytes -= oldest.n_bytes
            return tile

    def _read(self, entry: TileEntry) -> VoxelTile:
        import pyarrow as pa

        path = _tile_path(self._folder, entry.key)
        try:
            mapped = pa.memory_map(str(path)).read_buffer()
            if entry.key not in self._verified:
                checksum = hashlib.sha256(mapped).hexdigest()
                if checksum != entry.sha256:
                    raise MapError(
                        f"Expected {path} to be as it was written, got another checksum. {REBUILD}"
                    )
                self._verified.add(entry.key)
            batch = pa.ipc.open_file(mapped).get_batch(0)
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
            batch.column("mean").flatten().to_numpy().reshape(-1, 3),
        )
        if not tile.is_in_order:
            raise MapError(
                f"Expected the voxels of {path} in the order of the search, got another. {REBUILD}"
            )
        return tile
