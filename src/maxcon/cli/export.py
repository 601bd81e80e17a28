"""`maxcon export`."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from maxcon.cli.flags import OptionGroup, argument, check_exclusive, check_needs, flag, flags
from maxcon.cli.options import AtStamp, RangeOptions, Topic
from maxcon.cli.terminal import warn
from maxcon.errors import FileError, MapError, OptionError

if TYPE_CHECKING:
    from maxcon.export import PoseRow
    from maxcon.map import PointMap


class ExportOptions(OptionGroup):
    """What is exported, and to where.

    out: File to write: .geojson, .gpkg (extra export), .kml, .mcap (extra recordings), .rrd (extra view), .tum, .kitti,
        or .csv with degrees; with --scans .laz or .las.
    map_folder: The map the poses are in: tells the CRS; .mcap and .rrd show it, and points in .laz and .las have their
        distance from it.
    scans: The scans of the drive, placed in the map: all points as LAZ, thinned in .mcap, .rrd.
    """

    table: Path = argument(..., "POSES.csv, or the folder of many drives, as `maxcon localize` writes them.", "POSES")
    out: Path = flag(..., None, "--out", "-o", metavar="FILE")
    drive: str | None = flag(None, "Which drive of the folder; the only one if not given.", metavar="NAME")
    map_folder: Path | None = flag(None, None, "--map", metavar="MAP")
    crs: str | None = flag(None, "CRS of the poses, where the map tells none.", metavar="EPSG:N|WKT")
    scans: Path | None = flag(None, metavar="SCANS")
    scores: bool = flag(False, "With --map and --scans, in .rrd: show the scores of the cells around each prior.")
    topic: Topic = None
    times: Path | None = flag(None, "Time of each scan, as for `maxcon localize`.", metavar="FILE")
    at_stamp: AtStamp = False
    overwrite: bool = flag(False, "Replace the file, if it is there.")


@flags
def export(what: ExportOptions, ranges: RangeOptions) -> None:
    """Write the poses of a drive for another program, or its scans where they are in the map; the suffix says which."""
    from maxcon.drive.poses_table import table_of_drive
    from maxcon.export import PLACED_SUFFIXES, SCENE_SUFFIXES, check_suffix, export_poses, export_scans, read_rows
    from maxcon.export.scene import RERUN_SUFFIX
    from maxcon.io.crs import GeographicFrame
    from maxcon.io.scans import open_scans

    out, crs, suffix = what.out, what.crs, what.out.suffix.lower()
    check_suffix(suffix)
    check_exclusive({"--map": what.map_folder}, {"--crs": crs})
    for name, value in (("--map", what.map_folder), ("--scans", what.scans), (RERUN_SUFFIX, suffix == RERUN_SUFFIX)):
        check_needs({"--scores": what.scores}, {name: value})
    check_needs({"--drive": what.drive}, {"a folder of many drives": what.table.is_dir()})
    table = table_of_drive(what.table, what.drive) if what.table.is_dir() else what.table
    if what.scans is None and suffix in PLACED_SUFFIXES:
        raise OptionError(f"Expected --scans for {out}, got none. Name the scans of the drive.")
    if what.scans is not None and suffix not in (*PLACED_SUFFIXES, *SCENE_SUFFIXES):
        wanted = " or ".join((*PLACED_SUFFIXES, *SCENE_SUFFIXES))
        raise OptionError(f"Expected a {wanted} file with --scans, got {out}. Rename it, or name no scans.")
    check_out(table, out, overwrite=what.overwrite)
    point_map = None if what.map_folder is None else _map_of(what.map_folder, table, read_rows(table))
    crs = crs if point_map is None else point_map.frame.crs
    scans, points = None, ""
    if what.scans is not None:
        scans = open_scans(what.scans, what.times, topic=what.topic, at_stamp=what.at_stamp)
    if scans is not None and suffix in PLACED_SUFFIXES:
        rows, n_points = export_scans(table, out, scans, crs, point_map=point_map, **vars(ranges))
        points = f", {n_points:,} points"
    else:
        rows = export_poses(table, out, crs, point_map=point_map, scans=scans, has_scores=what.scores, **vars(ranges))
    n_localized = sum(row.pose is not None for row in rows)
    typer.echo(f"{n_localized} of {len(rows)} epochs have a pose{points}; written to {out}")
    if crs is not None and suffix in (".geojson", ".kml", ".mcap"):
        frame = GeographicFrame(crs)
        frame.to_geographic(next(row.pose.position[None] for row in rows if row.pose is not None))
        if frame.operation is not None and not frame.operation.is_exact:
            warn(f"warning: longitudes and latitudes {frame.operation.words}")


def check_out(source: Path, out: Path, *, overwrite: bool) -> None:
    """Refuse a file that cannot be written, that is there, or that is what is exported."""
    from maxcon._system.atomic import check_writable
    from maxcon.export import files_of_export

    for path in files_of_export(out):
        if source.resolve() == path.resolve():
            raise OptionError("Expected another file to export to, got what is exported. Rename it.")
        check_writable(path)
        if path.is_file() and not overwrite:
            raise FileError(f"Expected {path} not to exist yet, but it does. Replace it (--overwrite) or name another.")


def _map_of(map_folder: Path, table: Path, rows: "list[PoseRow]") -> "PointMap":
    """The map of a table; refuses one that most of the poses lie outside of."""
    from maxcon.drive.localize import MAP_MARGIN
    from maxcon.map import PointMap

    point_map = PointMap.open(map_folder)
    local = [point_map.frame.pose_to_local(row.pose) for row in rows if row.pose is not None]
    n_outside = sum(not point_map.covers(pose.x, pose.y, MAP_MARGIN) for pose in local)
    if 2 * n_outside > len(local):
        raise MapError(
            f"Expected the map in which {table} was localized, got {map_folder}, outside of which {n_outside} of its"
            f" {len(local)} poses lie. Name that map, or the CRS (--crs)."
        )
    return point_map
