# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The tiles of a map on disk: Arrow IPC files, read whole and checked: what is used is what was written (D10).

```
city.map/
  manifest.json          format version, CRS, origin, cell, what was dropped, sources, a checksum per tile
  tiles/{x}_{y}.arrow    one record batch: column (int16 x 2), layer (int32), count (int32), normal (float x 3),
                         mean (uint8 x 3)
  ground/{x}_{y}.arrow   one record batch: column (int16 x 2), height (float); none of a map without ground
```
"""

import errno
import hashlib
import mmap
import os
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from maxcon.errors import MapError
from maxcon.point_map.ground import GroundTile, RecentTiles, ground_voxels
from maxcon.point_map.kept_tiles import KeptTiles
from maxcon.point_map.layout import TILE_VOXELS, TileKey
from maxcon.point_map.manifest import REBUILD, GroundEntry, Manifest, TileEntry
from maxcon.point_map.tile import VoxelTile
from maxcon.regular_file import open_regular

__all__ = ["GroundStore", "TileStore", "write_ground", "write_tile"]

ROW_BYTES = 27
"""Of a voxel; a height has fewer."""
FORMAT_BYTES = 2**16
"""What the file of a tile has beside the numbers of its voxels: the schema twice, the places of columns, gaps."""


def _tile_path(folder: Path, key: TileKey) -> Path:
    return folder / "tiles" / f"{key[0]}_{key[1]}.arrow"


def _ground_path(folder: Path, key: TileKey) -> Path:
    return folder / "ground" / f"{key[0]}_{key[1]}.arrow"


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


def _ground_schema() -> Any:
    import pyarrow as pa

    return pa.schema(
        [
            pa.field("column", pa.list_(pa.field("item", pa.int16(), nullable=False), 2), nullable=False),
            pa.field("height", pa.float32(), nullable=False),
        ]
    )


def write_tile(folder: Path, tile: VoxelTile) -> TileEntry:
    """Write one tile into the folder of a map and return its entry for the manifest."""
    import pyarrow as pa

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
    checksum = _write(_tile_path(folder, tile.key), batch)
    return TileEntry(tile.key, len(tile), int(tile.counts.sum(dtype=np.int64)), checksum)


def write_ground(folder: Path, tile: GroundTile) -> GroundEntry:
    """Write the ground of one tile into the folder of a map and return its entry for the manifest."""
    import pyarrow as pa

    columns, heights = tile.rows()
    schema = _ground_schema()
    cells = pa.FixedSizeListArray.from_arrays(columns.reshape(-1), type=schema.field("column").type)
    checksum = _write(
        _ground_path(folder, tile.key), pa.record_batch([cells, pa.array(heights)], schema=schema)
    )
    return GroundEntry(tile.key, len(heights), checksum)


def _write(path: Path, batch: Any) -> str:
    """Write one record batch to a file; return its checksum."""
    import pyarrow as pa

    path.parent.mkdir(exist_ok=True)
    with pa.OSFile(str(path), "wb") as sink, pa.ipc.new_file(sink, batch.schema) as writer:
        writer.write_batch(batch)
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _read(path: Path, schema: Any, n_rows: int, sha256: str) -> Any:
    """Record batch of a file that was written so, in memory of its own: whatever becomes of the file.

    Raises
    ------
    MapError
        If the file is missing, or is not what was written.
    """
    import pyarrow as pa

    try:
        content = _content(path, ROW_BYTES * n_rows + FORMAT_BYTES)
        if hashlib.sha256(content).hexdigest() != sha256:
            raise MapError(f"Expected {path} to be as it was written, got another checksum. {REBUILD}")
        batch = pa.ipc.open_file(content).get_batch(0)
    except (OSError, pa.ArrowException) as error:
        words = getattr(error, "strerror", None) or str(error).partition("\n")[0]
        raise MapError(f"Expected {path} to be a tile of the map, got: {words}. {REBUILD}") from None
    if not batch.schema.equals(schema) or batch.num_rows != n_rows:
        what = "voxels" if "layer" in schema.names else "heights"
        raise MapError(f"Expected {n_rows} {what} in {path}, got {batch.num_rows}. {REBUILD}")
    return batch


def _content(path: Path, most_bytes: int) -> Any:
    """Return the bytes of a file, aligned as Arrow has them; no more than there can be.

    Raises
    ------
    OSError
        If it cannot be read, is no file, or is larger.
    """
    import pyarrow as pa

    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size > most_bytes:
            raise OSError(errno.EFBIG, f"{size:,} bytes, more than its voxels take")
        content = _memory(size)
        n_read = file.readinto(content) or 0
        return pa.py_buffer(content).slice(0, n_read)


def _memory(size: int) -> mmap.mmap:
    """Memory of nobody else's, in large pages where the system has them: half the time of getting it is saved."""
    memory = mmap.mmap(-1, max(size, 1))
    if hasattr(mmap, "MADV_HUGEPAGE"):
        with suppress(OSError):
            memory.madvise(mmap.MADV_HUGEPAGE)
    return memory


class TileStore:
    """Tiles of a map on disk, read and checked when asked for and kept in a bounded cache.

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
        self._cache = KeptTiles(cache_bytes)

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
        return self._cache.load(key, lambda: self._read(self._entries[key]))

    def _read(self, entry: TileEntry) -> VoxelTile:
        path = _tile_path(self._folder, entry.key)
        batch = _read(path, _schema(), entry.n_voxels, entry.sha256)
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


class GroundStore:
    """The ground of a map on disk, read when asked for; the tiles used last are kept.

    Parameters
    ----------
    path : path
        The map's folder.
    manifest : Manifest
        Its manifest.
    """

    def __init__(self, path: str | os.PathLike[str], manifest: Manifest) -> None:
        self._folder = Path(path)
        self._entries = {entry.key: entry for entry in manifest.ground}
        self._keys = frozenset(self._entries)
        self._n_cells = TILE_VOXELS // ground_voxels(manifest.cell)
        self._recent = RecentTiles()
        self._lock = threading.Lock()

    @property
    def keys(self) -> frozenset[TileKey]:
        """Keys of the tiles that have ground."""
        return self._keys

    def load(self, key: TileKey) -> GroundTile:
        """Return the ground of a tile.

        Raises
        ------
        MapError
            If its file is missing, or is not what was written.
        """
        with self._lock:
            known = self._recent.get(key)
            return self._recent.keep(known if known is not None else self._read(self._entries[key]))

    def _read(self, entry: GroundEntry) -> GroundTile:
        path = _ground_path(self._folder, entry.key)
        batch = _read(path, _ground_schema(), entry.n_heights, entry.sha256)
        columns = batch.column("column").flatten().to_numpy().reshape(-1, 2)
        heights = batch.column("height").to_numpy()
        n = self._n_cells
        is_inside = ((columns >= 0) & (columns < n)).all() and bool(np.isfinite(heights).all())
        cells = columns[:, 1].astype(np.int64) * n + columns[:, 0]
        if not (is_inside and (np.diff(cells) >= 0).all()):
            raise MapError(
                f"Expected the heights of {path} in the order of their cells, got another. {REBUILD}"
            )
        return GroundTile.from_rows(entry.key, columns, heights, n)
