# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Surfaces: the voxels of one tile that an update judges, those of the map and candidates, with their evidence."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.map import TileKey, VoxelTile
from maxcon.map.layout import SurfaceClass
from maxcon.map.tile import VoxelLookup
from maxcon.mapping.update.update_options import UpdateOptions

__all__ = ["CANDIDATE", "Evidence", "SurfaceFiles", "Surfaces", "SurfacesInReach", "classes_of"]

CANDIDATE = 255
"""In place of a class: a voxel that the map does not have, and drives have met."""
_NAMES = ("log_odds", "n_met", "n_through", "met_in")


@dataclass(frozen=True, slots=True)
class Evidence:
    """The evidence of looks for each voxel.

    Parameters
    ----------
    log_odds : array, shape (n,), float32
        Logarithm of the odds that there is a surface.
    n_met, n_through : array, shape (n,), int32
        Looks that met it, and that saw through it.
    met_in : array, shape (n, 2), int32
        The first and the last look that met it; -1 for none.
    """

    log_odds: NDArray[np.float32]
    n_met: NDArray[np.int32]
    n_through: NDArray[np.int32]
    met_in: NDArray[np.int32]

    @classmethod
    def before_any_look(cls, classes: NDArray[np.uint8], options: UpdateOptions) -> "Evidence":
        """Evidence of voxels before the first look: log-odds by their classes (or `CANDIDATE`), no looks."""
        start = np.zeros(256, np.float32)
        start[[SurfaceClass.KNOWN, SurfaceClass.NEW]] = options.start
        start[SurfaceClass.GONE] = -options.start
        n = len(classes)
        return cls(start[classes], np.zeros(n, np.int32), np.zeros(n, np.int32), np.full((n, 2), -1, np.int32))

    @classmethod
    def concatenate(cls, parts: Sequence["Evidence"]) -> "Evidence":
        """Evidence of all voxels of several tiles, in one array each."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in _NAMES))

    def part(self, rows: slice) -> "Evidence":
        """Evidence of some of the voxels."""
        return Evidence(*(getattr(self, name)[rows] for name in _NAMES))


@dataclass(frozen=True, slots=True)
class Surfaces:
    """Voxels of one tile, and their evidence; `tile.classes` has `CANDIDATE` where the map has none."""

    tile: VoxelTile
    evidence: Evidence

    @property
    def classes(self) -> NDArray[np.uint8]:
        """Class of each voxel, or `CANDIDATE`."""
        return classes_of(self.tile)


def classes_of(tile: VoxelTile) -> NDArray[np.uint8]:
    """Class of each voxel of a tile; all are known in one without."""
    return np.full(len(tile), SurfaceClass.KNOWN, np.uint8) if tile.classes is None else tile.classes


class SurfaceFiles:
    """The tiles that an update judges, on disk until they are asked for.

    Parameters
    ----------
    folder : Path
        For the files; the caller removes it.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.n_voxels: dict[TileKey, int] = {}

    def add(self, surfaces: Surfaces) -> None:
        """Take a tile in."""
        tile = surfaces.tile
        self.n_voxels[tile.key] = len(tile)
        with self._path(tile.key, "voxels").open("wb") as file:
            np.savez(
                file, columns=tile.columns, layers=tile.layers, counts=tile.counts, normals=tile.normals,
                means=tile.means, classes=surfaces.classes,
            )  # fmt: skip
        self.save(tile.key, surfaces.evidence)

    def save(self, key: TileKey, evidence: Evidence) -> None:
        """Write the evidence of a tile."""
        with self._path(key, "evidence").open("wb") as file:
            np.savez(file, **{name: getattr(evidence, name) for name in _NAMES})

    def load(self, key: TileKey) -> Surfaces:
        """Read a tile."""
        with np.load(self._path(key, "voxels"), allow_pickle=False) as arrays:
            tile = VoxelTile(
                key, arrays["columns"], arrays["layers"], arrays["counts"], arrays["normals"], arrays["means"],
                classes=arrays["classes"],
            )  # fmt: skip
        with np.load(self._path(key, "evidence"), allow_pickle=False) as arrays:
            return Surfaces(tile, Evidence(*(arrays[name] for name in _NAMES)))

    def save_verdicts(self, key: TileKey, verdicts: NDArray[np.uint8]) -> None:
        """Write the first verdict on each voxel of a tile, a constant of `upkeep.verdicts`."""
        with self._path(key, "verdicts").open("wb") as file:
            np.save(file, verdicts)

    def load_verdicts(self, key: TileKey) -> NDArray[np.uint8]:
        """Read what `save_verdicts` wrote."""
        verdicts: NDArray[np.uint8] = np.load(self._path(key, "verdicts"), allow_pickle=False)
        return verdicts

    def _path(self, key: TileKey, kind: str) -> Path:
        return self._folder / f"{key[0]}_{key[1]}.{kind}"


@dataclass(frozen=True, slots=True)
class SurfacesInReach:
    """Several tiles in one table, as the kernels take them.

    Parameters
    ----------
    tiles : tuple of VoxelTile
        The tiles.
    lookup : VoxelLookup
        Of the tiles.
    offsets : array, shape (n_tiles + 1,), int64
        Place of the first voxel of each row of the lookup in the arrays of `evidence`.
    evidence : Evidence
        Of all voxels, tile after tile.
    judged_in : array, shape (n,), int32
        The last look that said anything of a voxel.
    """

    tiles: tuple[VoxelTile, ...]
    lookup: VoxelLookup
    offsets: NDArray[np.int64]
    evidence: Evidence
    judged_in: NDArray[np.int32] = field(repr=False)

    @classmethod
    def of(cls, surfaces: Sequence[Surfaces]) -> "SurfacesInReach":
        """Table of some tiles; their evidence is copied."""
        tiles = tuple(each.tile for each in surfaces)
        evidence = Evidence.concatenate([each.evidence for each in surfaces])
        offsets = np.zeros(len(tiles) + 1, np.int64)
        offsets[2:] = np.cumsum([len(tile) for tile in tiles])[:-1]
        return cls(tiles, VoxelLookup.of(tiles), offsets, evidence, np.full(len(evidence.log_odds), -1, np.int32))

    def of_tile(self, number: int) -> Evidence:
        """Evidence of one of the tiles."""
        first = int(self.offsets[number + 1])
        return self.evidence.part(slice(first, first + len(self.tiles[number])))
