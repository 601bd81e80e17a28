# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Making one tile of a map: the moments of its voxels, then their normals, which need the tiles around."""

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.build.found_classes import NEIGHBOUR_VOXELS, ClassFinder, FoundInTile
from maxcon.mapping.build.ground import level_surfaces
from maxcon.mapping.build.spill import TileSpill
from maxcon.mapping.build.voxel_moments import HALO_VOXELS, VoxelMoments
from maxcon.mapping.build.voxel_normals import plane_normals, turn_to_side
from maxcon.map import TILE_VOXELS, TileKey, VoxelTile
from maxcon.map.store import Record, tile_record
from maxcon.map.voxelize import mean_normals, mean_steps, tile_of_voxels

__all__ = ["MadeTile", "TileMaker"]

MEMORY_BYTES = 128 * 2**20
"""Moments of voxels are kept in memory up to this size in all, the others on disk."""


@dataclass(frozen=True)
class MadeTile:
    """A tile of a map.

    Parameters
    ----------
    record : Record
        As the map keeps it.
    surfaces : array, shape (n, n), float32, optional
        Its `level_surfaces`, if they were asked for, m.
    """

    record: Record
    surfaces: NDArray[np.float32] | None = None


class TileMaker:
    """Makes tiles of sorted points. First `gather` every tile, then `make` any of them.

    Parameters
    ----------
    spill : TileSpill
        The points.
    folder : Path
        Where moments are kept in between, if they are many; the caller removes it.
    cell : float
        Voxel edge, m.
    has_normals : bool
        Whether the points' sides are their normals; otherwise planes are fitted.
    is_signed : bool
        Whether normals are turned to the points' sides.
    finder : ClassFinder, optional
        Finds classes between the two: gather every tile, `find_classes` of every tile, make any of them.
    finds_surfaces : bool
        Whether the level surfaces of tiles are asked for.
    memory_bytes : int
        Moments are kept in memory up to this size in all; with 0 every step may be done by another process.
    """

    def __init__(
        self,
        spill: TileSpill,
        folder: Path,
        cell: float,
        *,
        has_normals: bool,
        is_signed: bool,
        finder: ClassFinder | None = None,
        finds_surfaces: bool = False,
        memory_bytes: int = MEMORY_BYTES,
    ) -> None:
        self._spill = spill
        self._folder = folder
        self._cell = cell
        self._has_normals = has_normals
        self._is_signed = is_signed
        self._finder = finder
        self._finds_surfaces = finds_surfaces
        self._memory_bytes = memory_bytes
        self._in_memory: dict[TileKey, VoxelMoments] = {}
        self._on_disk: set[TileKey] = set()
        self._n_bytes = 0
        self._lock = threading.Lock()

    def gather(self, key: TileKey) -> None:
        """Sum the points of a tile into its voxels, and keep these instead; done twice, it is done once.

        Raises
        ------
        FileNotFoundError
            If the tile has no points.
        """
        try:
            moments = VoxelMoments.from_records(self._spill.records(key))
        except FileNotFoundError:
            if self._path(key).exists():  # gathered by a process that ended before it could say so
                return
            raise
        self._keep(key, moments)
        if self._finder is not None:
            self._finder.look_at(key, moments)
        self._spill.remove(key)

    def find_classes(self, key: TileKey) -> FoundInTile:
        """Find the classes of a tile; it and the tiles around it have been gathered."""
        if self._finder is None:
            raise TypeError("Expected something that finds classes, got None.")
        return self._finder.find(
            key, self.gathered(key), list(self._halo(key, NEIGHBOUR_VOXELS, self.gathered))
        )

    def make(self, key: TileKey) -> MadeTile:
        """Return a tile; it and the tiles around it have been gathered, and their classes found."""
        tile = self._made(key)
        surfaces = level_surfaces(tile, self._cell) if self._finds_surfaces else None
        return MadeTile(tile_record(tile), surfaces)

    def _made(self, key: TileKey) -> VoxelTile:
        own = self._kept(key)
        if self._has_normals:
            normals = mean_normals(own.sides, own.counts)
        else:
            halo = list(self._halo(key, HALO_VOXELS, self._kept))
            moments = VoxelMoments.concatenate([own, *halo]) if halo else own
            x, y = moments.indices[:, 0], moments.indices[:, 1]
            is_own = (x >= 0) & (x < TILE_VOXELS) & (y >= 0) & (y < TILE_VOXELS)
            fitted = plane_normals(moments, self._cell, is_own)[is_own]
            normals = (turn_to_side(fitted, own.sides) if self._is_signed else fitted).astype(np.float32)
        return tile_of_voxels(
            key,
            own.indices[:, :2].astype(np.int16),
            np.ascontiguousarray(own.indices[:, 2]),
            own.counts.astype(np.int32),
            normals,
            mean_steps(own.sums, own.counts, self._cell),
        )

    def _keep(self, key: TileKey, moments: VoxelMoments) -> None:
        """Keep the voxels of a tile, in memory as long as they are few."""
        with self._lock:
            fits = self._n_bytes + moments.n_bytes <= self._memory_bytes
            self._n_bytes += moments.n_bytes if fits else 0
        if fits:
            self._in_memory[key] = moments
        else:
            moments.save(self._path(key))
            self._on_disk.add(key)

    def _is_gathered(self, key: TileKey) -> bool:
        if self._memory_bytes:
            return key in self._in_memory or key in self._on_disk
        return self._path(key).exists()  # by whichever process

    def gathered(self, key: TileKey) -> VoxelMoments:
        """Return the voxels of a tile."""
        kept = self._in_memory.get(key)
        return kept if kept is not None else VoxelMoments.load(self._path(key))

    def _kept(self, key: TileKey) -> VoxelMoments:
        """Voxels of a gathered tile that are for the map."""
        moments = self.gathered(key)
        return moments if self._finder is None else moments.select(self._finder.is_kept(key))

    def _halo(
        self, key: TileKey, reach: int, load: Callable[[TileKey], VoxelMoments]
    ) -> Iterator[VoxelMoments]:
        """Voxels of the tiles around, at most `reach` away; x and y from this tile's corner."""
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                neighbour = (key[0] + dx, key[1] + dy)
                if (dx, dy) == (0, 0) or not self._is_gathered(neighbour):
                    continue
                moments = load(neighbour)
                x = moments.indices[:, 0] + dx * TILE_VOXELS
                y = moments.indices[:, 1] + dy * TILE_VOXELS
                is_near = (
                    (x >= -reach) & (x < TILE_VOXELS + reach) & (y >= -reach) & (y < TILE_VOXELS + reach)
                )
                if is_near.any():
                    yield moments.select(is_near, (dx * TILE_VOXELS, dy * TILE_VOXELS))

    def _path(self, key: TileKey) -> Path:
        return self._folder / f"{key[0]}_{key[1]}.npz"
