# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A map at another place and turned: the surfaces in its voxels are a source of points for a new one."""

import os
from collections.abc import Generator
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon._system import Progress
from maxcon._system.atomic import atomic_folder, check_replaceable, lift
from maxcon.errors import MapError
from maxcon.geometry import LocalFrame
from maxcon.io.clouds import Bounds, CloudChunk, CloudHeader, CloudReader
from maxcon.map.ground import ground_voxels
from maxcon.map.layout import NOT_SEARCHED
from maxcon.map.manifest import MAP_NAMES, Manifest, read_manifest, write_manifest
from maxcon.map.point_map import stored_ground, stored_tiles
from maxcon.map.storage import open_storage
from maxcon.map.tile import VoxelTile
from maxcon.mapping.build import MapOptions, build_map
from maxcon.mapping.build.options import GROUND, UNCLASSIFIED
from maxcon.mapping.georeference import Georeference

STEPS = 3  # points along an axis of the surface in a voxel, 2 cm apart at 6 cm: turned voxels have no holes


class MovedMap(CloudReader):
    """The surfaces of a map, moved, as a cloud with normals, ground as its own class; what is gone is left out."""

    def __init__(self, path: str | os.PathLike[str], moved: Georeference) -> None:
        super().__init__()
        storage = open_storage(path)
        self.manifest, self._moved = read_manifest(storage), moved
        self._frame = LocalFrame(self.manifest.origin)
        self._tiles = stored_tiles(storage, self.manifest, cache_bytes=0, left_out=NOT_SEARCHED)
        self._ground = stored_ground(storage, self.manifest)
        self.header = CloudHeader(
            Path(path), STEPS**2 * self.manifest.n_voxels, has_normals=True, has_classes=True, has_asprs_classes=True
        )

    def _read(self, max_points: int, bounds: Bounds | None) -> Generator[CloudChunk]:
        for key in sorted(self._tiles.keys):
            tile, n_most = self._tiles.load(key), max(1, max_points // STEPS**2)
            for first in range(0, len(tile), n_most):
                some = tile.rows(np.arange(first, min(first + n_most, len(tile))))
                yield self._chunk(*surface_points(some, self.manifest.cell), min(UNCLASSIFIED))
        edge = ground_voxels(self.manifest.cell) * self.manifest.cell
        for key in sorted(self._ground.keys):
            heights = self._ground.load(key)
            points = np.concatenate([heights.points(edge, at) for at in product((0.25, 0.75), repeat=2)])
            yield self._chunk(points, np.zeros((len(points), 3)), min(GROUND))

    def _chunk(self, points: NDArray[np.float64], normals: NDArray[np.float64], number: int) -> CloudChunk:
        places = self._moved.apply(self._frame.to_global(points))
        return CloudChunk(places, normals @ self._moved.rotation.T, np.full(len(points), number, np.uint8))


def surface_points(tile: VoxelTile, cell: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points on the plane in each voxel, its mean alone without a normal, and their normals, both (n, 3), m."""
    means, normals = tile.mean_points(cell), tile.normals.astype(np.float64)
    corners = tile.voxels * cell
    steepest = np.argmax(np.abs(normals), axis=1)
    rows, flat = np.arange(len(means)), np.array([[1, 2], [0, 2], [0, 1]])[steepest]
    is_plane = normals.any(axis=1)
    points, of_points = [means[~is_plane]], [normals[~is_plane]]
    for one, other in product((np.arange(STEPS) + 0.5) / STEPS * cell, repeat=2):
        places = means.copy()
        for axis, step in zip(flat.T, (one, other), strict=True):
            places[rows, axis] = corners[rows, axis] + step
        off = ((places - means) * normals).sum(axis=1)
        down = np.divide(off, normals[rows, steepest], out=np.zeros_like(off), where=is_plane)
        places[rows, steepest] -= down
        is_inside = is_plane & (np.abs(places - corners - 0.5 * cell) <= 0.5 * cell).all(axis=1)
        points.append(places[is_inside])
        of_points.append(normals[is_inside])
    return np.concatenate(points), np.concatenate(of_points)


def move_map(
    path: str | os.PathLike[str], moved: Georeference, crs: str, out: str | os.PathLike[str], *,
    overwrite: bool = False, progress: Progress | None = None,
) -> Manifest:  # fmt: skip
    """Write a map where a georeference puts it, in a CRS; its sigma is that of the map and of the georeference."""
    if Path(path).resolve() == Path(out).resolve():
        raise MapError(f"Expected another folder than the map itself, got {out}. Name another.")
    source = MovedMap(path, moved)
    before = source.manifest
    sigma = round(float(np.hypot(before.sigma, moved.sigma)), 4)
    options = MapOptions(cell=before.cell, normals_have_sides=before.is_signed, crs=crs, sigma=sigma)
    if overwrite:
        check_replaceable(out, "a map", MAP_NAMES)
    with atomic_folder(out, overwrite=overwrite) as folder:
        build_map([source], folder / "map", options, progress=progress)
        made = read_manifest(folder / "map")
        parent = {"name": Path(path).name, "sha256": before.sha256}
        kept = {name: before.build[name] for name in ("ground", "spacing") if name in before.build}
        placed = {"sigma": {"from": "georeference"}, "georeference": {**moved.describe(), "parent": parent}}
        build = {**made.build, **kept, **placed}
        write_manifest(folder / "map", replace(made, build=build))
        lift(folder / "map")
    return read_manifest(out)
