# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Tables of poses in the formats of other programs; the suffix says which (decision 25)."""

import os
from pathlib import Path

from maxcon.errors import CrsError, OptionError, TrajectoryError
from maxcon.export.degrees import write_degrees
from maxcon.export.geojson import write_geojson
from maxcon.export.geopackage import write_geopackage
from maxcon.export.kml import write_kml
from maxcon.export.rows import PoseRow, read_rows
from maxcon.export.trajectories import write_kitti, write_tum_rows

__all__ = ["EXPORT_SUFFIXES", "PoseRow", "export_poses", "read_rows"]

_ON_EARTH = {".geojson": write_geojson, ".gpkg": write_geopackage, ".kml": write_kml}
_ANYWHERE = {".csv": write_degrees, ".tum": write_tum_rows, ".kitti": write_kitti}
EXPORT_SUFFIXES = (*_ON_EARTH, *_ANYWHERE)


def export_poses(
    table: str | os.PathLike[str], out: str | os.PathLike[str], crs: str | None = None
) -> list[PoseRow]:
    """Write the poses of POSES.csv for another program.

    Parameters
    ----------
    table : path
        Written by `maxcon localize`.
    out : path
        `.geojson` (WGS 84), `.gpkg` (in the CRS; needs the extra export), `.kml`, `.tum`, `.kitti` (and the times
        beside it, `.times.txt`), or `.csv` with angles in degrees and compass bearings.
    crs : str, optional
        Code or WKT of the coordinates, which the table does not say: that of the map.

    Returns
    -------
    list of PoseRow
        All rows, localized or not.

    Raises
    ------
    OptionError
        If the suffix is none of these.
    CrsError
        If one is needed and not given, or not known.
    FileError, TrajectoryError
        If the table cannot be read, has no pose, or `out` cannot be written.
    MissingExtraError
        If it is `.gpkg` and pyogrio is not installed.
    """
    suffix = Path(out).suffix.lower()
    if suffix not in EXPORT_SUFFIXES:
        raise OptionError(
            f"Expected a file to export to with suffix {', '.join(EXPORT_SUFFIXES)}, got {os.fspath(out)!r}. Rename it."
        )
    rows = read_rows(table)
    if not any(row.pose is not None for row in rows):
        raise TrajectoryError(
            f"Expected localized epochs in {table}, got none of {len(rows)}. Nothing is exported."
        )
    if suffix in _ANYWHERE:
        _ANYWHERE[suffix](out, rows)
    elif crs is None:
        raise CrsError(
            f"Expected a CRS to export to {suffix}, which the table of poses does not say. Name the map (--map), or the"
            " CRS (--crs)."
        )
    else:
        _ON_EARTH[suffix](out, rows, crs)
    return rows
