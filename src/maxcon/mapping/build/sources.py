"""Sources of a map's points: their CRS, what is dropped of them, and from which side each surface was seen."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import CrsError, FileError, OptionError, TrajectoryError
from maxcon.io.clouds import CLOUD_SUFFIXES, Bounds, CloudChunk, CloudHeader, CloudReader, open_cloud
from maxcon.io.crs import PointTransform, metric_crs, same_crs
from maxcon.io.text import reading
from maxcon.mapping.build.options import GROUND, NOISE, UNCLASSIFIED, Area, MapOptions, parse_classes
from maxcon.scan.trajectory import Trajectory

FARTHEST_SENSOR = 20_000.0  # m; no scanner sees so far, from an aeroplane neither
LARGEST_TIME_GAP = 0.5  # s; farther from any pose of the trajectory, a point's sensor position is not known
NOT_IN_FOLDERS = (".csv", ".txt")  # suffixes of clouds, but beside clouds usually of trajectories and notes
FIRST_POINTS = 1000  # among so many at the start of a source its first finite point is looked for


@dataclass(slots=True, eq=False)
class Source:
    """One cloud of a map: how its points get into the CRS of the map, and how many of them were left out and why."""

    header: CloudHeader
    area: Area | None = None
    transform: PointTransform | None = None
    n_points: int = 0
    left_out: Counter[str] = field(default_factory=Counter)  # By reason: thinned, invalid, outside or withheld
    n_dropped: Counter[int] = field(default_factory=Counter)  # By class
    n_without_side: int = 0
    is_classified: bool = False

    @property
    def n_kept(self) -> int:
        """Points that went into the map."""
        return self.n_points - self.left_out.total() - self.n_dropped.total()

    def open(self) -> CloudReader:
        """Return a reader of its points."""
        return open_cloud(self.header.path) if self.header.reader is None else self.header.reader

    def placed(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points, shape (n, 3), in the coordinates of the map."""
        return points if self.transform is None else self.transform.apply(points)

    @property
    def bounds(self) -> Bounds | None:
        """Where the points of the area lie in the coordinates of the source; None: perhaps anywhere."""
        if self.area is None:
            return None
        sides = astuple(self.area)
        found = sides if self.transform is None else self.transform.bounds_in_source(sides)
        return None if found is None else Bounds(*found)

    def check_operation(self, options: MapOptions, cell: float) -> None:
        """Refuse points that were transformed less exactly than voxels of this edge, m: CrsError."""
        operation = None if self.transform is None else self.transform.operation
        if operation is not None and not options.allow_inexact_crs:
            operation.check(cell, str(self.header.path))

    def first_point(self) -> NDArray[np.float64]:
        """First point that is finite in the map, shape (3,), global, m; infinity if none is near the start."""
        with self.open() as reader:
            points = self.placed(next((chunk.points for chunk in reader.chunks(FIRST_POINTS)), np.empty((0, 3))))
        finite = points[np.isfinite(points).all(axis=1)]
        return np.asarray(finite[0]) if len(finite) else np.full(3, np.inf)

    def describe(self) -> dict[str, object]:
        """Return its entry in the manifest (docs/map_format.md)."""
        operation = None if self.transform is None else self.transform.operation
        return {
            "name": self.header.path.name, "n_points": self.n_points, "n_kept": self.n_kept,
            "n_thinned": self.left_out["thinned"], "n_outside": self.left_out["outside"],
            "transform": "" if self.transform is None else self.transform.words,
            "operation": operation and operation.describe(), "n_invalid": self.left_out["invalid"],
            "n_withheld": self.left_out["withheld"], "n_without_side": self.n_without_side,
            "n_dropped": {str(number): n for number, n in sorted(self.n_dropped.items())},
            "is_classified": self.is_classified,
        }  # fmt: skip


class SidedPoints(NamedTuple):
    """Points for the map, global, m."""

    points: NDArray[np.float64]  # (n, 3): For its voxels
    sides: NDArray[np.float32]  # (n, 3): The side of the surface that each was seen from: a direction, or zeros
    ground: NDArray[np.float64]  # (k, 3): For its grid of ground heights: of a ground class, for the voxels too or not
    times: NDArray[np.float64] | None  # (n,): s; None where the source has none


