# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""External bucketing: data of tiles in memory while it is little, and else in a file per tile."""

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon._system.atomic import atomic_file
from maxcon.geometry import voxel_indices
from maxcon.map import TILE_VOXELS, TileKey
from maxcon.map.ground import ground_voxels

POINT = np.dtype([("column", "<i2", 2), ("layer", "<i4"), ("inside", "<f4", 3), ("side", "<f4", 3)])
"""One point: its voxel, its position in the voxel (m), and the direction to the sensor, its normal, or zeros."""
GROUND_POINT = np.dtype([("column", "<i2", 2), ("height", "<f4")])
"""One point on the ground: its cell of the ground grid, and its height in the local frame (m)."""
BUFFER_BYTES = 128 * 2**20

Keys = NDArray[np.int32]


def point_records(
    points: NDArray[np.float64], sides: NDArray[np.float32], cell: float
) -> tuple[Keys, NDArray[np.void]]:
    """Tiles, shape (n, 2), and records (`POINT`) of points, shape (n, 3), local frame, m, and their sides, (n, 3)."""
    indices = voxel_indices(points, cell)
    records = np.empty(len(points), POINT)
    keys = indices[:, :2] // TILE_VOXELS
    records["column"] = indices[:, :2] - keys * TILE_VOXELS
    records["layer"] = indices[:, 2]
    records["inside"] = points - indices * cell
    records["side"] = sides
    return keys, records


def ground_records(points: NDArray[np.float64], cell: float) -> tuple[Keys, NDArray[np.void]]:
    """Tiles, shape (n, 2), and records (`GROUND_POINT`) of points on the ground, shape (n, 3), local frame, m."""
    columns = voxel_indices(points, cell)[:, :2]
    keys = columns // TILE_VOXELS
    records = np.empty(len(points), GROUND_POINT)
    records["column"] = (columns - keys * TILE_VOXELS) // ground_voxels(cell)
    records["height"] = points[:, 2]
    return keys, records


class TileBuckets:
    """Records of one kind sorted into tiles; beyond `BUFFER_BYTES` they are appended to a file per tile.

    Another process that is given the same folder finds there what was put on disk.

    `suffix`: of the files.
    """

    def __init__(self, folder: Path, record: "np.dtype[np.void]", suffix: str) -> None:
        self._folder = folder
        self._record = record
        self._suffix = suffix
        self._buffers: dict[TileKey, list[NDArray[np.void]]] = defaultdict(list)
        self._buffered_bytes = 0
        self._has_files = False
        self._keys: set[TileKey] = set()

    @property
    def keys(self) -> list[TileKey]:
        """Tiles that got records, sorted."""
        return sorted(self._keys)

    @property
    def n_tiles(self) -> int:
        """How many tiles have got records so far."""
        return len(self._keys)

    def add(self, keys: Keys, records: NDArray[np.void]) -> None:
        """Take records and the (x, y) of the tile of each, shape (n, 2)."""
        if not len(records):
            return
        corner = keys.min(axis=0)
        x, y = (keys - corner).astype(np.int64).T
        slots = y * (int(x.max()) + 1) + x
        order = np.argsort(slots, kind="stable")
        for group in np.split(order, np.flatnonzero(np.diff(slots[order])) + 1):
            key_x, key_y = keys[group[0]].tolist()
            self._buffers[key_x, key_y].append(records[group])
        self._keys.update(self._buffers)
        self._buffered_bytes += records.nbytes
        if self._buffered_bytes > BUFFER_BYTES:
            self._flush()

    def complete(self, *, to_disk: bool = False) -> None:
        """Say that all records have come; `to_disk` if other processes will look for them there."""
        if to_disk or self._has_files:
            self._flush()

    def _flush(self) -> None:
        for key, parts in self._buffers.items():
            with self._path(key).open("ab") as file:
                for part in parts:
                    file.write(part.tobytes())
        self._has_files = True
        self._buffers.clear()
        self._buffered_bytes = 0

    def records(self, key: TileKey, n_at_once: int = 2_000_000) -> Iterator[NDArray[np.void]]:
        """Yield the records of a tile, at most `n_at_once` together; FileNotFoundError if there are none."""
        if key in self._buffers:
            whole = np.concatenate(self._buffers[key])
            yield from (whole[start : start + n_at_once] for start in range(0, len(whole), n_at_once))
            return
        with self._path(key).open("rb") as file:
            while part := file.read(n_at_once * self._record.itemsize):
                yield np.frombuffer(part, self._record)

    def load(self, key: TileKey) -> NDArray[np.void]:
        """Return all records of a tile; none if it got none."""
        return np.concatenate([np.empty(0, self._record), *(self.records(key) if self.has(key) else ())])

    def has(self, key: TileKey) -> bool:
        """Whether there are records of a tile, in memory here or on disk."""
        return key in self._buffers or self._path(key).exists()

    def replace(self, key: TileKey, records: NDArray[np.void]) -> None:
        """Keep other records of a tile instead of its own; on disk, atomically."""
        if key in self._buffers:
            self._buffers[key] = [records]
            return
        with atomic_file(self._path(key)) as partial:
            partial.write_bytes(records.tobytes())

    def remove(self, key: TileKey) -> None:
        """Delete the records of a tile, if there are any."""
        if self._buffers.pop(key, None) is None:
            self._path(key).unlink(missing_ok=True)

    def _path(self, key: TileKey) -> Path:
        return self._folder / f"{key[0]}_{key[1]}.{self._suffix}"


class TileArrays:
    """Named arrays of tiles between two steps of a job, in memory up to `memory_bytes`, and else in NPZ files.

    With 0 bytes of memory every step may be done by another process; files are written atomically. Any thread may call.

    `memory_bytes`: size of all arrays kept in memory.
    """

    def __init__(self, folder: Path, memory_bytes: int = 0) -> None:
        self._folder = folder
        self._free_bytes = memory_bytes
        self._in_memory: dict[tuple[TileKey, str], dict[str, NDArray[Any]]] = {}
        self._lock = Lock()

    def put(self, key: TileKey, kind: str, **arrays: NDArray[Any]) -> None:
        """Keep arrays of a tile, in place of earlier ones of this kind on disk."""
        n_bytes = sum(array.nbytes for array in arrays.values())
        with self._lock:
            fits = n_bytes <= self._free_bytes
            self._free_bytes -= n_bytes if fits else 0
        if fits:
            self._in_memory[key, kind] = arrays
            return
        with atomic_file(self._path(key, kind)) as partial, partial.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]

    def get(self, key: TileKey, kind: str) -> dict[str, NDArray[Any]]:
        """Return the arrays of a tile; FileNotFoundError if there are none."""
        kept = self._in_memory.get((key, kind))
        if kept is not None:
            return kept
        with np.load(self._path(key, kind), allow_pickle=False) as arrays:
            return dict(arrays)

    def has(self, key: TileKey, kind: str) -> bool:
        """Whether there are arrays of this kind of a tile."""
        return (key, kind) in self._in_memory or self._path(key, kind).exists()

    def _path(self, key: TileKey, kind: str) -> Path:
        return self._folder / f"{key[0]}_{key[1]}.{kind}.npz"
