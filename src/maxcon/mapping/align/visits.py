# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Visits: what one round measured of one place in one pass, thinned to planes and to points on them."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.map import PointMap
from maxcon.mapping.build.spill import RECORD
from maxcon.mapping.build.voxel_moments import VoxelMoments, voxel_keys
from maxcon.mapping.build.voxel_normals import plane_normals
from maxcon.refine.adjustment import THINNING
from maxcon.scan import Scan, one_per_cube

__all__ = ["Visit", "load_visits", "save_visits", "visits_of"]

CELL = 0.12
"""Voxel edge of the planes, m: partners are looked for within five of them, as far as the first gate."""
MARGIN = 16
"""Voxels between the corner of the grid and that of the place."""
LONGEST_GAP = 10.0
"""A visit ends where no point of the place was measured for so long, s."""
LONGEST_VISIT = 20.0
"""s; longer ones, of a vehicle that stands, are split."""
LEAST_POINTS = 2000
LEAST_PLANES = 300
"""Visits with fewer points, or fewer voxels with a normal, are left out."""
ARRAYS = ("planes", "normals", "points", "point_normals")


@dataclass(frozen=True, slots=True, eq=False)
class Visit:
    """What one round measured of one place; frame: axes of the map, origin in the middle of the place.

    Parameters
    ----------
    round : int
        Number of the round.
    time : float
        Mean of the points' times, s.
    planes, normals : array, shape (k, 3), float32
        Means of the points of voxels, m, and unit normals of the surface there.
    points, point_normals : array, shape (n, 3), float32
        Some measured points, one in 0.4 m, and normals of their voxels.
    """

    round: int
    time: float
    planes: NDArray[np.float32]
    normals: NDArray[np.float32]
    points: NDArray[np.float32]
    point_normals: NDArray[np.float32]

    @property
    def point_map(self) -> PointMap:
        """The planes as a map, for another visit to be matched with."""
        return PointMap.from_points(self.planes, self.normals, CELL, is_signed=False, sigma=0.0)

    @property
    def scan(self) -> Scan:
        """The points as a scan, to be matched with another visit."""
        return Scan(self.points, self.point_normals)


def visits_of(records: NDArray[np.void], edge: float) -> list[Visit]:
    """Return the visits to a place that saw enough of it, by round and time.

    Parameters
    ----------
    records : array
        Points of the place (`PLACE_RECORD`).
    edge : float
        Edge of the place, m.
    """
    found = []
    for number in np.unique(records["round"]).tolist():
        of_round = records[records["round"] == number]
        of_round = of_round[np.argsort(of_round["time"], kind="stable")]
        for part in _parts(of_round):
            visit = _visit(number, float(part["time"].mean()), part["inside"].astype(np.float64), edge)
            if visit is not None:
                found.append(visit)
    return found


def save_visits(path: Path, visits: list[Visit]) -> None:
    """Write visits to an uncompressed NPZ file."""
    arrays = {f"{name}_{i}": getattr(visit, name) for i, visit in enumerate(visits) for name in ARRAYS}
    times, rounds = np.array([visit.time for visit in visits]), np.array([visit.round for visit in visits])
    with path.open("wb") as file:
        np.savez(file, times=times, rounds=rounds, **arrays)


def load_visits(path: Path) -> list[Visit]:
    """Read what `save_visits` wrote."""
    with np.load(path, allow_pickle=False) as arrays:
        return [
            Visit(number, time, *(arrays[f"{name}_{i}"] for name in ARRAYS))
            for i, (number, time) in enumerate(zip(arrays["rounds"].tolist(), arrays["times"].tolist(), strict=True))
        ]


def _parts(records: NDArray[np.void]) -> Iterator[NDArray[np.void]]:
    """Points of single visits of one round, from points by time."""
    is_new = np.diff(records["time"], prepend=records["time"][:1]) > LONGEST_GAP
    for group in np.split(records, np.flatnonzero(is_new)):
        if len(group) < LEAST_POINTS:
            continue
        since = group["time"] - group["time"][0]
        n_visits = max(1, int(np.ceil(since[-1] / LONGEST_VISIT)))
        number = np.minimum((since * n_visits / max(since[-1], 1e-9)).astype(np.int64), n_visits - 1)
        for part in np.split(group, np.flatnonzero(np.diff(number)) + 1):
            if len(part) >= LEAST_POINTS:
                yield part


def _visit(number: int, time: float, points: NDArray[np.float64], edge: float) -> Visit | None:
    """Return a visit of these points (n, 3), m from the middle of the place; None if they lie on too few planes."""
    moments, voxel_of_point, corner = _moments(points, edge)
    normals = plane_normals(moments, CELL, np.ones(len(moments), bool))
    has_normal: NDArray[np.bool_] = np.asarray(normals.any(axis=1))
    if np.count_nonzero(has_normal) < LEAST_PLANES:
        return None
    means = moments.indices * CELL + corner + moments.sums / moments.counts[:, None]
    of_points = normals[voxel_of_point]
    rows = np.flatnonzero(has_normal[voxel_of_point])
    kept = rows[one_per_cube(points[rows], of_points[rows], THINNING, by_lot=True)]
    arrays = (means[has_normal], normals[has_normal], points[kept], of_points[kept])
    return Visit(number, time, *(array.astype(np.float32) for array in arrays))


def _moments(points: NDArray[np.float64], edge: float) -> tuple[VoxelMoments, NDArray[np.int64], NDArray[np.float64]]:
    """Moments of the voxels of points (n, 3), m; the row of each point's voxel; the corner of the grid, m."""
    corner = np.array([-0.5 * edge - MARGIN * CELL, -0.5 * edge - MARGIN * CELL, 0.0])
    places = points - corner
    indices = np.floor(places / CELL).astype(np.int32)
    records = np.zeros(len(points), RECORD)
    records["column"], records["layer"] = indices[:, :2], indices[:, 2]
    records["inside"] = places - indices * CELL
    moments = VoxelMoments.from_records([records])
    return moments, np.searchsorted(moments.keys, voxel_keys(indices)), corner
