"""Points for CloudCompare, QGIS and the like: scans of a drive placed in the map, and a map, as LAZ, LAS or PLY."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon._system import Progress
from maxcon._system.atomic import atomic_file
from maxcon.drive.localize import scan_of
from maxcon.errors import OptionError, TrajectoryError
from maxcon.export.pose_rows import PoseRow
from maxcon.geometry import LocalFrame, Pose
from maxcon.io.clouds.laz import laz_as_os_error
from maxcon.io.crs import metric_crs
from maxcon.io.raw_scan import nearest_in_time
from maxcon.io.scans import Scans
from maxcon.map import PointMap
from maxcon.map.ground import ground_voxels
from maxcon.map.manifest import Manifest, read_manifest
from maxcon.map.storage import open_storage
from maxcon.map.store import stored_ground, stored_tiles
from maxcon.refine.adjustment import planes_near, table_around
from maxcon.scan import Scan

PLACED_SUFFIXES = (".laz", ".las")  # of scans placed in the map
MATCHED = 0.3  # so near a plane of the map a point is matched, m
RESOLUTION = 0.001  # of the stored coordinates, m
SAME_TIME = 1e-3  # largest distance between the times of a row and of its scan, s
MAX_SOURCES = 2**16  # a point_source_id has 16 bits: numbers of epochs begin anew beyond
MAP_SUFFIXES = (".laz", ".las", ".ply")
UNCLASSIFIED, GROUND_CLASS = 1, 2  # ASPRS classes of voxels and of the ground: a map does not keep those of clouds
POINT = np.dtype([
    ("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("nx", "<f4"), ("ny", "<f4"), ("nz", "<f4"), ("count", "<i4"),
    ("class", "u1"), ("change", "u1"),
])  # fmt: skip
_PLY_TYPES = {"<f8": "double", "<f4": "float", "<i4": "int", "|u1": "uchar"}


def write_placed_scans(
    path: Path, rows: Sequence[PoseRow], scans: Scans, crs: str | None, point_map: PointMap | None, *ranges: float
) -> int:
    """Write the points of all localized epochs in the map's frame, one epoch in memory; return how many they are."""
    epochs = [(row, scan_of_row(row, scans), row.pose) for row in rows if row.pose is not None]
    n_points = 0
    extra = () if point_map is None else (("matched", np.uint8), ("distance", np.float32))
    with las_writer(path, epochs[0][2].position, crs, extra) as write:
        for row, epoch, pose in epochs:
            raw = scans.read(epoch, *ranges)
            times = row.time + (np.zeros(len(raw.points)) if raw.point_times is None else raw.point_times)
            fields = {}
            if point_map is not None:
                distances = _distances(scan_of(raw), point_map, point_map.frame.pose_to_local(pose))
                fields = {"matched": np.isfinite(distances), "distance": distances}
            write(pose.apply(raw.points), gps_time=times, point_source_id=epoch % MAX_SOURCES, **fields)
            n_points += len(raw.points)
    return n_points


def _distances(scan: Scan, point_map: PointMap, pose: Pose) -> NDArray[np.float64]:
    """Distances, shape (n,), m, of the points of a scan from planes of the map; NaN beyond `MATCHED`."""
    table = table_around(scan, point_map, [pose])
    _, distances = planes_near(scan.points, scan.normals, pose, MATCHED, point_map, table, with_all=True)
    return np.where(np.isfinite(distances), np.abs(distances), np.nan)


@contextmanager
def las_writer(
    path: Path, origin: ArrayLike, crs: str | None, extra: Sequence[tuple[str, Any]] = ()
) -> Iterator[Callable[..., None]]:
    """Yield what writes places (n, 3), m, and their fields, also extra ones, into a LAZ or LAS 1.4, point format 6."""
    import laspy
    import pyproj

    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, RESOLUTION), np.floor(origin)
    header.add_extra_dims([laspy.ExtraBytesParams(name, kind) for name, kind in extra])
    if crs is not None:
        header.add_crs(pyproj.CRS.from_user_input(metric_crs(crs)))

    def write(places: NDArray[np.float64], **fields: Any) -> None:
        record = laspy.ScaleAwarePointRecord.zeros(len(places), header=header)
        record.x, record.y, record.z = places.T
        for name, values in {"return_number": 1, "number_of_returns": 1, **fields}.items():
            record[name][:] = values
        writer.write_points(record)

    with (
        atomic_file(path) as partial,
        partial.open("wb") as stream,
        laz_as_os_error(),
        laspy.open(stream, "w", header=header, do_compress=path.suffix.lower() == ".laz", closefd=False) as writer,
    ):
        yield write


