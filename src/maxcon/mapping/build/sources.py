# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Where a map's points come from: their CRS, what is dropped of them, and which side of a surface they saw."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import CrsError, FileError, OptionError, TrajectoryError
from maxcon.io.clouds import CloudChunk, CloudHeader, open_cloud
from maxcon.io.crs import metric_crs, same_crs
from maxcon.mapping.build.classes import GROUND, NOISE, UNCLASSIFIED
from maxcon.mapping.build.placement import Area, Placement
from maxcon.scan.trajectory import Trajectory

__all__ = [
    "SidedPoints",
    "SourceCounts",
    "check_sides",
    "common_crs",
    "first_point",
    "open_headers",
    "read_source",
]

# No scanner sees so far (m), from an aeroplane neither.
FARTHEST_SENSOR = 20_000.0
# Farther from any pose of the trajectory than this, a point's sensor position is not known (s).
LARGEST_TIME_GAP = 0.5
# Among so many at the start of a source its first finite point is looked for.
FIRST_POINTS = 1000
EVERYWHERE = Placement()


@dataclass(slots=True)
class SourceCounts:
    """What became of the points of one file."""

    name: str
    n_points: int = 0
    n_thinned: int = 0
    n_outside: int = 0
    n_invalid: int = 0
    n_withheld: int = 0
    n_without_side: int = 0
    n_dropped: Counter[int] = field(default_factory=Counter)
    has_known_classes: bool = True
    is_classified: bool = False

    @property
    def n_kept(self) -> int:
        """Points that went into the map."""
        left_out = self.n_thinned + self.n_outside + self.n_invalid + self.n_withheld + self.n_dropped.total()
        return self.n_points - left_out


@dataclass(frozen=True, slots=True)
class SidedPoints:
    """Points for the map, global, m.

    Parameters
    ----------
    points : array, shape (n, 3)
        For its voxels.
    sides : array, shape (n, 3)
        The side of the surface that each was seen from: a direction, or zeros.
    ground : array, shape (k, 3)
        For its grid of ground heights: those of a ground class, whether they are for the voxels too or not.
    times : array, shape (n,), or None
        s; None where the source has none.
    """

    points: NDArray[np.float64]
    sides: NDArray[np.float32]
    ground: NDArray[np.float64]
    times: NDArray[np.float64] | None


def open_headers(paths: Sequence[str | os.PathLike[str]]) -> list[CloudHeader]:
    """Headers of all sources, so that what cannot work is said before anything is read.

    Raises
    ------
    FileError
        If there is no source, one is named twice, or one cannot be read.
    """
    if not paths:
        raise FileError(
            "Expected at least one point cloud, got none. Name LAS, LAZ, PLY, NPZ, E57 or XYZ files."
        )
    files = [Path(path) for path in paths]
    twice = [file for file, number in Counter(file.resolve() for file in files).items() if number > 1]
    if twice:
        raise FileError(f"Expected each point cloud once, got {twice[0]} more than once. Name it once.")
    headers = []
    for file in files:
        with open_cloud(file) as reader:
            headers.append(reader.header)
    return headers


def first_point(header: CloudHeader, placement: Placement) -> NDArray[np.float64]:
    """First point of a source that is finite in the map, shape (3,), global, m; infinity if none is near the start."""
    with open_cloud(header.path) as reader:
        for chunk in reader.chunks(FIRST_POINTS):
            points = placement.apply(chunk.points)
            finite = points[np.isfinite(points).all(axis=1)]
            return finite[0] if len(finite) else np.full(3, np.inf)
    return np.full(3, np.inf)