def open_headers(sources: Sequence[str | os.PathLike[str] | CloudReader]) -> list[CloudHeader]:
    """Headers of all sources, of a folder its clouds; FileError if there is none, one twice, or one cannot be read."""
    if not sources:
        raise FileError("Expected at least one point cloud, got none. Name LAS, LAZ, PLY, PCD, NPZ, E57 or XYZ files.")
    headers = [replace(each.header, reader=each) for each in sources if isinstance(each, CloudReader)]
    files = [file for path in sources if not isinstance(path, CloudReader) for file in _files_at(Path(path))]
    twice = [file for file, number in Counter(file.resolve() for file in files).items() if number > 1]
    if twice:
        raise FileError(f"Expected each point cloud once, got {twice[0]} more than once. Name it once.")
    for file in files:
        with open_cloud(file) as reader:
            headers.append(reader.header)
    return headers


def _files_at(path: Path) -> list[Path]:
    """Return the clouds in a folder, by name, or the file itself."""
    suffixes = [suffix for suffix in CLOUD_SUFFIXES if suffix not in NOT_IN_FOLDERS]
    with reading(path, "a point-cloud file"):
        if not path.is_dir():
            return [path]
        files = sorted(file for file in path.iterdir() if file.suffix.lower() in suffixes)
    if not files:
        raise FileError(
            f"Expected point clouds in {path} ({', '.join(suffixes)}), got none. Name another folder, or the files"
            f" ({', '.join(NOT_IN_FOLDERS)} are taken only so)."
        )
    return files


def common_crs(headers: Sequence[CloudHeader], crs: str | None) -> str | None:
    """Return the one CRS of all sources as WKT, None where none is named; `crs`: that of sources that name none."""
    wanted = metric_crs(crs) if crs is not None else None
    named: list[tuple[object, str]] = [] if wanted is None else [(f"--crs {crs}", wanted)]
    named += [(header.path, metric_crs(header.crs)) for header in headers if header.crs is not None]
    for where, own in named[1:]:
        if not same_crs(own, named[0][1]):
            raise CrsError(
                f"Expected all point clouds in one CRS, but {named[0][0]} and {where} name different ones. Reproject"
                " them (--to-crs), or leave out --crs."
            )
    for header in headers:
        if header.crs is None and wanted is None and (named or header.crs_fault):
            where = f"{header.path}, as in {named[0][0]}" if named else str(header.path)
            raise CrsError(
                f"Expected a coordinate reference system that PROJ knows in {where}, got"
                f" {header.crs_fault or 'none'}. Say which it is with --crs."
            )
    return wanted if headers[0].crs is None else metric_crs(headers[0].crs)


def sources_in_crs(headers: Sequence[CloudHeader], options: MapOptions) -> tuple[str | None, list[Source]]:
    """Return the CRS of a map as WKT, None if it has none, and its sources; CrsError if they cannot be put together."""
    if options.to_crs is None:
        return common_crs(headers, options.crs), [Source(header, options.area) for header in headers]
    target = metric_crs(options.to_crs)
    sources, references = [], dict[str, CloudHeader]()
    for header in headers:
        own = header.crs or options.crs
        if own is None:
            raise CrsError(
                f"Expected a coordinate reference system in {header.path}, to turn its points into {options.to_crs},"
                f" got {header.crs_fault or 'none'}. Say which it is with --crs."
            )
        transform = PointTransform(own, target)
        sources.append(Source(header, options.area, transform))
        references[transform.height_reference] = header
    if len(references) > 1:
        one, other = list(references.items())[:2]
        raise CrsError(
            f"Expected heights of one kind in all point clouds, got those of {one[0] or 'no stated reference'} in"
            f" {one[1].path} and of {other[0] or 'no stated reference'} in {other[1].path}. Make a map of each, or"
            " convert one."
        )
    return target, sources


def read_source(source: Source, options: MapOptions, *, use_normals: bool) -> Iterator[SidedPoints]:
    """Yield the points of a source that belong in the map, with normals for sides if `use_normals`."""
    header, trajectory = source.header, options.trajectory
    drop = options.dropped_classes(are_asprs=header.has_asprs_classes)
    if options.classify == "always":
        drop &= NOISE | parse_classes((), options.vehicle_classes)
    are_known = header.has_asprs_classes or options.drop is not None or bool(drop)
    with source.open() as reader:
        for chunk in reader.chunks(bounds=source.bounds):
            if trajectory is not None and (chunk.times is None or not chunk.times.any()):
                raise OptionError(
                    f"Expected times in {header.path} to match with the trajectory, but it has none, or gps_time is 0."
                    " Leave out --trajectory, or export the points with gps_time."
                )
            placed = replace(chunk, points=source.placed(chunk.points))
            is_kept = _are_wanted(placed, source, options.keep_every)
            ground = placed.points[:0]
            if placed.classes is not None:
                if header.has_asprs_classes and options.classify != "always":
                    ground = placed.points[is_kept & np.isin(placed.classes, list(GROUND))]
                _drop_classes(placed.classes, is_kept, source, drop, are_known=are_known)
            points = placed.points[is_kept]
            times = None if placed.times is None else placed.times[is_kept]
            normals = placed.normals[is_kept] if use_normals and placed.normals is not None else None
            yield SidedPoints(points, _sides(points, times, normals, trajectory, source), ground, times)
    if header.reader is None:  # what a file knows to lie outside was not read
        source.left_out["outside"] += header.n_points - source.n_points
        source.n_points = header.n_points


