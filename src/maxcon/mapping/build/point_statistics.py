"""What points tell of a map: the voxel edge that suits them, and how far passes of the mapping vehicle differ."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from maxcon._system.checked import checked, read_json
from maxcon.map.layout import TILE_VOXELS, UNKNOWN_SIGMA, TileKey
from maxcon.mapping.build.options import LEAST_CELL
from maxcon.mapping.build.tile_points import TileBuckets

# Voxels of this many spacings (of those that 90 % of the points keep) have few holes; measured on the drives of
# docs/decisions/map-on-disk.md.
SPACINGS_PER_CELL = 1.2
# No larger voxels are chosen (m): where points lie farther apart surfaces cannot be told from single points.
LARGEST_CELL = 0.6

# Neighbours are looked for within squares of a tile, of the points that are MARGIN from their borders, m: a neighbour
# farther away than that counts as so far away.
SQUARE, MARGIN = 2.0, 0.5
# At most so many tiles, evenly over the map, are sampled. If squares of a tile have more than so many points, one of
# 2, 4, ... squares is taken, at most one of so many.
MOST_TILES, MOST_SAMPLED, MOST_SQUARES_APART = 64, 100_000, 64

ALIGNMENT = "alignment.json"
LARGEST_ALIGNMENT = 2**24  # bytes
LEAST_CONSTRAINTS = 50  # fewer, or one pass with itself, do not say how wrong all passes together are

PLACE_EDGE = 0.5  # m, of the cubes in which passes are compared: a piece of wall, seen in one pass by a hundred points
MOST_POINTS = 500_000  # 14 MB
# One point: the number of its place, its position from the place's middle (m), and its time (s).
PLACE_POINT = np.dtype([("place", "<u8"), ("inside", "<f4", 3), ("time", "<f8")])

# Two rounds of multiplying and folding (the finalizer of splitmix64): one-to-one, and spread evenly.
MIX = np.array([[30, 0xBF58476D1CE4E5B9], [27, 0x94D049BB133111EB]], np.uint64)

LEAST_PAUSE = 60.0  # s, between two passes at one place: a vehicle that waits at a light makes one
LEAST_POINTS = 20  # of a pass at a place
# Largest distance of a pass's plane from the middle of its place, m: farther out the cube's faces cut noise off, and
# bias the mean.
LARGEST_OFFSET = 0.3 * PLACE_EDGE
LARGEST_ROUGHNESS = 0.03  # m, root mean square distance of a pass's points from its plane
# Root mean square extent of the points along the plane's shorter side, m; 0.29 edges where they fill it evenly.
LEAST_WIDTH = 0.16 * PLACE_EDGE
OUTLIER = 3.0  # robust standard deviations; beyond it something has changed: a door, a parked car, leaves
NORMAL_MEDIAN = 0.6745  # median of the absolute value of a standard normal deviate
STRETCH = 30.0  # s; errors of a trajectory within such a stretch are much the same
LEAST_STRETCHES = 4
LEAST_PLACES = 50


@dataclass(frozen=True, slots=True)
class PointSpacing:
    """Distances of map points to the nearest other one."""

    median: float  # m
    at_90: float  # the distance that 90 % of the points keep, m; `MARGIN` stands for anything farther
    n_points: int  # of how many points
    is_of_scans: bool = False  # scans of a drive: between their rings points lie farther apart than these tell

    @property
    def cell(self) -> float:
        """The voxel edge that suits the points, m: whole multiples of `LEAST_CELL`, rounded down; of scans rounded."""
        n_steps = round(SPACINGS_PER_CELL * self.at_90 / LEAST_CELL, None if self.is_of_scans else 3)
        return min(round(max(1, int(n_steps)) * LEAST_CELL, 2), LARGEST_CELL)

    def describe(self) -> dict[str, object]:
        """Return its entry in the manifest (docs/map_format.md)."""
        spacing = {"median": round(self.median, 4), "at_90": round(self.at_90, 4)}
        return {**spacing, "n_points": self.n_points, "suits_cell": self.cell}


def point_spacing(points: TileBuckets, cell: float, *, are_scans: bool = False) -> PointSpacing | None:
    """Measure the spacing of points sorted into tiles of voxels of this edge (m); None if it cannot be told."""
    keys, distances, weights = points.keys, list[NDArray[np.float64]](), list[NDArray[np.int64]]()
    for number in np.unique(np.linspace(0, len(keys) - 1, MOST_TILES).astype(int)):
        sample, every = _sample_of_tile(points, keys[number], cell)
        distances.append(nearest_distances(sample, TILE_VOXELS * cell))
        weights.append(np.full(len(distances[-1]), every))
    near, n_stood_for = np.concatenate(distances), np.concatenate(weights)
    if not len(near):
        return None
    order = np.argsort(near)
    ranks = np.cumsum(n_stood_for[order])
    median, at_90 = near[order[np.searchsorted(ranks, [0.5 * ranks[-1], 0.9 * ranks[-1]])]].tolist()
    return PointSpacing(median, at_90, len(near), are_scans)


def _sample_of_tile(points: TileBuckets, key: TileKey, cell: float) -> tuple[NDArray[np.float64], int]:
    """Return all points, shape (n, 3), m from the tile's corner, in one of so many squares, and that number."""
    every, parts = 1, list[NDArray[np.float64]]()
    for records in points.records(key):
        places = np.column_stack([records["column"], records["layer"]]) * cell + records["inside"]
        parts.append(places[_is_in_sample(places, every)])
        while sum(map(len, parts)) > MOST_SAMPLED and every < MOST_SQUARES_APART:
            every *= 2
            parts = [part[_is_in_sample(part, every)] for part in parts]
    return np.concatenate(parts), every


