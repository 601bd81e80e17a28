# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon export`."""

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["export"]


def export(
    table: Annotated[Path, typer.Argument(metavar="POSES.csv", help="Written by `maxcon localize`.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="File to write: .geojson, .gpkg (extra export), .kml, .tum, .kitti, or .csv with degrees.",
        ),
    ],
    map_folder: Annotated[
        Path | None, typer.Option("--map", metavar="MAP", help="The map the poses are in: tells the CRS.")
    ] = None,
    crs: Annotated[
        str | None, typer.Option(metavar="EPSG:N|WKT", help="CRS of the poses, where the map tells none.")
    ] = None,
) -> None:
    """Write the poses of a drive for another program; the suffix says which."""
    from maxcon.atomic import check_writable
    from maxcon.errors import OptionError
    from maxcon.export import export_poses
    from maxcon.point_map.manifest import read_manifest

    if crs is not None and map_folder is not None:
        raise OptionError("Expected either --map or --crs, got both. Leave one out.")
    if table.resolve() == out.resolve():
        raise OptionError("Expected another file to export to, got the table itself. Rename it.")
    check_writable(out)
    rows = export_poses(table, out, read_manifest(map_folder).crs if map_folder is not None else crs)
    n_localized = sum(row.pose is not None for row in rows)
    typer.echo(f"{n_localized} of {len(rows)} epochs have a pose; written to {out}")
