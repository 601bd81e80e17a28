# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Poses as GeoJSON, GeoPackage, KML, CSV in degrees, TUM and KITTI."""

import csv
import json
import math
import struct
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon._system.atomic import atomic_file
from maxcon.errors import FileError, needs_extra
from maxcon.export.pose_rows import PoseRow, bearing_deg, covariance_of, properties
from maxcon.geometry import Pose
from maxcon.io.crs import metric_crs, to_wgs84
from maxcon.io.trajectories import write_tum
from maxcon.scan.trajectory import Trajectory

ISO_POINT_Z, LINE, POLYGON = 1001, 2, 3  # kinds of geometry in well-known binary
TURNS = np.linspace(0.0, 2.0 * np.pi, 65)
CIRCLE_95 = math.sqrt(-2.0 * math.log(0.05)) * np.column_stack([np.cos(TURNS), np.sin(TURNS)])
TINY = 1e-12  # m^2: tables round covariances
ON_THE_GROUND = "clampToGround"


def _localized(rows: Sequence[PoseRow]) -> list[tuple[PoseRow, Pose]]:
    return [(row, row.pose) for row in rows if row.pose is not None]


def write_geojson(path: Path, rows: Sequence[PoseRow], crs: str) -> None:
    """Write GeoJSON (RFC 7946), a feature per epoch: a point in WGS 84 where it is localized, else no geometry.

    Position and covariance in the CRS of the map stand among the properties, as does the CRS. The height of a point is
    that of the map, m, whatever it is counted from.
    """
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
            said = str(error).splitlines()[0].rpartition("failed: ")[2][:120]  # before it stands the whole SQL
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
    """Write KML: the way as a line and each localized epoch as a point with its heading.

    Heights are those of the map, and viewers are told to draw on the ground: KML counts heights from the sea, and a
    map's CRS mostly does not say what its are counted from.
    """

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
    """Write CSV of every epoch: time (s), position (m), angles (degrees) and all else; `read_trajectory` reads it, too.

    Here and in the formats below the CRS is not used.
    """
    with atomic_file(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        for number, row in enumerate(rows):
            cells = properties(row)
            if number == 0:
                writer.writerow(cells)
            writer.writerow("" if value is None else _text(name, value) for name, value in cells.items())


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
    """Write the localized poses as the twelve numbers of [R t], row by row, a line each; their times beside it.

    T_map_sensor, in global coordinates: the first pose is not the origin, as in KITTI's own.
    """
    found, times = _localized(rows), times_beside(path)
    matrices = [np.column_stack([pose.rotation, pose.position]).ravel().tolist() for _, pose in found]
    with atomic_file(times) as times_partial, atomic_file(path) as poses_partial:
        _put(poses_partial, "\n".join(" ".join(f"{value:.12g}" for value in matrix) for matrix in matrices))
        _put(times_partial, "\n".join(f"{row.time:.9f}" for row, _ in found))
        times.unlink(missing_ok=True)  # a kill from here on leaves poses without times, not with those of others


def _put(path: Path, text: str) -> None:
    path.write_text(text + "\n", encoding="utf-8", newline="\n")
