# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon relocalize`."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maxcon.cli.drive_inputs import check_outputs
from maxcon.cli.drive_summary import is_whole, print_summary
from maxcon.cli.flags import flags
from maxcon.cli.options import AtStamp, Quiet, RangeOptions, Risk, TableOptions, Times, Topic
from maxcon.cli.poses_csv import check_table, read_there, write_trajectory, written
from maxcon.errors import OptionError

if TYPE_CHECKING:
    from maxcon.drive.localize import EpochEstimate
    from maxcon.map import PointMap

__all__ = ["relocalize"]


@flags
def relocalize(
    *,
    map_folder: Annotated[Path, typer.Argument(metavar="MAP", help="Map made by `maxcon map build`, with ground.")],
    scans: Annotated[
        Path, typer.Argument(metavar="SCANS", help="Folder of scans, or a recording, as of `maxcon localize`.")
    ],
    ranges: RangeOptions,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="POSES.csv",
            help="Table to write, a row per epoch; if not given, a line is printed for each.",
            rich_help_panel="Output",
        ),
    ] = None,
    around: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y",
            help="Look in a circle around this place alone, m, in the CRS of the map.",
            rich_help_panel="Search space",
        ),
    ] = None,
    radius: Annotated[
        float | None,
        typer.Option(metavar="M", help="Of that circle, m; 300 if not given.", rich_help_panel="Search space"),
    ] = None,
    least_share: Annotated[
        float,
        typer.Option(
            metavar="0..1", help="Fewer of the scan's points matched: not trusted.", rich_help_panel="Certainty"
        ),
    ] = 0.1,
    largest_runner_up: Annotated[
        float,
        typer.Option(
            metavar="0..1",
            help="Another place that scores more than this share: ambiguous.",
            rich_help_panel="Certainty",
        ),
    ] = 0.8,
    risk: Risk = 0.01,
    topic: Topic = None,
    at_stamp: AtStamp = False,
    times: Times = None,
    table: TableOptions,
    threads: Annotated[
        int,
        typer.Option(
            min=1, help="Headings searched at once; the answers do not depend on it.", rich_help_panel="How it is done"
        ),
    ] = 1,
    quiet: Quiet = False,
) -> None:
    """Find scans in a map without any prior: at any place of it, or in a circle, and at any heading.

    Exit code 0: every epoch is localized; 1: some are not (the status column says why); 2: bad input.
    """
    from maxcon.drive.localize import DriveOptions, relocalize_drive
    from maxcon.integrity import Trust
    from maxcon.io.scans import open_scans
    from maxcon.map import PointMap
    from maxcon.relocalization import Relocalizer

    _check(out, around, radius, table)
    trust, options = Trust(least_share, largest_runner_up), DriveOptions(ranges.min_range, ranges.max_range)
    point_map = PointMap.open(map_folder)
    middle = None if around is None else _local(point_map, around)
    relocalizer = Relocalizer(
        point_map, middle, 300.0 if radius is None else radius, n_threads=threads, trust=trust, risk=risk
    )
    opened = open_scans(scans, times, topic=topic, at_stamp=at_stamp)
    if out is None:
        epochs = list(_printed(relocalize_drive(opened, relocalizer, options)))
        n_found = sum(epoch.pose_global is not None for epoch in epochs)
        if n_found < len(epochs):
            raise typer.Exit(1)
        return
    there = read_there(out, opened.times, resume=table.resume)
    drive = relocalize_drive(opened, relocalizer, options, first=there.n_rows)
    epochs = written(out, there, drive, len(opened), None, frozenset(), quiet)
    area = relocalizer.area
    where = "the whole map" if area is None else f"{area.radius:g} m around {around}"
    searched = f"searched without a prior: {where}, {relocalizer.n_cells:,} large cells"
    print_summary(epochs, out, searched, there=there, left_out=())
    if table.tum is not None:
        write_trajectory(table.tum, out, there, epochs)
    if not is_whole(epochs, there, len(opened), track=False):
        raise typer.Exit(1)


def _check(out: Path | None, around: str | None, radius: float | None, table: TableOptions) -> None:
    """Refuse options without effect, and outputs that cannot be written."""
    if radius is not None and around is None:
        raise OptionError("Expected --radius together with --around X,Y, got it alone. Add the middle of the circle.")
    if out is None:
        for name, is_given in (("--resume", table.resume), ("--overwrite", table.overwrite), ("--tum", table.tum)):
            if is_given:
                raise OptionError(
                    f"Expected {name} together with --out, got it alone. Add -o POSES.csv, or leave it out."
                )
        return
    check_outputs(None, out, table.tum, None, None)
    check_table(out, resume=table.resume, overwrite=table.overwrite, track=False)


def _local(point_map: "PointMap", around: str) -> tuple[float, float]:
    """The middle of the circle, local frame, m."""
    try:
        x, y = (float(word) for word in around.split(","))
    except ValueError:
        x, y = math.nan, math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise OptionError(
            f"Expected --around X,Y, two coordinates in m in the CRS of the map, got {around!r}. Write them as"
            " --around 549980,5801820."
        )
    east, north, _ = point_map.frame.to_local([[x, y, 0.0]])[0].tolist()
    return east, north


def _printed(drive: "Iterator[EpochEstimate]") -> "Iterator[EpochEstimate]":
    """Print a line for each epoch once it is done."""
    for epoch in drive:
        pose = epoch.pose_global
        words = epoch.reason
        if pose is not None:
            words = f"x {pose.x:.3f} y {pose.y:.3f} z {pose.z:.3f} m, heading {math.degrees(pose.heading):.2f} degrees"
        typer.echo(f"{epoch.raw.name}: {epoch.status.value}{'; ' if words else ''}{words}")
        yield epoch.without_points()
