"""Evidence: hits and misses of the voxels of a map, and of candidates for new ones, by the rays of all drives.

A ray hits a voxel if it ended in it or in one of the 26 around: noise moves an end by less than that, mostly.
A pulse without a return is no ray: from glass, water and the sky nothing follows.

A ray misses a voxel if it crossed the surface in it and ended clearly behind. The surface is the plane through the
mean of the voxel's points, along their normal. The ray must cross this plane inside of the voxel, not at a flat angle,
and both the sensor and the end must lie farther from the plane than noise explains, on either side. So a road seen at a
flat angle is not carved: its rays end on the very plane that they pass through. A voxel without a normal is crossed if
the ray passes its mean within half an edge, and ends twice as far behind.

The scans are read twice. First, points where the map has nothing are sorted into tiles; voxels that hold enough of
them are candidates. Then every ray is walked through the voxels of map and candidates alike. Only the tiles in reach of
a few observations are in memory at a time: an update of a whole city takes no more memory than one of a street.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon._system import Progress
from maxcon.geometry import Pose
from maxcon.map import PointMap, TileKey, VoxelTile
from maxcon.map.layout import SurfaceClass
from maxcon.map.voxel_table import VoxelTable, voxel_table
from maxcon.map.voxelize import tile_of_voxels
from maxcon.mapping.build import tile_points
from maxcon.mapping.build.tiles import voxel_tile
from maxcon.mapping.update.observations import LocalizedDrive, Observation, UpdateOptions

CANDIDATE = 255  # in place of a class: a voxel that the map does not have, and drives have hit
MOST_VOXELS = 6_000_000  # in memory at a time, some 70 bytes each, unless a single observation reaches more
NEAR_VOXELS = 2  # so near one of the map, along each axis, a point may be of its surface: 12 cm at 6 cm
GROUND_CLEARANCE = 0.25  # m above the ground: what lies lower is ground, whether the map has it or left it out
GROUND_FILL = 5.0  # m; where objects hid the ground, its height is that of the nearest known ground, up to so far away
# Range behind a new surface, m, in which the extension of the ray must meet a surface that the map has.
BEHIND = (0.5, 15.0)
VOXEL_ARRAYS = ("columns", "layers", "counts", "normals", "means", "classes")

# Evidence of observations for each voxel: `log_odds` (n,) float32, logarithm of the odds that there is a surface;
# `n_hits`, `n_misses` (n,) int32, observations that hit and missed it; `hit_in` (n, 2) int32, the first and the last
# observation that hit it, -1 for none.
Evidence = dict[str, NDArray[Any]]
EVIDENCE = ("log_odds", "n_hits", "n_misses", "hit_in")


def is_hit(end: NDArray[np.float64], voxels: NDArray[np.integer], cell: float) -> NDArray[np.bool_]:
    """Whether a ray that ended at `end`, shape (3,), m, hit each of the voxels, indices of shape (n, 3)."""
    there = np.floor(end / cell).astype(np.int64)
    return np.asarray((np.abs(voxels - there) <= 1).all(axis=1))


def is_miss(
    origin: NDArray[np.float64], end: NDArray[np.float64], voxels: NDArray[np.integer], means: NDArray[np.float64],
    normals: NDArray[np.float64], cell: float, margin: float, least_cosine: float, reach: float,
) -> NDArray[np.bool_]:  # fmt: skip
    """Whether a ray missed each of the voxels: it saw through the surface there.

    `origin`, `end` (3,): where the sensor was and where the ray ended, local frame, m; `voxels` (n, 3): indices;
    `means`, `normals` (n, 3): of the points of each, local frame, m; unit normal, or zeros; `cell`: voxel edge, m;
    `margin`: how far behind a surface the end must lie, m; `least_cosine`: of the angle between ray and normal;
    `reach`: voxels farther along the ray are not judged, m.
    """
    length = float(np.sqrt(((end - origin) ** 2).sum()))
    if length == 0.0:
        return np.zeros(len(voxels), bool)
    along = (end - origin) / length
    cosines = normals @ along
    has_normal = normals.any(axis=1)
    is_steep = np.abs(cosines) >= least_cosine
    to_mean = means - origin
    to_plane = np.divide((to_mean * normals).sum(axis=1), cosines, out=np.full(len(voxels), np.inf), where=is_steep)
    at = np.where(has_normal, to_plane, to_mean @ along)  # m along the ray
    is_ahead = (at > 0.0) & (at < min(length, reach))
    at = np.where(is_ahead, at, 0.0)
    crossing = origin + at[:, None] * along
    is_inside = (np.floor(crossing / cell).astype(np.int64) == voxels).all(axis=1)
    steepness = np.where(has_normal, np.abs(cosines), 0.5)
    is_clear = (at * steepness >= margin) & ((length - at) * steepness >= margin)
    is_close = has_normal | (((crossing - means) ** 2).sum(axis=1) <= (0.5 * cell) ** 2)
    return np.asarray(is_ahead & is_inside & is_clear & is_close & (is_steep | ~has_normal))


class Surfaces(NamedTuple):
    """Voxels of one tile, and their evidence; `tile.classes` has `CANDIDATE` where the map has none."""

    tile: VoxelTile
    evidence: Evidence


def initial_evidence(classes: NDArray[np.uint8], options: UpdateOptions) -> Evidence:
    """Evidence of voxels before the first observation: log-odds by their classes (or `CANDIDATE`)."""
    start, n = np.zeros(256, np.float32), len(classes)
    start[[SurfaceClass.KNOWN, SurfaceClass.NEW]] = options.start
    start[SurfaceClass.GONE] = -options.start
    n_hits, n_misses, hit_in = np.zeros(n, np.int32), np.zeros(n, np.int32), np.full((n, 2), -1, np.int32)
    return {"log_odds": start[classes], "n_hits": n_hits, "n_misses": n_misses, "hit_in": hit_in}


class SurfaceFiles:
    """The tiles that an update judges, on disk until they are asked for."""

    def __init__(self, folder: Path) -> None:
        self.arrays = tile_points.TileArrays(folder)
        self.n_voxels: dict[TileKey, int] = {}

    def add(self, tile: VoxelTile, options: UpdateOptions) -> None:
        """Take a tile in, with the evidence before the first observation."""
        self.n_voxels[tile.key] = len(tile)
        self.arrays.put(tile.key, "voxels", **{name: getattr(tile, name) for name in VOXEL_ARRAYS})
        self.save(tile.key, initial_evidence(tile.surface_classes, options))

    def save(self, key: TileKey, evidence: Evidence) -> None:
        """Write the evidence of a tile."""
        self.arrays.put(key, "evidence", **evidence)

    def load(self, key: TileKey) -> Surfaces:
        """Read a tile."""
        voxels: dict[str, Any] = self.arrays.get(key, "voxels")
        return Surfaces(VoxelTile(key, **voxels), self.arrays.get(key, "evidence"))


def stacked(surfaces: Sequence[Surfaces]) -> tuple[VoxelTable, Evidence]:
    """Several tiles in one table, as `ray_kernels` take them, and their evidence, tile after tile."""
    evidence = {name: np.concatenate([each.evidence[name] for each in surfaces]) for name in EVIDENCE}
    return voxel_table([each.tile for each in surfaces]), evidence


def gather_evidence(
    point_map: PointMap, drives: Sequence[LocalizedDrive], observations: Sequence[Observation], options: UpdateOptions,
    folder: Path, report: Progress,
) -> SurfaceFiles:  # fmt: skip
    """Return all tiles that any observation reaches, with candidates and evidence, on disk."""
    from maxcon.mapping.update.ray_kernels import add_observation

    buckets = tile_points.TileBuckets(folder, tile_points.POINT, "points")
    for done, each in enumerate(observations, 1):
        _sort_unknown_points(each.ends(drives, options), each.pose, point_map, options, buckets)
        report("finding new surfaces", done, len(observations))
    buckets.complete()
    files = SurfaceFiles(folder)
    known, found = point_map.tile_keys, frozenset(buckets.keys)
    in_reach = set[TileKey]().union(*(_keys_around(each, point_map, options) for each in observations))
    for key in sorted(in_reach & (known | found)):
        parts = [point_map.tile(key)] if key in known else []
        classes = [part.surface_classes for part in parts]
        if key in found:
            parts.append(_candidates_of_tile(buckets, key, point_map.cell, options, is_signed=point_map.is_signed))
            classes.append(np.full(len(parts[-1]), CANDIDATE, np.uint8))
            buckets.remove(key)
        arrays = [np.concatenate([getattr(part, name) for part in parts]) for name in VOXEL_ARRAYS[:-1]]
        arrays.append(np.concatenate(classes))
        if len(arrays[0]):
            files.add(tile_of_voxels(key, *arrays), options)
    first = 0
    weights = options.hit, options.miss, options.lowest, options.highest
    for part, keys in _stretches(observations, files, lambda each: _keys_around(each, point_map, options)):
        if keys:
            surfaces = [files.load(key) for key in keys]
            table, evidence = stacked(surfaces)
            of_voxels = (*evidence.values(), np.full(len(evidence["log_odds"]), -1, np.int32))
            for number, each in enumerate(part, first):
                origin, ends = each.pose.position, each.ends(drives, options)
                distances = np.linalg.norm(ends - origin, axis=1)
                margins = options.margins(each.sigma_position, each.sigma_angle, point_map.sigma, distances)
                add_observation(
                    origin, ends, number, point_map.cell, margins, options.least_cosine, options.reach, weights,
                    table, of_voxels,
                )  # fmt: skip
                report("weighing observations", number + 1, len(observations))
            borders = np.cumsum([len(each.tile) for each in surfaces])[:-1]
            of_tiles = {name: np.split(values, borders) for name, values in evidence.items()}
            for number, key in enumerate(keys):
                files.save(key, {name: values[number] for name, values in of_tiles.items()})
        first += len(part)
    return files


def _keys_around(observation: Observation, point_map: PointMap, options: UpdateOptions) -> set[TileKey]:
    """Keys of the tiles in reach of an observation, whether the map has them or not."""
    edge, place = point_map.tile_voxels * point_map.cell, observation.pose.position[:2]
    low, high = (np.floor((place + side * options.reach) / edge).astype(int).tolist() for side in (-1, 1))
    return set(product(range(low[0], high[0] + 1), range(low[1], high[1] + 1)))


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


def _sort_unknown_points(
    ends: NDArray[np.float64], pose: Pose, point_map: PointMap, options: UpdateOptions, buckets: tile_points.TileBuckets
) -> None:
    """Keep the ends of rays near no surface of the map, above the ground, and in front of a known surface."""
    # Only behind a new object does the map go on: surroundings that it does not cover have nothing behind them.
    from maxcon.mapping.update.ray_kernels import are_far_from_voxels, hide_known_surfaces

    to_sensor = pose.position - ends
    distances = np.linalg.norm(to_sensor, axis=1)
    is_in_reach = (distances <= options.reach) & (distances > 0.0)
    ends, to_sensor, distances = ends[is_in_reach], to_sensor[is_in_reach], distances[is_in_reach]
    table = point_map.table_of(point_map.keys_within(pose.x, pose.y, options.reach + BEHIND[1]))
    is_far = np.empty(len(ends), bool)
    are_far_from_voxels(ends, NEAR_VOXELS, point_map.cell, table, is_far)
    rows = np.flatnonzero(is_far)
    patch = point_map.ground_around(pose.x, pose.y, options.reach + BEHIND[1])
    heights, away = patch.filled()
    known = np.where(away <= GROUND_FILL, heights, np.nan)
    above = ends[rows, 2] - known[:, *patch.cells_at(ends[rows, 0], ends[rows, 1])]  # comparisons with NaN are false
    is_on_ground = (np.abs(above) <= GROUND_CLEARANCE).any(axis=0) | (above[0] < 0.0)  # or below
    rows = rows[~is_on_ground]
    is_hiding = np.empty(len(rows), bool)
    hide_known_surfaces(
        pose.position, ends[rows], *BEHIND, point_map.cell, table, patch.heights, np.array(patch.first), patch.edge,
        is_hiding,
    )  # fmt: skip
    rows = rows[is_hiding]
    directions = (to_sensor[rows] / distances[rows, None]).astype(np.float32)
    buckets.add(*tile_points.point_records(ends[rows], directions, point_map.cell))


def _candidates_of_tile(
    buckets: tile_points.TileBuckets, key: TileKey, cell: float, options: UpdateOptions, *, is_signed: bool
) -> VoxelTile:
    """Return the voxels of a tile that have at least `least_looks` unknown points in and around them."""
    moments = tile_points.VoxelMoments.from_records(buckets.records(key))
    (n_around,) = tile_points.sums_around(moments.indices, moments.counts[:, None], 1).T
    moments = moments.select(n_around >= options.least_looks)
    normals = tile_points.plane_normals(moments, cell, np.ones(len(moments), bool), is_signed=is_signed)
    return voxel_tile(key, moments, normals.astype(np.float32), cell)
