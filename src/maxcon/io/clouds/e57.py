# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""E57, read through pye57: all scans of a file, each in its pose, without the points that are marked invalid."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import FileError, MissingExtraError
from maxcon.io.clouds.base import CloudChunk, CloudHeader, CloudReader, as_file_error

CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
INVALID = {CARTESIAN: "cartesianInvalidState", SPHERICAL: "sphericalInvalidState"}


class E57Reader(CloudReader):
    """Points of all scans, in the common frame of an E57 file.

    Points that are marked invalid (`cartesianInvalidState`, `sphericalInvalidState`) have NaN for coordinates.
    FileError if it is no E57 file, or holds no points; MissingExtraError if the extra `e57` is not installed.
    """

    def __init__(self, file: Path) -> None:
        super().__init__()
        with _opened(file) as opened:
            counts = [scan["points"].childCount() for scan in _scans(opened)]
            crs, fault = _crs(opened.root)
        if not sum(counts):
            got = f"{len(counts)} scans without any" if counts else "no scan"
            raise FileError(f"Expected points in {file}, got {got}. Leave this file out.")
        self.header = CloudHeader(path=file, n_points=sum(counts), crs=crs, crs_fault=fault)

    def _read(self, max_points: int) -> Generator[CloudChunk]:
        with _opened(self.header.path) as opened:
            for number, scan in enumerate(_scans(opened)):
                yield from _chunks(self.header.path, opened.image_file, scan, number, max_points)


@contextmanager
def _opened(file: Path) -> Iterator[Any]:
    """Yield an open file of pye57."""
    try:
        import pye57
    except ImportError as error:
        raise MissingExtraError(
            f"Expected the package pye57 to read {file}, got none installed. pip install 'maxcon[e57]'"
        ) from error
    with as_file_error(file, "an E57 file"):
        opened = pye57.E57(str(file))
        try:
            yield opened
        finally:
            opened.close()


def _scans(opened: Any) -> list[Any]:
    return [opened.data3d[number] for number in range(opened.scan_count)]


def _crs(root: Any) -> tuple[str | None, str]:
    """Return the CRS as WKT, or None, and what the file has instead of one."""
    import pyproj

    text = root["coordinateMetadata"].value().strip() if root.isDefined("coordinateMetadata") else ""
    if not text:
        return None, ""
    try:
        return pyproj.CRS.from_wkt(text).to_wkt(), ""
    except pyproj.exceptions.CRSError as error:
        return None, f"a WKT that it does not: {str(error).splitlines()[0][:120]}"


def _chunks(file: Path, image_file: Any, scan: Any, number: int, max_points: int) -> Generator[CloudChunk]:
    """Yield the points of a scan, never more than `max_points` at a time."""
    from pye57 import libe57

    points = scan["points"]
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
    columns: dict[str, NDArray[Any]] = {name: np.empty(capacity) for name in kind}
    if prototype.isDefined(INVALID[kind]):
        columns[INVALID[kind]] = np.empty(capacity, np.int8)
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in columns.items():
        buffers.append(libe57.SourceDestBuffer(image_file, name, column, capacity, True, True))
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
            if INVALID[kind] in columns:
                own[columns[INVALID[kind]][:n_read] != 0] = np.nan
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
    from scipy.spatial.transform import Rotation

    quaternion = _values(scan, "rotation", {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0})
    translation = np.array(_values(scan, "translation", {"x": 0.0, "y": 0.0, "z": 0.0}))
    length = float(np.linalg.norm(quaternion))
    if not abs(length - 1.0) < 0.01 or not np.isfinite(translation).all():
        raise FileError(
            f"Expected a pose of scan {number} in {file}, got a quaternion of length {length:.3g} and a translation of"
            f" {translation.tolist()}. Export it again."
        )
    return np.asarray(Rotation.from_quat(quaternion).as_matrix(), dtype=np.float64), translation


def _values(scan: Any, part: str, defaults: dict[str, float]) -> list[float]:
    if not scan.isDefined("pose") or not scan["pose"].isDefined(part):
        return list(defaults.values())
    node = scan["pose"][part]
    return [float(node[name].value()) if node.isDefined(name) else value for name, value in defaults.items()]
