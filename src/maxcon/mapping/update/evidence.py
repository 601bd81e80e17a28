# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Evidence: hits and misses of the voxels of a map, and of candidates for new ones, by the rays of all drives.

The scans are read twice. First, points where the map has nothing are sorted into tiles; voxels that hold enough of
them are candidates. Then every ray is walked through the voxels of map and candidates alike. Only the tiles in reach of
a few observations are in memory at a time: an update of a whole city takes no more memory than one of a street.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon._system.progress import Progress
from maxcon.geometry import Pose
from maxcon.map import PointMap, TileKey, VoxelTile
from maxcon.map.ground import GroundPatch
from maxcon.map.layout import SurfaceClass
from maxcon.map.tile import VoxelLookup
from maxcon.map.voxelize import tile_of_voxels
from maxcon.mapping.build.tile_points import (
    LAYER,
    POINT,
    ROW,
    TileArrays,
    TileBuckets,
    VoxelMoments,
    plane_normals,
    point_records,
    turn_to_side,
)
from maxcon.mapping.build.tiles import voxel_tile
from maxcon.mapping.update.observations import LocalizedDrive, Observation
from maxcon.mapping.update.options import UpdateOptions

CANDIDATE = 255
"""In place of a class: a voxel that the map does not have, and drives have hit."""
MOST_VOXELS = 6_000_000
"""Voxels in memory at a time, some 70 bytes each with evidence, unless a single observation reaches more."""
NEAR_VOXELS = 2
"""A point up to so many voxels from one of the map, along each axis, may be of its surface: 12 cm at 6 cm."""
GROUND_CLEARANCE = 0.25
"""Above the ground, m: what lies lower is ground, whether the map has it or left it out."""
GROUND_FILL = 5.0
"""Where objects hid the ground, its height is that of the nearest known ground, up to so far away, m."""
BEHIND = (0.5, 15.0)
"""Range behind a new surface, m, in which the extension of the ray must meet a surface that the map has."""
VOXEL_ARRAYS = ("columns", "layers", "counts", "normals", "means", "classes")


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """The evidence of observations for each voxel."""

    log_odds: NDArray[np.float32]  # (n,): Logarithm of the odds that there is a surface
    # (n,): Observations that hit it, and that missed it
    n_hits: NDArray[np.int32]
    n_misses: NDArray[np.int32]
    hit_in: NDArray[np.int32]  # (n, 2): The first and the last observation that hit it; -1 for none

    @classmethod
    def initial(cls, classes: NDArray[np.uint8], options: UpdateOptions) -> "Evidence":
        """Evidence of voxels before the first observation: log-odds by their classes (or `CANDIDATE`)."""
        start = np.zeros(256, np.float32)
        start[[SurfaceClass.KNOWN, SurfaceClass.NEW]] = options.start
        start[SurfaceClass.GONE] = -options.start
        n = len(classes)
        return cls(start[classes], np.zeros(n, np.int32), np.zeros(n, np.int32), np.full((n, 2), -1, np.int32))

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """All arrays by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


@dataclass(frozen=True, slots=True, eq=False)
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
    """The tiles that an update judges, on disk until they are asked for."""

    def __init__(self, folder: Path) -> None:
        self.arrays = TileArrays(folder)
        self.n_voxels: dict[TileKey, int] = {}

    def add(self, tile: VoxelTile, options: UpdateOptions) -> None:
        """Take a tile in, without evidence."""
        tile = replace(tile, classes=classes_of(tile))
        self.n_voxels[tile.key] = len(tile)
        self.arrays.put(tile.key, "voxels", **{name: getattr(tile, name) for name in VOXEL_ARRAYS})
        self.save(tile.key, Evidence.initial(classes_of(tile), options))

    def save(self, key: TileKey, evidence: Evidence) -> None:
        """Write the evidence of a tile."""
        self.arrays.put(key, "evidence", **evidence.arrays)

    def load(self, key: TileKey) -> Surfaces:
        """Read a tile."""
        voxels: dict[str, Any] = self.arrays.get(key, "voxels")
        return Surfaces(VoxelTile(key, **voxels), Evidence(**self.arrays.get(key, "evidence")))


@dataclass(frozen=True, slots=True, eq=False)
class SurfacesInReach:
    """Several tiles in one table, as the kernels take them."""

    tiles: tuple[VoxelTile, ...]  # The tiles
    lookup: VoxelLookup  # Of the tiles
    # (n_tiles + 1,): Place of the first voxel of each row of the lookup in the arrays of `evidence`
    offsets: NDArray[np.int64]
    evidence: Evidence  # Of all voxels, tile after tile
    seen_in: NDArray[np.int32]  # (n,): The last observation that hit or missed a voxel

    @classmethod
    def of(cls, surfaces: Sequence[Surfaces]) -> "SurfacesInReach":
        """Table of some tiles; their evidence is copied."""
        tiles, arrays = tuple(each.tile for each in surfaces), [each.evidence.arrays for each in surfaces]
        evidence = Evidence(**{name: np.concatenate([each[name] for each in arrays]) for name in arrays[0]})
        offsets = np.zeros(len(tiles) + 1, np.int64)
        offsets[2:] = np.cumsum([len(tile) for tile in tiles])[:-1]
        return cls(tiles, VoxelLookup.of(tiles), offsets, evidence, np.full(len(evidence.log_odds), -1, np.int32))

    @property
    def table(self) -> tuple[NDArray[np.uint64], NDArray[np.int32], NDArray[np.int64], NDArray[np.int64]]:
        """The lookup and the offsets, as the kernels take them."""
        return self.lookup.rows, self.lookup.grid, np.array(self.lookup.corner), self.offsets

    def of_tile(self, number: int) -> Evidence:
        """Evidence of one of the tiles."""
        first = int(self.offsets[number + 1])
        rows = slice(first, first + len(self.tiles[number]))
        return Evidence(**{name: values[rows] for name, values in self.evidence.arrays.items()})


def gather_evidence(
    point_map: PointMap,
    drives: Sequence[LocalizedDrive],
    observations: Sequence[Observation],
    options: UpdateOptions,
    folder: Path,
    report: Progress,
) -> SurfaceFiles:
    """Return all tiles that any observation reaches, with candidates and evidence, on disk.

    FileError or MapError if a scan or a tile cannot be read.
    """
    buckets = TileBuckets(folder, POINT, "points")
    for done, each in enumerate(observations, 1):
        _sort_unknown_points(each.ends(drives, options), each.pose, point_map, options, buckets)
        report("finding new surfaces", done, len(observations))
    buckets.complete()
    files = SurfaceFiles(folder)
    known, found = point_map.tile_keys, frozenset(buckets.keys)
    in_reach = set[TileKey]().union(*(_keys_around(each, point_map, options) for each in observations))
    for key in sorted(in_reach & (known | found)):
        parts = [point_map.tile(key)] if key in known else []
        if key in found:
            candidates = _candidates_of_tile(buckets, key, point_map.cell, options, is_signed=point_map.is_signed)
            parts.append(replace(candidates, classes=np.full(len(candidates), CANDIDATE, np.uint8)))
            buckets.remove(key)
        tile = _together(parts)
        if len(tile):
            files.add(tile, options)
    first = 0
    for part, keys in _stretches(observations, files, lambda each: _keys_around(each, point_map, options)):
        if keys:
            within = SurfacesInReach.of([files.load(key) for key in keys])
            for number, each in enumerate(part, first):
                _add(number, each, each.ends(drives, options), within, point_map, options)
                report("weighing observations", number + 1, len(observations))
            for number, key in enumerate(keys):
                files.save(key, within.of_tile(number))
        first += len(part)
    return files


def _add(
    number: int,
    observation: Observation,
    ends: NDArray[np.float64],
    within: SurfacesInReach,
    point_map: PointMap,
    options: UpdateOptions,
) -> None:
    """Add an observation to the evidence of the voxels in reach."""
    from maxcon.mapping.update.ray_kernels import add_observation

    origin, evidence = observation.pose.position, within.evidence
    distances = np.linalg.norm(ends - origin, axis=1)
    margins = options.margins(observation.sigma_position, observation.sigma_angle, point_map.sigma, distances)
    weights = options.hit, options.miss, options.lowest, options.highest
    add_observation(
        origin, ends, number, point_map.cell, margins, options.least_cosine, options.reach, weights, *within.table,
        evidence.log_odds, evidence.n_hits, evidence.n_misses, evidence.hit_in, within.seen_in,
    )  # fmt: skip


def _keys_around(observation: Observation, point_map: PointMap, options: UpdateOptions) -> set[TileKey]:
    """Keys of the tiles in reach of an observation, whether the map has them or not."""
    edge, place = point_map.tile_voxels * point_map.cell, observation.pose.position[:2]
    low = np.floor((place - options.reach) / edge).astype(int)
    high = np.floor((place + options.reach) / edge).astype(int)
    return {(x, y) for x in range(low[0], high[0] + 1) for y in range(low[1], high[1] + 1)}


def _stretches(
    observations: Sequence[Observation], files: SurfaceFiles, keys_around: Callable[[Observation], set[TileKey]]
) -> Iterator[tuple[list[Observation], list[TileKey]]]:
    """Cut observations into parts whose tiles fit into memory together; yield each with the keys of its tiles."""
    part, keys = list[Observation](), set[TileKey]()
    for each in observations:
        own = keys_around(each) & files.n_voxels.keys()
        if part and sum(files.n_voxels[key] for key in keys | own) > MOST_VOXELS:
            yield part, sorted(keys)
            part, keys = [], set()
        part.append(each)
        keys |= own
    if part:
        yield part, sorted(keys)


def _together(parts: Sequence[VoxelTile]) -> VoxelTile:
    """Return the voxels of the same tile of the map and of candidates in one."""
    columns, layers, counts, normals, means = (
        np.concatenate([getattr(part, name) for part in parts]) for name in VOXEL_ARRAYS[:-1]
    )
    classes = np.concatenate([classes_of(part) for part in parts])
    return tile_of_voxels(parts[0].key, columns, layers, counts, normals, means, classes)


def _sort_unknown_points(
    ends: NDArray[np.float64], pose: Pose, point_map: PointMap, options: UpdateOptions, buckets: TileBuckets
) -> None:
    """Keep the ends of rays that lie near no surface of the map, above the ground, and in front of a known surface.

    The last condition tells a new object from surroundings that the map does not cover, such as the end of a side
    street or a house seen through a gap: only behind the new object does the map go on.

    `ends` (n, 3): local frame, m; `pose`: where the sensor was, local frame; `buckets`: takes the points with the
    directions to the sensor (`POINT`).
    """
    from maxcon.mapping.update.ray_kernels import are_far_from_voxels, hide_known_surfaces

    to_sensor = pose.position - ends
    distances = np.linalg.norm(to_sensor, axis=1)
    is_in_reach = (distances <= options.reach) & (distances > 0.0)
    ends, to_sensor, distances = ends[is_in_reach], to_sensor[is_in_reach], distances[is_in_reach]
    lookup = VoxelLookup.of(point_map.tiles_within(pose.x, pose.y, options.reach + BEHIND[1]))
    table = lookup.rows, lookup.grid, np.array(lookup.corner)
    is_far = np.empty(len(ends), bool)
    are_far_from_voxels(ends, NEAR_VOXELS, point_map.cell, *table, is_far)
    rows = np.flatnonzero(is_far)
    patch = point_map.ground_around(pose.x, pose.y, options.reach + BEHIND[1])
    rows = rows[~_are_on_ground(ends[rows], patch)]
    is_hiding = np.empty(len(rows), bool)
    hide_known_surfaces(
        pose.position, ends[rows], *BEHIND, point_map.cell, *table, patch.heights, np.array(patch.first), patch.edge,
        is_hiding,
    )  # fmt: skip
    rows = rows[is_hiding]
    directions = (to_sensor[rows] / distances[rows, None]).astype(np.float32)
    buckets.add(*point_records(ends[rows], directions, point_map.cell))


def _are_on_ground(points: NDArray[np.float64], patch: GroundPatch) -> NDArray[np.bool_]:
    """Whether each point lies on the ground, or below; none does where the map does not know the ground."""
    from scipy.ndimage import distance_transform_edt

    is_known = np.isfinite(patch.heights).any(axis=0)
    if not (is_known.any() and len(points)):
        return np.zeros(len(points), bool)
    far, (rows, columns) = distance_transform_edt(~is_known, return_indices=True)
    filled = patch.heights[:, rows, columns]
    filled[:, far * patch.edge > GROUND_FILL] = np.nan
    cells = np.floor(points[:, :2] / patch.edge).astype(np.int64) - patch.first
    # Height above each level of the ground; comparisons with NaN are false.
    above = points[:, 2] - filled[:, cells[:, 1], cells[:, 0]]
    is_near = (np.abs(above) <= GROUND_CLEARANCE).any(axis=0)
    return np.asarray(is_near | (above[0] < 0.0))


def _candidates_of_tile(
    buckets: TileBuckets, key: TileKey, cell: float, options: UpdateOptions, *, is_signed: bool
) -> VoxelTile:
    """Return the voxels of a tile that have at least `least_looks` unknown points in and around them."""
    from maxcon.mapping.kernels import sums_near

    moments = VoxelMoments.from_records(buckets.records(key))
    n_around = np.zeros((len(moments), 1))
    sums_near(moments.keys, moments.counts[:, None], ROW, LAYER, 1, n_around)
    moments = moments.select(n_around[:, 0] >= options.least_looks)
    fitted = plane_normals(moments, cell, np.ones(len(moments), bool))
    normals = turn_to_side(fitted, moments.sides) if is_signed else fitted
    return voxel_tile(key, moments, normals.astype(np.float32), cell)