def common_crs(headers: Sequence[CloudHeader], crs: str | None) -> str | None:
    """Return the one CRS of all sources as WKT; None where none is named.

    Parameters
    ----------
    headers : sequence of CloudHeader
        The sources.
    crs : str or None
        The CRS of sources that name none.

    Raises
    ------
    CrsError
        If sources disagree, or some name a CRS and some none, or none that is known, and `crs` is None.
    """
    wanted = metric_crs(crs) if crs is not None else None
    first: tuple[CloudHeader, str] | None = None
    for header in headers:
        own = metric_crs(header.crs) if header.crs is not None else wanted
        if own is None and header.crs_fault:
            raise CrsError(
                f"Expected a coordinate reference system that PROJ knows in {header.path}, got {header.crs_fault}."
                " Say which it is with --crs, or assign it anew."
            )
        if own is None:
            continue
        if wanted is not None and not same_crs(own, wanted):
            raise CrsError(
                f"Expected {header.path} to be in the CRS given, {crs}, but it names another itself."
                " Reproject it (--to-crs), or leave out --crs."
            )
        if first is not None and not same_crs(own, first[1]):
            raise CrsError(
                f"Expected all point clouds in one CRS, but {first[0].path} and {header.path} name different"
                " ones. Reproject them: --to-crs."
            )
        first = first or (header, own)
    without = [header for header in headers if header.crs is None]
    if first is not None and wanted is None and without:
        raise CrsError(
            f"Expected all point clouds to name their CRS as {first[0].path} does, but {without[0].path} names"
            " none. Say it with --crs."
        )
    return first[1] if first is not None else None


def read_source(
    header: CloudHeader,
    counts: SourceCounts,
    drop: frozenset[int],
    trajectory: Trajectory | None,
    *,
    use_normals: bool,
    keep_every: int = 1,
    placement: Placement = EVERYWHERE,
) -> Iterator[SidedPoints]:
    """Yield the points of a source that belong in the map, and count the others.

    Parameters
    ----------
    header : CloudHeader
        The source.
    counts : SourceCounts
        Filled as it is read.
    drop : frozenset of int
        Classes to leave out.
    trajectory : Trajectory or None
        Where the sensor was, to tell the side of a surface it saw.
    use_normals : bool
        Whether the sides are the normals of the source (turned to the sensor where it is known).
    keep_every : int
        Of so many points, in the order of the file, one is kept.
    placement : Placement
        Where its points are in the map, and which of them are wanted.

    Raises
    ------
    OptionError
        If the trajectory needs times and the source has none.
    """
    if trajectory is not None and not header.has_times:
        raise OptionError(
            f"Expected times in {header.path} to match with the trajectory, but it has none."
            " Leave out --trajectory, or export the points with gps_time."
        )
    with open_cloud(header.path) as reader:
        for chunk in reader.chunks(bounds=placement.bounds_in_source):
            if trajectory is not None and chunk.times is not None and not chunk.times.any():
                raise OptionError(
                    f"Expected times in {header.path} to match with the trajectory, but gps_time is 0 there."
                    " Leave out --trajectory, or export the points with gps_time."
                )
            is_wanted = (counts.n_points + np.arange(len(chunk.points))) % keep_every == 0
            counts.n_points += len(chunk.points)
            counts.n_thinned += int((~is_wanted).sum())
            placed = replace(chunk, points=placement.apply(chunk.points))
            if placement.area is not None:
                is_outside = is_wanted & _is_outside(placed.points, placement.area)
                counts.n_outside += int(is_outside.sum())
                is_wanted &= ~is_outside
            yield _keep(placed, is_wanted, counts, drop, trajectory, use_normals, header.has_asprs_classes)
    # What a file knows to lie outside was not read.
    counts.n_outside += header.n_points - counts.n_points
    counts.n_points = header.n_points


def _is_outside(points: NDArray[np.float64], area: Area) -> NDArray[np.bool_]:
    """Which points are somewhere else; those that are nowhere are counted as such."""
    outside: NDArray[np.bool_] = np.isfinite(points).all(axis=1) & ~area.contains(points)
    return outside


