"""E57, read through pye57: all scans of a file, each in its pose, without the points that are marked invalid."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import needs_extra
from maxcon.io.clouds.base import Bounds, CloudChunk, CloudHeader, CloudReader, as_file_error
from maxcon.io.crs import read_file_crs

CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
INVALID = {CARTESIAN: "cartesianInvalidState", SPHERICAL: "sphericalInvalidState"}


class E57Reader(CloudReader):
    """Points of all scans, in the common frame of an E57 file; NaN where marked invalid. Needs the extra `e57`."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        with _opened(file) as opened:
            counts = [scan["points"].childCount() for scan in _scans(opened)]
            if not sum(counts):
                raise ValueError(f"{len(counts)} scans without any points" if counts else "no scan")
            root = opened.root
            text = root["coordinateMetadata"].value().strip() if root.isDefined("coordinateMetadata") else ""
            self.header = CloudHeader(file, sum(counts), **read_file_crs(text)._asdict())

    def _read(self, max_points: int, bounds: Bounds | None) -> Generator[CloudChunk]:
        with _opened(self.header.path) as opened:
            for number, scan in enumerate(_scans(opened)):
                if scan["points"].childCount() > 0:  # the package refuses to look into others
                    yield from _chunks(opened.image_file, scan, f"scan {number}", max_points)


@contextmanager
def _opened(file: Path) -> Iterator[Any]:
    """Yield an open file of pye57."""
    with needs_extra("pye57", f"to read {file}", "e57"):
        import pye57
    with as_file_error(file, "an E57 file"):
        opened = pye57.E57(str(file))
        try:
            yield opened
        finally:
            opened.close()


def _scans(opened: Any) -> list[Any]:
    return [opened.data3d[number] for number in range(opened.scan_count)]


def _chunks(image_file: Any, scan: Any, label: str, max_points: int) -> Generator[CloudChunk]:
    """Yield the points of a scan, never more than `max_points` at a time."""
    from pye57 import libe57
    from pye57.utils import convert_spherical_to_cartesian

    points = scan["points"]
    n_left = points.childCount()
    prototype = libe57.StructureNode(points.prototype())
    kind = next((names for names in (CARTESIAN, SPHERICAL) if all(map(prototype.isDefined, names))), None)
    if kind is None:
        raise ValueError(f"neither cartesian nor spherical coordinates of {label}")
    capacity = min(n_left, max_points)
    columns: dict[str, NDArray[Any]] = {name: np.empty(capacity) for name in kind}
    if prototype.isDefined(INVALID[kind]):
        columns[INVALID[kind]] = np.empty(capacity, np.int8)
    buffers = libe57.VectorSourceDestBuffer()
    for name, column in columns.items():
        buffers.append(libe57.SourceDestBuffer(image_file, name, column, capacity, True, True))
    rotation, translation = _pose(scan, label)
    reader = points.reader(buffers)
    try:
        while n_left > 0:
            n_read = reader.read()
            if n_read == 0:
                raise ValueError(f"{n_left} points fewer of {label}: truncated")
            n_left -= n_read
            own = np.stack([columns[name][:n_read] for name in kind], axis=1)
            if kind is SPHERICAL:
                own = convert_spherical_to_cartesian(own)
            if INVALID[kind] in columns:
                own[columns[INVALID[kind]][:n_read] != 0] = np.nan
            yield CloudChunk(own @ rotation.T + translation)
    finally:
        reader.close()


def _pose(scan: Any, label: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation and translation of a scan into the file's common frame; writers leave out identities."""
    from scipy.spatial.transform import Rotation

    def values(part: str, defaults: dict[str, float]) -> list[float]:
        if not scan.isDefined("pose") or not scan["pose"].isDefined(part):
            return list(defaults.values())
        node = scan["pose"][part]
        return [float(node[name].value()) if node.isDefined(name) else value for name, value in defaults.items()]

    quaternion = values("rotation", {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0})
    translation = np.array(values("translation", {"x": 0.0, "y": 0.0, "z": 0.0}))
    length = float(np.linalg.norm(quaternion))
    if not abs(length - 1.0) < 0.01 or not np.isfinite(translation).all():
        raise ValueError(f"a quaternion of length {length:.3g} and a translation of {translation.tolist()} of {label}")
    return np.asarray(Rotation.from_quat(quaternion).as_matrix(), dtype=np.float64), translation
