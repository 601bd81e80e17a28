"""Visits: what one pass measured of one place, and the pose of one visit relative to another, by `refine`."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.map import PointMap, TileKey
from maxcon.mapping.align.passes import Corrections, pose_of_twist, twist_matrices
from maxcon.mapping.build.tile_points import TileBuckets, VoxelMoments, plane_normals, point_records, voxel_keys
from maxcon.refine import Refined, covariance, refine
from maxcon.scan import Scan, one_per_cube
from maxcon.scan.scan import SAMPLE_EDGE

PLACE_EDGE = 24.0  # m, of the squares in which passes are matched: both sides of a street fit in
# One point: its time (s), the number of its pass, and its position from the middle of its place (m).
PLACE_POINT = np.dtype([("time", "<f8"), ("pass", "<i2"), ("inside", "<f4", 3)])
MOST_POINTS = 4_000_000  # of a place in memory, 90 MB; of more, every n-th is taken

CELL = 0.12  # m, voxel edge of the planes: partners are looked for within five of them, as far as the first gate
MARGIN = 16  # voxels between the corner of the grid and that of the place
LONGEST_GAP = 10.0  # s; a visit ends where no point of the place was measured for so long
LONGEST_VISIT = 20.0  # s; longer ones, of a vehicle that stands, are split
# Visits with fewer points, or fewer voxels with a normal, are left out.
LEAST_POINTS, LEAST_PLANES = 2000, 300

LEAST_PAUSE = 60.0  # s; visits of one pass are matched if so much lies between them: until then errors hardly change
MATCH_FLOOR = 0.001  # m, smallest sigma of a match: two visits see different points of rough walls
# Fewest points of a visit that must lie on planes of the other, and their ratio: with fewer it may be wrong.
LEAST_POINTS_ON_PLANES, LEAST_RATIO = 150, 0.3
# Noise of fitted normals, rad: through it alone points on walls along a street seem to fix a position along it.
NORMAL_NOISE = math.radians(2.0)
LEAST_OVER_NOISE = 5.0  # a direction is open if the points give less than so many times the information of such noise
# Standard deviation along such a direction, m: ten times a usual prior's. That of turns holds at this arm, m.
OPEN_SIGMA, OPEN_ARM = 1.0, 10.0
FARTHEST = 0.6  # m, largest distance of a partner in the adjustment
MOST_VISITS = 8  # all pairs of up to so many visits to a place are matched; of more, each with the next four


class Places:
    """Points of all passes sorted into squares from `origin` (global, m) on, on disk where many, 22 bytes a point."""

    def __init__(self, folder: Path, origin: NDArray[np.float64]) -> None:
        self.buckets = TileBuckets(folder, PLACE_POINT, "points")
        self._origin = origin

    def middle(self, key: TileKey) -> NDArray[np.float64]:
        """Middle of a place at the height of the origin, shape (3,), global, m."""
        return self._origin + [(key[0] + 0.5) * PLACE_EDGE, (key[1] + 0.5) * PLACE_EDGE, 0.0]

    def add(self, points: NDArray[np.float64], times: NDArray[np.float64], passes: NDArray[np.integer]) -> None:
        """Take points, shape (n, 3), global, m, with their times (s) and the numbers of their passes, (n,) each."""
        inside = points - self._origin
        keys = np.floor(inside[:, :2] / PLACE_EDGE).astype(np.int32)
        inside[:, :2] -= (keys + 0.5) * PLACE_EDGE
        records = np.empty(len(points), PLACE_POINT)
        records["time"], records["pass"], records["inside"] = times, passes, inside
        self.buckets.add(keys, records)

    def points(self, key: TileKey) -> NDArray[np.void]:
        """Points of a place (`PLACE_POINT`) in the order they came; every n-th where there are too many."""
        every = -(-sum(len(part) for part in self.buckets.records(key)) // MOST_POINTS)
        parts = self.buckets.records(key, every * (MOST_POINTS // every))  # each begins with one that is taken
        return np.concatenate([part[::every] for part in parts])


class Visit(NamedTuple):
    """What one pass measured of one place; frame: axes of the map, origin in the middle of the place."""

    pass_: int  # Number of the pass
    time: float  # Mean of the points' times, s
    # (k, 3): Means of the points of voxels, m, and unit normals of the surface there
    planes: NDArray[np.float32]
    normals: NDArray[np.float32]
    # (n, 3): Some measured points, one in 0.4 m, and normals of their voxels
    points: NDArray[np.float32]
    point_normals: NDArray[np.float32]

    @staticmethod
    def to_arrays(visits: "Sequence[Visit]") -> dict[str, NDArray[Any]]:
        """Return all arrays of some visits by name."""
        each = ((i, field) for i, visit in enumerate(visits) for field in visit._asdict().items())
        return {f"{name}_{i}": np.asarray(value) for i, (name, value) in each}

    @staticmethod
    def from_arrays(arrays: Mapping[str, NDArray[Any]]) -> "list[Visit]":
        """Return the visits of `to_arrays`."""
        n = len(arrays) // len(Visit._fields)
        fields: Iterator[list[Any]] = ([arrays[f"{name}_{i}"] for name in Visit._fields] for i in range(n))
        return [Visit(int(pass_), float(time), *others) for pass_, time, *others in fields]


def visits_of(records: NDArray[np.void]) -> list[Visit]:
    """Return the visits to a place that saw enough of it, by pass and time, from its points (`PLACE_POINT`)."""
    found = []
    for number in np.unique(records["pass"]).tolist():
        of_pass = records[records["pass"] == number]
        of_pass = of_pass[np.argsort(of_pass["time"], kind="stable")]
        visits = (_visit(number, float(part["time"].mean()), part["inside"]) for part in _parts(of_pass))
        found += [visit for visit in visits if visit is not None]
    return found


def _parts(records: NDArray[np.void]) -> Iterator[NDArray[np.void]]:
    """Points of single visits of one pass, from points by time."""
    is_new = np.diff(records["time"], prepend=records["time"][:1]) > LONGEST_GAP
    for group in np.split(records, np.flatnonzero(is_new)):
        if len(group) < LEAST_POINTS:
            continue
        since = group["time"] - group["time"][0]
        n_visits = max(1, int(np.ceil(since[-1] / LONGEST_VISIT)))
        number = np.minimum((since * n_visits / max(since[-1], 1e-9)).astype(np.int64), n_visits - 1)
        parts = np.split(group, np.flatnonzero(np.diff(number)) + 1)
        yield from (part for part in parts if len(part) >= LEAST_POINTS)


def _visit(number: int, time: float, inside: NDArray[np.float32]) -> Visit | None:
    """Return a visit of points (n, 3), m from the middle of the place; None if they lie on too few planes."""
    points = inside.astype(np.float64)
    corner = np.array([*[-0.5 * PLACE_EDGE - MARGIN * CELL] * 2, 0.0])
    _, records = point_records(points - corner, np.zeros(points.shape, np.float32), CELL)
    moments = VoxelMoments.from_records([records])
    normals = plane_normals(moments, CELL, np.ones(len(moments), bool))
    has_normal: NDArray[np.bool_] = np.asarray(normals.any(axis=1))
    if np.count_nonzero(has_normal) < LEAST_PLANES:
        return None
    means = moments.indices * CELL + corner + moments.sums / moments.counts[:, None]
    indices = np.column_stack([records["column"], records["layer"]])
    voxel_of_point = np.searchsorted(moments.keys, voxel_keys(indices))
    of_points = normals[voxel_of_point]
    rows = np.flatnonzero(has_normal[voxel_of_point])
    kept = rows[one_per_cube(points[rows], SAMPLE_EDGE, of_points[rows], by_lot=True)]
    arrays = (means[has_normal], normals[has_normal], points[kept], of_points[kept])
    return Visit(number, time, *(array.astype(np.float32) for array in arrays))


class Constraint(NamedTuple):
    """The measured pose of one visit to a place relative to another: an edge of the pose graph."""

    place: NDArray[np.float64]  # (3,): middle of the place, global, m
    passes: tuple[int, int]  # numbers of the passes
    times: tuple[float, float]  # of the visits, s
    # T_first_second, axes of the map, origin in the middle of the place: it moves points of the second visit
    # onto surfaces of the first, both uncorrected
    pose: Pose
    covariance: NDArray[np.float64]  # (6, 6): of its x, y, z, roll, pitch and heading, m^2, m rad and rad^2
    ratio: float  # of the second visit's points, how many lie on planes of the first, 0 to 1
    fault: str = ""  # why the match is not used; empty if it is


def match_visits(middle: NDArray[np.float64], visits: Sequence[Visit], corrections: Corrections) -> list[Constraint]:
    """Match the visits to a place, whose middle is global, m, with each other, from where the corrections put them.

    k visits have k (k - 1) / 2 pairs, but only k - 1 independent differences: covariances are made k / 2 times as
    large, so that all pairs together weigh as much as the independent ones.
    """
    pairs = _pairs(visits)
    firsts, seconds = {one for one, _ in pairs}, {other for _, other in pairs}
    repetition = max(1.0, len(pairs) / max(1, len(firsts | seconds) - 1))
    motions = [pose_of_twist(corrections.twist_at(middle, visit.time, visit.pass_)) for visit in visits]
    planes = {number: (visits[number].planes, visits[number].normals) for number in firsts}
    maps = {number: PointMap.from_points(*each, CELL, is_signed=False, sigma=0.0) for number, each in planes.items()}
    scans = {number: Scan(visits[number].points, visits[number].point_normals) for number in seconds}
    constraints = []
    for one, other in pairs:
        first, second = visits[one], visits[other]
        refined = refine(scans[other], maps[one], motions[one].inverse @ motions[other])
        ratio = refined.n_planes / len(scans[other])
        fault = "they lie farther apart than was looked" if refined.moved > FARTHEST else ""
        if refined.n_planes < LEAST_POINTS_ON_PLANES or ratio < LEAST_RATIO:
            fault = "too few points of one lie on planes of the other"
        known = repetition * covariance(refined, MATCH_FLOOR) + _open_covariance(refined)
        passes, times = (first.pass_, second.pass_), (first.time, second.time)
        constraints.append(Constraint(middle, passes, times, refined.pose, known, ratio, fault))
    return constraints


def _open_covariance(refined: Refined) -> NDArray[np.float64]:
    """Covariance (6, 6) to be added along directions that only the noise of normals seems to determine."""
    # A normal n with noise s (rad) adds n n' + s^2 (I - n n') on average: open is where the second term is most of it.
    from scipy.linalg import eigh

    rows = np.flatnonzero(refined.weights)
    if len(rows) < LEAST_POINTS_ON_PLANES:
        return np.zeros((6, 6))
    arms = refined.points[rows] @ refined.pose.rotation.T
    motions = twist_matrices(arms)[:, :3]  # derivatives of each point by a shift and a turn
    roots = np.sqrt(refined.weights[rows])
    along = roots[:, None] * np.einsum("ni,nij->nj", refined.planes[rows, :3], motions)
    anyhow = (roots[:, None, None] * motions).reshape(-1, 6)
    noise = NORMAL_NOISE**2 * (anyhow.T @ anyhow - along.T @ along)
    over_noise, directions = eigh(along.T @ along, noise)
    opened = directions[:, over_noise < LEAST_OVER_NOISE]
    opened = opened / np.linalg.norm(opened * np.repeat([1.0, OPEN_ARM], 3)[:, None], axis=0)
    return np.asarray(OPEN_SIGMA**2 * opened @ opened.T)


def _pairs(visits: Sequence[Visit]) -> list[tuple[int, int]]:
    """Numbers of the visits to be matched: not two of one pass within a minute."""
    reach = len(visits) if len(visits) <= MOST_VISITS else MOST_VISITS // 2
    return [
        (one, other)
        for one, other in combinations(range(len(visits)), 2)
        if other - one <= reach
        and (visits[one].pass_ != visits[other].pass_ or visits[other].time - visits[one].time > LEAST_PAUSE)
    ]
