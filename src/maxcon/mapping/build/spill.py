# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Points on their way into tiles: more than memory is given for go to one file per tile, for other processes all."""

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import voxel_indices
from maxcon.map import TILE_VOXELS, TileKey
from maxcon.map.ground import ground_voxels
from maxcon._system.atomic import atomic_file

__all__ = ["GROUND_RECORD", "RECORD", "GroundSpill", "TileFiles", "TileSpill"]

RECORD = np.dtype([("column", "<i2", 2), ("layer", "<i4"), ("inside", "<f4", 3), ("side", "<f4", 3)])
"""One point: its voxel, its place in the voxel (m), and the direction to the sensor, its normal, or zeros."""

GROUND_RECORD = np.dtype([("column", "<i2", 2), ("height", "<f4")])
"""One point on the ground: its cell of the ground grid, and its height in the local frame (m)."""

BUFFER_BYTES = 128 * 2**20


class TileFiles:
    """Records of one kind in a file per tile, buffered; no file where all fit into the buffer.

    Another process that is given the same folder finds there what was put on disk.

    Parameters
    ----------
    folder : Path
        A folder for the files; the caller removes it.
    record : dtype
        Of a record.
    suffix : str
        Of the files.
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
        """Tiles that got points, sorted."""
        return sorted(self._keys)

    @property
    def n_tiles(self) -> int:
        """How many tiles have got points so far."""
        return len(self._keys)

    def _put(self, keys: NDArray[np.int32], records: NDArray[np.void]) -> None:
        """Take records, and the (x, y) of the tile of each."""
        keys = keys.copy()
        corner = keys.min(axis=0)
        keys -= corner
        width = int(keys[:, 0].max()) + 1
        slots = keys[:, 1].astype(np.int64) * width + keys[:, 0]
        order = np.argsort(slots, kind="stable")
        starts = np.flatnonzero(np.diff(slots[order], prepend=-1))
        for group in np.split(order, starts[1:]):
            x, y = keys[group[0]] + corner
            self._buffers[(int(x), int(y))].append(records[group])
        self._keys.update(self._buffers)
        self._buffered_bytes += records.nbytes
        if self._buffered_bytes > BUFFER_BYTES:
            self._flush()

    def complete(self, *, to_disk: bool = False) -> None:
        """Say that all points have come: what is buffered goes to disk, unless all of them are.

        Parameters
        ----------
        to_disk : bool
            Whether it does in any case: other processes will look for it.
        """
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
        """Yield the points of a tile, at most `n_at_once` together.

        Raises
        ------
        FileNotFoundError
            If there are none, or no longer.
        """
        if key in self._buffers:
            whole = np.concatenate(self._buffers[key])
            yield from (whole[start : start + n_at_once] for start in range(0, len(whole), n_at_once))
            return
        with self._path(key).open("rb") as file:
            while part := file.read(n_at_once * self._record.itemsize):
                yield np.frombuffer(part, self._record)

    def has(self, key: TileKey) -> bool:
        """Whether there are points of a tile, in memory here or on disk."""
        return key in self._buffers or self._path(key).exists()

    def replace(self, key: TileKey, records: NDArray[np.void]) -> None:
        """Keep other records of a tile instead of its own; on disk, in a step."""
        if key in self._buffers:
            self._buffers[key] = [records]
            return
        with atomic_file(self._path(key)) as partial:
            partial.write_bytes(records.tobytes())

    def remove(self, key: TileKey) -> None:
        """Delete the points of a tile that is made, if there are any."""
        if self._buffers.pop(key, None) is None:
            self._path(key).unlink(missing_ok=True)

    def _path(self, key: TileKey) -> Path:
        return self._folder / f"{key[0]}_{key[1]}.{self._suffix}"


class TileSpill(TileFiles):
    """Sorts points into tiles and keeps them on disk until each tile is made.

    Parameters
    ----------
    folder : Path
        An empty folder for the files; the caller removes it.
    cell : float
        Voxel edge, m.
    """

    def __init__(self, folder: Path, cell: float) -> None:
        super().__init__(folder, RECORD, "points")
        self._cell = cell

    def add(self, points: NDArray[np.float64], sides: NDArray[np.float32]) -> None:
        """Take points, shape (n, 3), local frame, m, and their sides, shape (n, 3)."""
        if not len(points):
            return
        indices = voxel_indices(points, self._cell)
        records = np.empty(len(points), RECORD)
        keys = indices[:, :2] // TILE_VOXELS
        records["column"] = indices[:, :2] - keys * TILE_VOXELS
        records["layer"] = indices[:, 2]
        records["inside"] = points - indices * self._cell
        records["side"] = sides
        self._put(keys, records)


class GroundSpill(TileFiles):
    """Sorts points on the ground into tiles, and keeps of each its cell and its height on disk.

    Parameters
    ----------
    folder : Path
        A folder for the files; the caller removes it.
    cell : float
        Voxel edge, m.
    """

    def __init__(self, folder: Path, cell: float) -> None:
        super().__init__(folder, GROUND_RECORD, "ground")
        self._cell = cell

    def add(self, points: NDArray[np.float64]) -> None:
        """Take points on the ground, shape (n, 3), local frame, m."""
        if not len(points):
            return
        columns = voxel_indices(points, self._cell)[:, :2]
        keys = columns // TILE_VOXELS
        records = np.empty(len(points), GROUND_RECORD)
        records["column"] = (columns - keys * TILE_VOXELS) // ground_voxels(self._cell)
        records["height"] = points[:, 2]
        self._put(keys, records)
