"""Rows of POSES.csv, or of the Parquet file of a drive; written as GeoJSON, GeoPackage, KML, CSV, TUM and KITTI."""

import csv
import json
import math
import os
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon._system.atomic import atomic_file
from maxcon._system.regular_file import check_regular
from maxcon.drive.poses_table import COLUMNS, COVARIANCES, FORMATS, UNKNOWNS
from maxcon.errors import FileError, needs_extra
from maxcon.geometry import Pose
from maxcon.io.clouds.base import as_file_error
from maxcon.io.crs import metric_crs, to_wgs84
from maxcon.io.text import parse_float, read_pose_table
from maxcon.io.trajectories import write_tum
from maxcon.scan.trajectory import Trajectory

PARQUET = ".parquet"
WORDS = ("status", "reason", "scan", "crs")
ISO_POINT_Z, LINE, POLYGON = 1001, 2, 3  # kinds of geometry in well-known binary
TURNS = np.linspace(0.0, 2.0 * np.pi, 65)
CIRCLE_95 = math.sqrt(-2.0 * math.log(0.05)) * np.column_stack([np.cos(TURNS), np.sin(TURNS)])
TINY = 1e-12  # m^2: tables round covariances
ON_THE_GROUND = "clampToGround"


@dataclass(frozen=True, slots=True)
class PoseRow:
    """One epoch."""

    time: float  # s
    pose: Pose | None  # global coordinates; None unless localized
    status: str
    reason: str
    numbers: dict[str, float]  # all others that are there, by the names of their columns
    scan: str = ""  # its name
    crs: str = ""  # of the pose

    @property
    def words(self) -> str:
        """Status and reason in a line."""
        return ": ".join(filter(None, [self.status, self.reason]))


def bearing_deg(pose: Pose) -> float:
    """Heading as a compass has it: from the grid's north, clockwise, 0 to 360 degrees."""
    return (90.0 - math.degrees(pose.heading)) % 360.0


def properties(row: PoseRow) -> dict[str, float | str | None]:
    """Everything in a row, by names that say the unit of angles; None where it is not known."""
    position, angles = dict.fromkeys("xyz"), dict.fromkeys(("roll_deg", "pitch_deg", "heading_deg", "bearing_deg"))
    if row.pose is not None:
        position = dict(zip("xyz", row.pose.position.tolist(), strict=True))
        turns = (*np.degrees(row.pose.values[3:]).tolist(), bearing_deg(row.pose))
        angles = dict(zip(angles, turns, strict=True))
    numbers = {name: row.numbers.get(name) for name in FORMATS if FORMATS[name] and name not in ("time", *UNKNOWNS)}
    first = {"time": row.time, "scan": row.scan, **position, "status": row.status}
    return {**first, **angles, **numbers, "reason": row.reason}


def covariance_of(row: PoseRow) -> NDArray[np.float64]:
    """Covariance of x, y, z, roll, pitch and heading, (6, 6), m^2, m rad and rad^2; zeros where it is not known."""
    matrix = np.zeros((6, 6))
    matrix[np.triu_indices(6)] = [row.numbers.get(name, 0.0) for name in COVARIANCES]
    return matrix + np.triu(matrix, 1).T


def read_rows(path: str | os.PathLike[str]) -> list[PoseRow]:
    """Return all rows of POSES.csv, or of the Parquet file of a drive (`.parquet`); FileError if it is none."""
    file = Path(path)
    with as_file_error(file, "a table such as POSES.csv of maxcon localize"):
        values = _parquet_values(file) if file.suffix.lower() == PARQUET else _csv_values(file)
        rows = [_row(label, cells) for label, cells in values]
        if not rows:
            raise ValueError("not a row per epoch, but none")
    return rows


