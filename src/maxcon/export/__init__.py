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
from maxcon.export.mcap import write_mcap
from maxcon.export.placed_scans import SCAN_SUFFIXES, write_placed_scans
from maxcon.export.rows import PoseRow, read_rows
from maxcon.export.trajectories import write_kitti, write_tum_rows
from maxcon.io.scans import Scans

__all__ = [
    "EXPORT_SUFFIXES",
    "SCAN_SUFFIXES",
    "PoseRow",
    "export_poses",
    "export_scans",
    "files_of_export",
    "read_rows",
]

_ON_EARTH = {".geojson": write_geojson, ".gpkg": write_geopackage, ".kml": write_kml}
_ANYWHERE = {".csv": write_degrees, ".tum": write_tum_rows, ".kitti": write_kitti}
_EITHER_WAY = {".mcap": write_mcap}
EXPORT_SUFFIXES = (*_ON_EARTH, *_EITHER_WAY, *_ANYWHERE)


def files_of_export(out: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Return the files that an export writes: a .kitti has its times beside it."""
    path = Path(out)
    return (path, path.with_suffix(".times.txt")) if path.suffix.lower() == ".kitti" else (path,)


def export_poses(table: str | os.PathLike[str], out: str | os.PathLike[str], crs: str | None = None) -> list[PoseRow]:
    """Write the poses of POSES.csv, or of a drive's Parquet file, for another program.

    Parameters
    ----------
    table : path
        Written by `maxcon localize`; of many drives `drive=NAME/poses.parquet`.
    out : path
        `.geojson` (WGS 84), `.gpkg` (in the CRS; needs the extra export), `.kml`, `.mcap` (poses and transforms of
        ROS 2; needs the extra recordings), `.tum`, `.kitti` (and the times beside it, `.times.txt`), or `.csv` with
        angles in degrees and compass bearings.
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
    rows = _localized_rows(table)
    if suffix in _ANYWHERE:
        _ANYWHERE[suffix](out, rows)
    elif suffix in _EITHER_WAY:
        _EITHER_WAY[suffix](out, rows, crs)
    elif crs is None:
        raise CrsError(
            f"Expected a CRS to export to {suffix}, which the table of poses does not say. Name the map (--map), or the"
            " CRS (--crs)."
        )
    else:
        _ON_EARTH[suffix](out, rows, crs)
    return rows


def export_scans(
    table: str | os.PathLike[str],
    out: str | os.PathLike[str],
    scans: Scans,
    crs: str | None,
    *,
    min_range: float = 1.0,
    max_range: float = 120.0,
) -> tuple[list[PoseRow], int]:
    """Write the scans of the localized epochs, placed in the map, as LAZ; return all rows, and how many points.

    Errors as of `write_placed_scans` and `export_poses`.
    """
    rows = _localized_rows(table)
    if crs is None:
        raise CrsError(
            "Expected a CRS for scans in the map, which the table of poses does not say. Name the map (--map), or the"
            " CRS (--crs)."
        )
    return rows, write_placed_scans(out, rows, scans, crs, min_range=min_range, max_range=max_range)


def _localized_rows(table: str | os.PathLike[str]) -> list[PoseRow]:
    """All rows of a table in which some epoch is localized."""
    rows = read_rows(table)
    if not any(row.pose is not None for row in rows):
        raise TrajectoryError(f"Expected localized epochs in {table}, got none of {len(rows)}. Nothing is exported.")
    return rows