def _is_in_sample(points: NDArray[np.float64], every: int) -> NDArray[np.bool_]:
    """Which points, shape (n, 3), lie in the squares of the sample: one of `every`."""
    x, y = np.floor(points[:, :2].T / SQUARE).astype(np.int64)
    return np.asarray((x + 3 * y) % every == 0)


def nearest_distances(points: NDArray[np.float64], edge: float) -> NDArray[np.float64]:
    """Distance to the nearest other one, at most `MARGIN`, of each point (n, 3), m, so far inside of its square."""
    from scipy.spatial import cKDTree

    inside = points[:, :2] % SQUARE
    is_inner = (inside >= MARGIN) & (inside < SQUARE - MARGIN) & (points[:, :2] < edge // SQUARE * SQUARE)
    if not is_inner.all(axis=1).any():
        return np.empty(0)
    asked = points[is_inner.all(axis=1)]
    distances, _ = cKDTree(points).query(asked, k=2, distance_upper_bound=MARGIN)
    return np.asarray(np.minimum(distances[:, 1], MARGIN))


def map_sigma(
    given: float | None, sample: "PlaceSample", aligned: float | None = None
) -> tuple[float, dict[str, object]]:
    """Return the standard deviation of a map's position along any axis, m, and where it is from, for the manifest.

    Aligned passes differ less than they are wrong by: an estimate below that of `maxcon map align` is not believed.
    """
    if given is not None:
        return float(given), {"from": "given"}
    found = compare_passes(sample.records())
    if aligned is not None and (not found.is_enough or found.sigma_of_map <= aligned):
        return round(aligned, 4), {"from": "alignment"}
    if not found.is_enough:
        return UNKNOWN_SIGMA, {"from": "assumed", "reason": found.shortcoming}
    return round(found.sigma_of_map, 4), {
        "from": "passes", "n_passes": found.n_passes, "sigma_of_pass": round(found.sigma_of_pass, 4),
        "n_places": found.n_places,
    }  # fmt: skip


class _Sigmas(Struct):
    of_map: Annotated[float, Meta(ge=0.0, le=1e3)]


class _Alignment(Struct):
    sigma: _Sigmas
    n_ties: int
    n_passes: int


def aligned_sigma(files: Iterable[Path]) -> float | None:
    """Sigma of the map, m, that `maxcon map align` wrote beside each of these clouds; None where it did not."""
    what, advice = "what `maxcon map align` writes", "Give --sigma, or move the clouds elsewhere"
    largest = 0.0
    for file in {file.parent / ALIGNMENT for file in files}:
        if not file.exists():
            return None
        found = checked(read_json(file, what, advice, LARGEST_ALIGNMENT), _Alignment, file, what, advice)
        is_known = found.n_passes > 1 and found.n_ties >= LEAST_CONSTRAINTS
        largest = max(largest, found.sigma.of_map, 0.0 if is_known else UNKNOWN_SIGMA)
    return largest


class PlaceSample:
    """All points, with times, of an even sample of places: every other place goes while there are too many."""

    def __init__(self, most_points: int = MOST_POINTS) -> None:
        self._most_points = most_points
        self._n_halvings = 0
        self._parts: list[NDArray[np.void]] = []

    def add(self, points: NDArray[np.float64], times: NDArray[np.float64]) -> None:
        """Take points, (n, 3), local frame, m, with times, (n,), s, on a common clock; not finite ones are left out."""
        keys = place_keys(points)
        chosen = np.flatnonzero(self._is_chosen(keys) & np.isfinite(times))
        records = np.empty(len(chosen), PLACE_POINT)
        records["place"], records["time"] = keys[chosen], times[chosen]
        records["inside"] = points[chosen] % PLACE_EDGE - 0.5 * PLACE_EDGE
        self._parts.append(records)
        while sum(map(len, self._parts)) > self._most_points:
            self._n_halvings += 1
            self._parts = [part[self._is_chosen(part["place"])] for part in self._parts]

    def records(self) -> NDArray[np.void]:
        """Return the points that are kept (`PLACE_POINT`), place by place, in the order of their times."""
        records = np.concatenate([np.empty(0, PLACE_POINT), *self._parts])
        return records[np.lexsort((records["time"], records["place"]))]

    def _is_chosen(self, places: NDArray[np.uint64]) -> NDArray[np.bool_]:
        """Whether a place belongs to the sample: half of them for each halving."""
        return np.asarray((places & np.uint64((1 << self._n_halvings) - 1)) == 0)


def place_keys(points: NDArray[np.float64]) -> NDArray[np.uint64]:
    """Number the cube that each point, (n, 3), m, is in, as if by chance: those that end in many zeros are a sample."""
    x, y, z = (np.floor(points / PLACE_EDGE).astype(np.int64) & (2**21 - 1)).T.astype(np.uint64)
    keys = (x << np.uint64(42)) | (y << np.uint64(21)) | z
    for shift, factor in MIX:
        keys = (keys ^ (keys >> shift)) * factor
    return np.asarray(keys ^ (keys >> np.uint64(31)))


class PassDifferences(NamedTuple):
    """Differences between passes across planes."""

    n_passes: int  # how many left points at a plane, in the median; 0 if there is no plane with times
    n_places: int = 0  # places where two or more passes were compared
    n_stretches: int = 0  # half minutes of mapping that were compared
    sigma_of_pass: float = math.nan  # standard deviation of the position of one pass along any axis, m
    sigma_of_map: float = math.nan  # that of the mean of all points at a place, which is what the map has, m

    @property
    def is_enough(self) -> bool:
        """Whether enough was compared to believe the standard deviations."""
        return self.n_places >= LEAST_PLACES and self.n_stretches >= LEAST_STRETCHES

    @property
    def shortcoming(self) -> str:
        """Why it is not enough, in words."""
        if self.n_passes == 0:
            return "no planes of points with times"
        if self.n_places == 0:
            return "one pass only"
        return f"passes meet at {self.n_places:,} places in {self.n_stretches} half minutes only"


def compare_passes(records: NDArray[np.void]) -> PassDifferences:
    """Find how far passes differ across planes that several saw: two of sigma s by sqrt(2) s, and by noise."""
    is_new_place = np.diff(records["place"], prepend=~records["place"][:1]) != 0
    is_new_pass = is_new_place | (np.diff(records["time"], prepend=-np.inf) > LEAST_PAUSE)
    starts = np.flatnonzero(is_new_pass)
    n_points = np.diff(starts, append=len(records))
    place_of_pass = np.cumsum(is_new_place)[starts] - 1
    is_used = n_points >= LEAST_POINTS
    if not is_used.any():
        return PassDifferences(0)
    inside = records["inside"].astype(np.float64)[np.repeat(is_used, n_points)]
    offsets, noise, is_plane = _planes(inside, n_points[is_used], place_of_pass[is_used])
    if not is_plane.any():
        return PassDifferences(0)
    rows, offsets, noise = np.flatnonzero(is_used)[is_plane], offsets[is_plane], noise[is_plane]
    places, times = place_of_pass[rows], records["time"][starts[rows]]
    at_planes = np.unique(places)
    n_passes = int(np.median(np.bincount(place_of_pass)[at_planes]))
    first, second = _pairs(places)
    if not len(first):
        return PassDifferences(n_passes)
    variance = 0.5 * _variance(offsets[first] - offsets[second], noise[first] + noise[second])
    # Variance of the mean of all points of a place, over that of one pass: 1/5 if five passes left as many each.
    parts = np.bincount(place_of_pass, n_points**2.0) / np.bincount(place_of_pass, n_points) ** 2
    return PassDifferences(
        n_passes, len(np.unique(places[first])),
        len(np.unique(np.floor(times[np.concatenate([first, second])] / STRETCH))), math.sqrt(variance),
        math.sqrt(variance * float(parts[at_planes].mean())),
    )  # fmt: skip


def _planes(
    points: NDArray[np.float64], n_points: NDArray[np.int64], places: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Offset (m) from one plane per place, its variance from noise (m^2), and whether it is a plane, of each pass."""
    counts, rows = n_points.astype(np.float64), np.cumsum(n_points) - n_points
    means = np.add.reduceat(points, rows, axis=0) / counts[:, None]
    centred = points - np.repeat(means, n_points, axis=0)
    covariances = np.empty((len(counts), 3, 3))
    for one, other in product(range(3), repeat=2):
        covariances[:, one, other] = np.add.reduceat(centred[:, one] * centred[:, other], rows) / counts
    firsts = np.flatnonzero(np.diff(places, prepend=-1))
    weights = counts[:, None, None]
    pooled = np.add.reduceat(weights * covariances, firsts) / np.add.reduceat(weights, firsts)
    extents, axes = np.linalg.eigh(pooled)
    plane = np.cumsum(np.diff(places, prepend=-1) != 0) - 1
    normals = axes[plane, :, 0]
    offsets = np.einsum("vi,vi->v", normals, means)
    roughness = np.einsum("vi,vij,vj->v", normals, covariances, normals)
    is_plane = (extents[:, 1] >= LEAST_WIDTH**2)[plane]
    is_plane &= (np.abs(offsets) <= LARGEST_OFFSET) & (roughness <= LARGEST_ROUGHNESS**2)
    return offsets, roughness / counts, is_plane


def _variance(differences: NDArray[np.float64], noise: NDArray[np.float64]) -> float:
    """Variance of differences (m) less that of their noise (m^2), without those of things that changed, m^2."""
    # The larger a difference is, the less often are both passes near enough to a cube's middle: it counts the more.
    sizes, largest = np.abs(differences), 2.0 * LARGEST_OFFSET
    is_usual = sizes <= min(OUTLIER * float(np.median(sizes)) / NORMAL_MEDIAN, 0.9 * largest)
    weights = 1.0 / (largest - sizes[is_usual])
    return max(0.0, float(np.average((differences**2 - noise)[is_usual], weights=weights)))


def _pairs(places: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Numbers of all pairs of rows with one place; `places` is sorted."""
    most = int(np.unique(places, return_counts=True)[1].max())
    pairs = [np.flatnonzero(places[lag:] == places[:-lag]) for lag in range(1, most)]
    first = np.concatenate([np.empty(0, np.intp), *pairs])
    return first, np.concatenate([first[:0], *(pair + lag for lag, pair in enumerate(pairs, 1))])