def _csv_values(file: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the number of each line and its cells by the names of their columns."""
    table = read_pose_table(file, "a table of poses")
    if table.names and tuple(table.names) != COLUMNS:
        raise ValueError(f"{len(table.names)} other columns, {','.join(table.names)[:40]!r}")
    if table.faults:
        raise ValueError(f"in line {min(table.faults)}: {table.faults[min(table.faults)]}")
    for number, cells in zip(table.lines, table.rows, strict=True):
        yield f"line {number}", dict(zip(COLUMNS, cells, strict=True))


def _parquet_values(file: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the number of each row and its values by the names of their columns."""
    import pyarrow.parquet

    check_regular(file)
    with pyarrow.parquet.ParquetFile(file) as opened:
        missing = [name for name in COLUMNS if name not in opened.schema_arrow.names]
        if missing:
            raise ValueError(f"no column {missing[0]}")
        for number, row in enumerate(opened.read(columns=list(COLUMNS)).to_pylist(), 1):
            yield f"row {number}", row


def _row(label: str, cells: dict[str, Any]) -> PoseRow:
    """The row of cells, texts or numbers; None or an empty text where a value is not known."""
    known = {name: value for name, value in cells.items() if value not in (None, "")}
    words = [known.pop(name, "") for name in WORDS]
    parsed = {name: parse_float(value) if isinstance(value, str) else value for name, value in known.items()}
    values = {name: value for name, value in parsed.items() if isinstance(value, int | float)}
    numbers = {name: float(value) for name, value in values.items() if math.isfinite(value)}
    wrong = [value for name, value in known.items() if name not in numbers]
    wrong += [text for text in words if not isinstance(text, str)]
    if wrong or "time" not in numbers:
        raise ValueError(f"in {label}: {repr(wrong[0])[:40] if wrong else 'no time'}")
    unknowns = [numbers.pop(name) for name in UNKNOWNS if name in numbers]
    if len(unknowns) not in (0, len(UNKNOWNS)):
        raise ValueError(f"in {label}: a part of a pose")
    status, reason, *names = words
    return PoseRow(numbers.pop("time"), Pose(*unknowns) if unknowns else None, status, reason, numbers, *names)


def _localized(rows: Sequence[PoseRow]) -> list[tuple[PoseRow, Pose]]:
    return [(row, row.pose) for row in rows if row.pose is not None]


def write_geojson(path: Path, rows: Sequence[PoseRow], crs: str) -> None:
    """Write GeoJSON (RFC 7946), a feature per epoch: a point in WGS 84 with the map's height where it is localized."""
    features = []
    lonlats = iter(to_wgs84(crs, [(pose.x, pose.y) for _, pose in _localized(rows)]))
    for row in rows:
        geometry = None
        if row.pose is not None:
            lonlat = [round(degrees, 9) for degrees in next(lonlats)]
            geometry = {"type": "Point", "coordinates": [*lonlat, round(row.pose.z, 4)]}
        features.append({"type": "Feature", "geometry": geometry, "properties": properties(row)})
    content = {"type": "FeatureCollection", "crs_of_xyz": crs, "features": features}
    with atomic_file(path) as partial:
        _put(partial, json.dumps(content, allow_nan=False))


def write_geopackage(path: Path, rows: Sequence[PoseRow], crs: str) -> None:
    """Write a layer `poses` of points with height, in the CRS; epochs that are not localized have no point.

    Those that are have a line from the prior in the layer `priors`, and the ellipse of 95 % in `ellipses`, as large as
    it is.
    """
    with needs_extra("pyogrio", "to write a GeoPackage", "export"):
        from pyogrio.raw import write
    points = [None if row.pose is None else _shape(ISO_POINT_Z, row.pose.position) for row in rows]
    layers: dict[str, tuple[str, Sequence[PoseRow], Sequence[bytes | None]]] = {"poses": ("Point Z", rows, points)}
    lines: list[tuple[PoseRow, bytes]] = []
    ellipses: list[tuple[PoseRow, bytes]] = []
    for row, pose in _localized(rows):
        numbers, place = row.numbers, pose.position[:2]
        if "shift_x" in numbers and "shift_y" in numbers:
            lines.append((row, _shape(LINE, [place - [numbers["shift_x"], numbers["shift_y"]], place])))
        if "cov_x_x" in numbers:
            root = np.linalg.cholesky(covariance_of(row)[:2, :2] + TINY * np.eye(2))
            ellipses.append((row, _shape(POLYGON, [CIRCLE_95 @ root.T + place])))
    for name, kind, drawn in (("priors", "LineString", lines), ("ellipses", "Polygon", ellipses)):
        if drawn:
            layers[name] = (kind, [row for row, _ in drawn], [shape for _, shape in drawn])
    with atomic_file(path) as partial:
        made = partial.with_suffix(".gpkg")  # GDAL minds the suffix, where a link leads to another one
        try:
            for layer, (kind, of_layer, shapes) in layers.items():
                table = [properties(row) for row in of_layer]
                columns = [_column([row[name] for row in table]) for name in table[0]]
                write(
                    made, np.array(shapes, dtype=object), columns, list(table[0]), layer=layer,
                    driver="GPKG", geometry_type=kind, crs=metric_crs(crs), append=layer != "poses",
                )  # fmt: skip
        except RuntimeError as error:  # of which all of pyogrio's errors are
            said = str(error).splitlines()[0][:120]
            said = "an error of its database" if "failed: " in str(error) else said  # else SQL and its consequences
            raise FileError(f"Expected GDAL to write {path}, got: {said}. Is the disk full?") from error
        made.replace(partial)


def _shape(kind: int, values: ArrayLike) -> bytes:
    """Well-known binary of a point (k,), a line (n, k) or a polygon of one ring (1, n, k)."""
    numbers = np.asarray(values, np.float64)
    return struct.pack(f"<BI{numbers.ndim - 1}I", 1, kind, *numbers.shape[:-1]) + numbers.astype("<f8").tobytes()


def _column(values: list[float | str | None]) -> NDArray[np.generic]:
    if any(isinstance(value, str) for value in values):
        return np.array(["" if value is None else value for value in values], dtype=object)
    return np.array(values, dtype=np.float64)  # None is NaN


def write_kml(path: Path, rows: Sequence[PoseRow], crs: str) -> None:
    """Write KML: the way as a line, each localized epoch as a point, on the ground: KML counts heights from the sea."""

    def add(parent: ElementTree.Element, **texts: str) -> ElementTree.Element:
        for name, text in texts.items():
            ElementTree.SubElement(parent, name).text = text
        return parent

    root = ElementTree.Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = add(ElementTree.SubElement(root, "Document"), name="maxcon")
    found = _localized(rows)
    lonlats = to_wgs84(crs, [(pose.x, pose.y) for _, pose in found])
    positions = [f"{x:.9f},{y:.9f},{pose.z:.3f}" for (x, y), (_, pose) in zip(lonlats, found, strict=True)]
    way = add(ElementTree.SubElement(document, "Placemark"), name="way")
    line = ElementTree.SubElement(way, "LineString")
    add(line, tessellate="1", altitudeMode=ON_THE_GROUND, coordinates=" ".join(positions))
    for (row, pose), position in zip(found, positions, strict=True):
        words = f"{row.status}, bearing {bearing_deg(pose):.2f} degrees. {row.reason}".strip()
        mark = add(ElementTree.SubElement(document, "Placemark"), name=f"{row.time:.3f}", description=words)
        add(ElementTree.SubElement(mark, "Point"), altitudeMode=ON_THE_GROUND, coordinates=position)
    with atomic_file(path) as partial:
        ElementTree.ElementTree(root).write(partial, encoding="utf-8", xml_declaration=True)


def write_degrees(path: Path, rows: Sequence[PoseRow], crs: str | None = None) -> None:
    """Write CSV of every epoch: time (s), position (m), angles (degrees) and all else; `read_trajectory` reads it."""
    with atomic_file(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(properties(rows[0]))
        for row in rows:
            writer.writerow("" if value is None else _text(name, value) for name, value in properties(row).items())


def _text(name: str, value: float | str) -> str:
    if isinstance(value, str):
        return value
    decimals = {"time": 9, "x": 4, "y": 4, "z": 4}.get(name, 7 if name.endswith("_deg") else None)
    return f"{value:.6g}" if decimals is None else f"{value:.{decimals}f}"


def write_tum_rows(path: Path, rows: Sequence[PoseRow], crs: str | None = None) -> None:
    """Write the localized poses as lines `time x y z qx qy qz qw`, s and m."""
    times, poses = zip(*[(row.time, pose) for row, pose in _localized(rows)], strict=True)
    write_tum(path, Trajectory.from_poses(times, poses), "T_map_sensor, localized by maxcon")


def times_beside(path: Path) -> Path:
    """Return the file of the times of poses in KITTI's format."""
    return path.with_suffix(".times.txt")


def write_kitti(path: Path, rows: Sequence[PoseRow], crs: str | None = None) -> None:
    """Write the localized poses as [R t], row by row, in global coordinates, a line each; their times beside it."""
    found, times = _localized(rows), times_beside(path)
    matrices = [np.column_stack([pose.rotation, pose.position]).ravel().tolist() for _, pose in found]
    with atomic_file(times) as times_partial, atomic_file(path) as poses_partial:
        _put(poses_partial, "\n".join(" ".join(f"{value:.12g}" for value in matrix) for matrix in matrices))
        _put(times_partial, "\n".join(f"{row.time:.9f}" for row, _ in found))
        times.unlink(missing_ok=True)  # a kill from here on leaves poses without times, not with those of others


def _put(path: Path, text: str) -> None:
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


WRITERS: dict[str, Callable[[Path, list[PoseRow], Any], None]] = {
    ".geojson": write_geojson, ".gpkg": write_geopackage, ".kml": write_kml,
    ".csv": write_degrees, ".tum": write_tum_rows, ".kitti": write_kitti,
}  # fmt: skip
NEEDING_CRS = (".geojson", ".gpkg", ".kml")