def scan_of_row(row: PoseRow, scans: Scans) -> int:
    """Return the number of the scan at the time of a row; TrajectoryError if there is none."""
    number = int(nearest_in_time(scans.times, np.array([row.time]))[0])
    if abs(float(scans.times[number]) - row.time) > SAME_TIME:
        raise TrajectoryError(
            f"Expected a scan of the epoch at {row.time:.3f} s, got the nearest at {scans.times[number]:.3f} s. Name"
            " the scans that the table was made of."
        )
    return number


def export_map(
    map_: str | os.PathLike[str], out: str | os.PathLike[str], *, progress: Progress | None = None
) -> tuple[int, int]:
    """Write a map as points in its CRS, .laz, .las or .ply (docs/exports.md); return how many voxels and heights."""
    path = Path(out)
    if path.suffix.lower() not in MAP_SUFFIXES:
        raise OptionError(f"Expected a file of points with suffix {', '.join(MAP_SUFFIXES)}, got {path}. Rename it.")
    storage = open_storage(map_)
    manifest = read_manifest(storage)
    tiles, ground = stored_tiles(storage, manifest, cache_bytes=0), stored_ground(storage, manifest)
    n_done, n_tiles = [0, 0], len(tiles.keys) + len(ground.keys)

    def points() -> Iterator[NDArray[np.void]]:
        frame = LocalFrame(manifest.origin, manifest.crs)
        steps = [(0, key) for key in sorted(tiles.keys)] + [(1, key) for key in sorted(ground.keys)]
        for done, (kind, key) in enumerate(steps, 1):
            if kind == 0:
                tile = tiles.load(key)
                found = _at(tile.mean_points(manifest.cell), frame, UNCLASSIFIED)
                found["nx"], found["ny"], found["nz"] = tile.normals.T
                found["count"] = tile.counts
                found["change"] = 0 if tile.classes is None else tile.classes
            else:
                heights = ground.load(key).points(manifest.cell * ground_voxels(manifest.cell))
                found = _at(heights, frame, GROUND_CLASS)
            n_done[kind] += len(found)
            yield found
            if progress is not None:
                progress("writing points", done, n_tiles)

    write = _write_ply if path.suffix.lower() == ".ply" else _write_las
    write(path, points(), manifest)
    return n_done[0], n_done[1]


def _at(places: NDArray[np.float64], frame: LocalFrame, number: int) -> NDArray[np.void]:
    """Points of a class at places, shape (n, 3), local frame, m."""
    points = np.zeros(len(places), POINT)
    points["x"], points["y"], points["z"] = frame.to_global(places).T
    points["class"] = number
    return points


def _write_las(path: Path, points: Iterator[NDArray[np.void]], manifest: Manifest) -> None:
    names = {f"Normal{axis.upper()}": f"n{axis}" for axis in "xyz"} | {"count": "count", "change": "change"}
    with las_writer(
        path, manifest.origin, manifest.crs, [(name, POINT[field]) for name, field in names.items()]
    ) as write:
        for some in points:
            fields = {name: some[field] for name, field in names.items()}
            write(np.column_stack([some[axis] for axis in "xyz"]), classification=some["class"], **fields)


def _write_ply(path: Path, points: Iterator[NDArray[np.void]], manifest: Manifest) -> None:
    n_points = manifest.n_voxels + int(manifest.ground.rows["n_rows"].sum())
    crs = " ".join((manifest.crs or "unknown").split())
    lines = ["ply", "format binary_little_endian 1.0", f"comment crs {crs}", f"element vertex {n_points}"]
    lines += [f"property {_PLY_TYPES[POINT[name].str]} {name}" for name in POINT.names or ()]
    with atomic_file(path) as partial, partial.open("wb") as stream:
        stream.write("\n".join([*lines, "end_header", ""]).encode("utf-8"))
        for some in points:
            stream.write(some.tobytes())