def _keep(
    chunk: CloudChunk,
    is_wanted: NDArray[np.bool_],
    counts: SourceCounts,
    drop: frozenset[int],
    trajectory: Trajectory | None,
    use_normals: bool,
    are_asprs: bool,
) -> SidedPoints:
    keep = is_wanted & np.isfinite(chunk.points).all(axis=1)
    counts.n_invalid += int((is_wanted & ~keep).sum())
    if chunk.is_withheld is not None:
        counts.n_withheld += int((keep & chunk.is_withheld).sum())
        keep &= ~chunk.is_withheld
    ground = chunk.points[:0]
    if chunk.classes is not None:
        if are_asprs:
            ground = chunk.points[keep & np.isin(chunk.classes, list(GROUND))]
        n_of_class = np.bincount(chunk.classes[keep], minlength=256)
        present = np.flatnonzero(n_of_class)
        counts.is_classified |= counts.has_known_classes and not (UNCLASSIFIED | NOISE).issuperset(
            present.tolist()
        )
        dropped = [number for number in present.tolist() if number in drop]
        counts.n_dropped.update({number: int(n_of_class[number]) for number in dropped})
        keep &= ~np.isin(chunk.classes, dropped)
    points = chunk.points[keep]
    times = None if chunk.times is None else chunk.times[keep]
    sides = np.zeros((len(points), 3))
    if use_normals and chunk.normals is not None:
        sides = _unit(np.nan_to_num(chunk.normals[keep], posinf=0.0, neginf=0.0))
    if trajectory is not None and times is not None:
        to_sensor = trajectory.positions_at(times, LARGEST_TIME_GAP) - points
        _check_near(to_sensor, points)
        to_sensor = _unit(to_sensor)
        is_known = np.isfinite(to_sensor).all(axis=1)
        counts.n_without_side += int((~is_known).sum())
        to_sensor[~is_known] = 0.0
        if use_normals:
            sides *= np.sign((sides * to_sensor).sum(axis=1))[:, None]
        else:
            sides = to_sensor
    return SidedPoints(points, sides.astype(np.float32), ground, times)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    lengths = np.sqrt((vectors * vectors).sum(axis=1))
    unit: NDArray[np.float64] = np.zeros_like(vectors)
    np.divide(vectors, lengths[:, None], out=unit, where=lengths[:, None] != 0.0)
    return unit


def _check_near(to_sensor: NDArray[np.float64], points: NDArray[np.float64]) -> None:
    """Refuse sensor positions that no scanner reaches the points from, given what leads to them, (n, 3), m.

    Raises
    ------
    TrajectoryError
        If most lie farther away than FARTHEST_SENSOR.
    """
    distances = np.hypot(to_sensor[:, 0], to_sensor[:, 1])
    known = np.flatnonzero(np.isfinite(distances))
    if not len(known) or np.median(distances[known]) <= FARTHEST_SENSOR:
        return
    x, y = points[known[0], :2]
    sensor_x, sensor_y = points[known[0], :2] + to_sensor[known[0], :2]
    raise TrajectoryError(
        f"Expected the trajectory where the points were seen from, got x {sensor_x:.7g}, y {sensor_y:.7g} m for a point"
        f" at x {x:.7g}, y {y:.7g} m. Are both in the CRS of the map, and x and y in their places?"
    )


def check_sides(counts: Sequence[SourceCounts], trajectory: Trajectory) -> None:
    """Refuse a trajectory that says of no point where its sensor was.

    Raises
    ------
    TrajectoryError
        If no point has a pose near its time.
    """
    n_kept = sum(source.n_kept for source in counts)
    if n_kept and sum(source.n_without_side for source in counts) == n_kept:
        raise TrajectoryError(
            f"Expected times of the points within those of the trajectory, {trajectory.times[0]:.3f} to"
            f" {trajectory.times[-1]:.3f} s, but no point has a pose within {LARGEST_TIME_GAP} s."
            " Do both use the same clock (LAS: GPS week seconds or adjusted standard time)?"
        )
