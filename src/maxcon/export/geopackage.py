# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""GeoPackage, in the CRS of the map, through pyogrio."""

import os
import struct
from collections.abc import Sequence

import numpy as np

from maxcon._system.atomic import atomic_file
from maxcon.errors import FileError, MissingExtraError
from maxcon.export.rows import PoseRow, properties
from maxcon.geometry import Pose
from maxcon.io.crs import metric_crs

__all__ = ["write_geopackage"]

LAYER = "poses"
POINT_Z = 1001
"""Of well-known binary, ISO."""


def write_geopackage(path: str | os.PathLike[str], rows: Sequence[PoseRow], crs: str) -> None:
    """Write a layer `poses` of points with height, in the CRS; epochs that are not localized have no point.

    Raises
    ------
    MissingExtraError
        If pyogrio is not installed.
    FileError
        If it cannot write the file.
    """
    try:
        from pyogrio.raw import write
    except ImportError as error:
        raise MissingExtraError(
            "Expected the package pyogrio to write a GeoPackage, got none installed. pip install 'maxcon[export]'"
        ) from error
    wkt = metric_crs(crs)
    points = np.array([None if row.pose is None else _point(row.pose) for row in rows], dtype=object)
    table = [properties(row) for row in rows]
    names = list(table[0])
    columns = [_column([row[name] for row in table]) for name in names]
    with atomic_file(path) as partial:
        made = partial.with_suffix(".gpkg")  # GDAL minds the suffix, where a link leads to another one
        try:
            write(
                made, points, columns, names,
                layer=LAYER, driver="GPKG", geometry_type="Point Z", crs=wkt,
            )  # fmt: skip
        except RuntimeError as error:  # of which all of pyogrio's errors are
            raise FileError(f"Expected GDAL to write {path}, got: {str(error).splitlines()[0][:120]}.") from error
        made.replace(partial)


def _point(pose: Pose) -> bytes:
    return struct.pack("<BI3d", 1, POINT_Z, pose.x, pose.y, pose.z)


def _column(values: list[float | str | None]) -> "np.ndarray[tuple[int], np.dtype[np.generic]]":
    if any(isinstance(value, str) for value in values):
        return np.array(["" if value is None else value for value in values], dtype=object)
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
