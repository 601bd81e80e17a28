"""Tables of poses, and maps, in the formats of other programs; the suffix says which."""

import os
from pathlib import Path

from maxcon.errors import CrsError, OptionError, TrajectoryError
from maxcon.export.points import MAP_SUFFIXES, PLACED_SUFFIXES, export_map, write_placed_scans
from maxcon.export.pose_rows import NEEDING_CRS, PARQUET, WRITERS, PoseRow, read_rows, times_beside
from maxcon.export.scene import RERUN_SUFFIX, Scene, epochs_of_rows, with_rerun, write_mcap
from maxcon.io.scans import Scans
from maxcon.map import PointMap

__all__ = [
    "EXPORT_SUFFIXES", "MAP_SUFFIXES", "PARQUET", "PLACED_SUFFIXES", "SCENE_SUFFIXES", "PoseRow", "check_suffix",
    "export_map", "export_poses", "export_scans", "files_of_export", "read_rows",
]  # fmt: skip

SCENE_SUFFIXES = (".mcap", RERUN_SUFFIX)  # of drives in a map, for viewers
EXPORT_SUFFIXES = (*WRITERS, *SCENE_SUFFIXES)


def files_of_export(out: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Return the files that an export writes: a .kitti has its times beside it."""
    path = Path(out)
    return (path, times_beside(path)) if path.suffix.lower() == ".kitti" else (path,)


def export_poses(
    table: str | os.PathLike[str], out: str | os.PathLike[str], crs: str | None = None, *,
    point_map: PointMap | None = None, scans: Scans | None = None, has_scores: bool = False,
    min_range: float = 1.0, max_range: float = 120.0,
) -> list[PoseRow]:  # fmt: skip
    """Write POSES.csv, or a drive's Parquet file, for another program, by the suffix; return all rows.

    crs: code or WKT of the coordinates, where the table does not say it. has_scores: whether .rrd shows those of cells.
    """
    path, suffix = Path(out), Path(out).suffix.lower()
    rows, crs = _rows_to_export(table, suffix, EXPORT_SUFFIXES, crs)
    if suffix in NEEDING_CRS and crs is None:
        raise CrsError(
            f"Expected a CRS for {suffix}, got none from the table, a map or --crs. Give --crs; a map without one gets"
            " its coordinates by `maxcon map georeference`."
        )
    if suffix in WRITERS:
        WRITERS[suffix](path, rows, crs)
        return rows
    first = next(row.pose for row in rows if row.pose is not None)
    scene = Scene.near(first.position, crs, point_map)
    epochs = epochs_of_rows(rows, scans, min_range, max_range, scored_in=point_map if has_scores else None)
    if suffix == RERUN_SUFFIX:
        with_rerun().write_rerun(path, scene, epochs)
    else:
        write_mcap(path, scene, rows, epochs)
    return rows


def export_scans(
    table: str | os.PathLike[str], out: str | os.PathLike[str], scans: Scans, crs: str | None, *,
    point_map: PointMap | None = None, min_range: float = 1.0, max_range: float = 120.0,
) -> tuple[list[PoseRow], int]:  # fmt: skip
    """Write the scans of the localized epochs, placed in the map, as LAZ or LAS; return rows and how many points.

    With a map, points have dimensions `matched` (0 or 1) and `distance` from its planes, m, NaN where not matched.
    """
    rows, crs = _rows_to_export(table, Path(out).suffix.lower(), PLACED_SUFFIXES, crs)
    return rows, write_placed_scans(Path(out), rows, scans, crs, point_map, min_range, max_range)


def check_suffix(suffix: str, suffixes: tuple[str, ...] = (*EXPORT_SUFFIXES, *PLACED_SUFFIXES)) -> None:
    """Refuse a suffix that is none of some: OptionError."""
    if suffix not in suffixes:
        raise OptionError(
            f"Expected a file to export to with suffix {', '.join(EXPORT_SUFFIXES)}, or for scans"
            f" {' or '.join(PLACED_SUFFIXES)}, got {suffix!r}. Rename it."
        )


def _rows_to_export(
    table: str | os.PathLike[str], suffix: str, suffixes: tuple[str, ...], crs: str | None
) -> tuple[list[PoseRow], str | None]:
    """All rows of a table in which some epoch is localized, and their CRS: the one given, or the code in the table."""
    check_suffix(suffix, suffixes)
    rows = read_rows(table)
    if not any(row.pose is not None for row in rows):
        raise TrajectoryError(f"Expected localized epochs in {table}, got none of {len(rows)}. Nothing is exported.")
    return rows, crs or next((row.crs for row in rows if ":" in row.crs), None)
