# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""E57, read through pye57: all scans of a file, each in its pose, without the points that are marked invalid."""

from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError, MissingExtraError
from maxcon.io.clouds.base import CloudChunk, CloudHeader, CloudReader, as_file_error

__all__ = ["E57Reader"]

KIND = "an E57 file"
CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
INVALID = {CARTESIAN: "cartesianInvalidState", SPHERICAL: "sphericalInvalidState"}


class E57Reader(CloudReader):
    """Points of all scans of an E57 file, in the file's common frame.

    Points that are marked invalid (`cartesianInvalidState`, `sphericalInvalidState`) have NaN for coordinates.

    Parameters
    ----------
    file : Path
        An existing file.

    Raises
    ------
    FileError
        If it is no E57 file, or holds no points.
    MissingExtraError
        If the extra `e57` is not installed.
    """

    def __init__(self, file: Path) -> None:
        super().__init__()
        with as_file_error(file, KIND):
            opened = _package(file).E57(str(file))
            try:
                counts = [_points(scan).childCount() for scan in _scans(opened)]
                crs, fault = _crs(opened)
            finally:
                opened.close()
        if not sum(counts):
            got = f"{len(counts)} scans without any" if counts else "no scan"
            raise FileError(f"Expected points in {file}, got {got}. Leave this file out.")
        self.header = CloudHeader(path=file, n_points=sum(counts), crs=crs, crs_fault=fault)

    def _read(self, max_points: int) -> Generator[CloudChunk]:
        file = self.header.path
        with as_file_error(file, KIND):
            opened = _package(file).E57(str(file))
            try:
                for number, scan in enumerate(_scans(opened)):
                    yield from _chunks(file, opened, scan, number, max_points)
            finally:
                opened.close()


def _package(file: Path) -> Any:
    try:
        import pye57
    except ImportError as error:
        raise MissingExtraError(
            f"Expected the package pye57 to read {file}, got none installed. pip install 'maxcon[e57]'"
        ) from error
    return pye57


def _scans(opened: Any) -> list[Any]:
    return [opened.data3d[number] for number in range(opened.scan_count)]


def _points(scan: Any) -> Any:
    return scan["points"]


def _crs(opened: Any) -> tuple[str | None, str]:
    """Return the CRS as WKT, or None, and what the file has instead of one."""
    import pyproj

    root = opened.root
    text = root["coordinateMetadata"].value().strip() if root.isDefined("coordinateMetadata") else ""
    if not text:
        return None, ""
    try:
        return pyproj.CRS.from_wkt(text).to_wkt(), ""
    except pyproj.exceptions.CRSError as error:
        return None, f"a WKT that it does not: {str(error).splitlines()[0][:120]}"


def _chunks(file: Path, opened: Any, scan: Any, number: int, max_points: int) -> Generator[CloudChunk]:
    """Yield the points of a scan, never more than `max_points` at a time."""
    from pye57 import libe57

    points = _points(scan)
    n_left = points.childCount()
    if n_left == 0:  # the package refuses to look into these
        return
    prototype = libe57.StructureNode(points.prototype())
    kind = next((names for names in (CARTESIAN, SPHERICAL) if all(map(prototype.isDefined, names))), None)
    if kind is None:
        raise FileError(
            f"Expected cartesian or spherical coordinates of scan {number} in {file}, got neither. Export it again."
        )
    capacity = min(n_left, max_points)
    names = [*kind, *([INVALID[kind]] if prototype.isDefined(INVALID[kind]) else [])]
    columns = {name: np.empty(capacity, np.int8 if name == INVALID[kind] else np.float64) for name in names}
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in columns.items():
        buffers.append(libe57.SourceDestBuffer(opened.image_file, name, column, capacity, True, True))
    rotation, translation = _pose(file, scan, number)
    reader = points.reader(buffers)
    try:
        while n_left > 0:
            n_read = reader.read()
            if n_read == 0:
                raise FileError(f"Expected {n_left} more points of scan {number} in {file}, got none: truncated.")
            n_left -= n_read
            own = np.stack([columns[name][:n_read] for name in kind], axis=1)
            if kind is SPHERICAL:
                own = _cartesian(own)
            if len(names) > len(kind):
                own[columns[names[-1]][:n_read] != 0] = np.nan
            yield CloudChunk(own @ rotation.T + translation)
    finally:
        reader.close()


def _cartesian(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return x, y, z of range (m), azimuth and elevation (rad)."""
    distance, azimuth, elevation = values.T
    level = distance * np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)], axis=1)


def _pose(file: Path, scan: Any, number: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation and translation of a scan into the file's common frame; writers leave out identities."""
    w, x, y, z = _values(scan, "rotation", {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0})
    translation = np.array(_values(scan, "translation", {"x": 0.0, "y": 0.0, "z": 0.0}))
    length = float(np.sqrt(w * w + x * x + y * y + z * z))
    if not abs(length - 1.0) < 0.01 or not np.isfinite(translation).all():
        raise FileError(
            f"Expected a pose of scan {number} in {file}, got a quaternion of length {length:.3g} and a translation of"
            f" {translation.tolist()}. Export it again."
        )
    w, x, y, z = (value / length for value in (w, x, y, z))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return rotation, translation


def _values(scan: Any, part: str, defaults: dict[str, float]) -> list[float]:
    if not scan.isDefined("pose") or not scan["pose"].isDefined(part):
        return list(defaults.values())
    node = scan["pose"][part]
    return [float(node[name].value()) if node.isDefined(name) else value for name, value in defaults.items()]