def _are_wanted(chunk: CloudChunk, source: Source, keep_every: int) -> NDArray[np.bool_]:
    """Which points are finite, in the area, not withheld and not thinned out; the others are counted."""
    everything = np.ones(len(chunk.points), bool)
    is_wanted = everything.copy()
    for reason, passes in (
        ("thinned", (source.n_points + np.arange(len(chunk.points))) % keep_every == 0),
        ("invalid", np.isfinite(chunk.points).all(axis=1)),
        ("outside", everything if source.area is None else source.area.contains(chunk.points)),
        ("withheld", everything if chunk.is_withheld is None else ~chunk.is_withheld),
    ):
        source.left_out[reason] += int((is_wanted & ~passes).sum())
        is_wanted &= passes
    source.n_points += len(chunk.points)
    return is_wanted


def _drop_classes(
    classes: NDArray[np.uint8], is_kept: NDArray[np.bool_], source: Source, drop: frozenset[int], *, are_known: bool
) -> None:
    """Keep no points of dropped classes, and count them; in place."""
    n_of_class = np.bincount(classes[is_kept], minlength=256)
    present = set(np.flatnonzero(n_of_class).tolist())
    source.is_classified |= are_known and not present <= UNCLASSIFIED | NOISE
    source.n_dropped.update({number: int(n_of_class[number]) for number in present & drop})
    is_kept &= ~np.isin(classes, list(present & drop))


def _sides(
    points: NDArray[np.float64], times: NDArray[np.float64] | None, normals: NDArray[np.float64] | None,
    trajectory: Trajectory | None, source: Source,
) -> NDArray[np.float32]:  # fmt: skip
    """Normals, turned to the sensor where it is known, or else directions to the sensor; zeros where not known."""
    sides = np.zeros((len(points), 3))
    if normals is not None:
        sides = _unit(np.nan_to_num(normals, posinf=0.0, neginf=0.0))
    if trajectory is not None and times is not None:
        to_sensor = trajectory.positions_at(times, LARGEST_TIME_GAP) - points
        _check_near(to_sensor, points)
        to_sensor = _unit(to_sensor)
        is_known = np.isfinite(to_sensor).all(axis=1)
        source.n_without_side += int((~is_known).sum())
        to_sensor[~is_known] = 0.0
        sides = to_sensor if normals is None else sides * np.sign((sides * to_sensor).sum(axis=1))[:, None]
    return sides.astype(np.float32)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    lengths = np.sqrt((vectors * vectors).sum(axis=1))[:, None]
    return np.asarray(np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths != 0.0))


def _check_near(to_sensor: NDArray[np.float64], points: NDArray[np.float64]) -> None:
    """Refuse a trajectory, TrajectoryError, if most ways to the sensor, (n, 3), m, are longer than FARTHEST_SENSOR."""
    distances = np.hypot(to_sensor[:, 0], to_sensor[:, 1])
    known = np.flatnonzero(np.isfinite(distances))
    if not len(known) or np.median(distances[known]) <= FARTHEST_SENSOR:
        return
    x, y = points[known[0], :2]
    sensor_x, sensor_y = points[known[0], :2] + to_sensor[known[0], :2]
    raise TrajectoryError(
        f"Expected the trajectory where the points were seen from, got x {sensor_x:.7g}, y {sensor_y:.7g} m for a point"
        f" at x {x:.7g}, y {y:.7g} m. Are both in the CRS of the map, that of --to-crs if given, and x and y in"
        " their places?"
    )


def check_sides(sources: Sequence[Source], trajectory: Trajectory) -> None:
    """Refuse a trajectory, TrajectoryError, that has no pose near the time of any point."""
    if all(source.n_without_side == source.n_kept for source in sources):
        raise TrajectoryError(
            f"Expected times of the points within those of the trajectory, {trajectory.times[0]:.3f} to"
            f" {trajectory.times[-1]:.3f} s, but no point has a pose within {LARGEST_TIME_GAP} s."
            " Do both use the same clock (LAS: GPS week seconds or adjusted standard time)?"
        )
