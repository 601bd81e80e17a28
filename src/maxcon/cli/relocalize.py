# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon relocalize`."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maxcon.cli.drive_output import check_outputs, is_whole, print_summary, write_trajectory, written
from maxcon.cli.flags import OptionGroup, argument, flag, flags
from maxcon.cli.options import AtStamp, Quiet, RangeOptions, Risk, TableOptions, Times, Topic
from maxcon.errors import OptionError

if TYPE_CHECKING:
    from maxcon.drive.localize import EpochEstimate
    from maxcon.map import PointMap


class ScanFiles(OptionGroup, title="Recordings and scanners"):
    """The map and the scans, and how these are read."""

    map_folder: Path = argument(..., "Map made by `maxcon map build`, with ground.", "MAP")
    scans: Path = argument(..., "Folder of scans, or a recording, as of `maxcon localize`.", "SCANS")
    out: Path | None = flag(
        None,
        "Table to write, a row per epoch; if not given, a line is printed for each.",
        "--out", "-o", metavar="POSES.csv", rich_help_panel="Output",
    )  # fmt: skip
    topic: Topic = None
    at_stamp: AtStamp = False
    times: Times = None


class CircleOptions(OptionGroup, title="Search space"):
    """The part of the map that is searched."""

    around: str | None = flag(
        None, "Look in a circle around this place alone, m, in the CRS of the map.", metavar="X,Y"
    )
    radius: float | None = flag(None, "Radius of that circle, m; 300 if not given.", metavar="M")

    def local_middle(self, point_map: "PointMap") -> tuple[float, float] | None:
        """Return the middle of the circle, local frame, m; None for the whole map."""
        if self.around is None:
            return None
        try:
            x, y = (float(word) for word in self.around.split(","))
        except ValueError:
            x, y = math.nan, math.nan
        if not (math.isfinite(x) and math.isfinite(y)):
            raise OptionError(
                f"Expected --around X,Y, two coordinates in m in the CRS of the map, got {self.around!r}. Write them as"
                " --around 549980,5801820."
            )
        east, north, _ = point_map.frame.to_local([[x, y, 0.0]])[0].tolist()
        return east, north


class PlaceCertainty(OptionGroup, title="Certainty"):
    """From where on an answer is not trusted."""

    least_share: float = flag(0.1, "An answer that fewer of the scan's points match is not trusted.", metavar="0..1")
    largest_runner_up: float = flag(
        0.8, "Ambiguous if the second best place scores more than this fraction of the best.", metavar="0..1"
    )
    risk: Risk = 0.01


@flags
def relocalize(
    ranges: RangeOptions,
    files: ScanFiles,
    circle: CircleOptions,
    certainty: PlaceCertainty,
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
    from maxcon.drive.poses_table import RowsThere, rows_there
    from maxcon.integrity import Trust
    from maxcon.io.scans import open_scans
    from maxcon.map import PointMap
    from maxcon.relocalization import Relocalizer

    out = files.out
    _check(out, circle, table)
    trust = Trust(certainty.least_share, certainty.largest_runner_up)
    options = DriveOptions(ranges.min_range, ranges.max_range)
    point_map = PointMap.open(files.map_folder)
    radius = 300.0 if circle.radius is None else circle.radius
    middle = circle.local_middle(point_map)
    relocalizer = Relocalizer(point_map, middle, radius, n_threads=threads, trust=trust, risk=certainty.risk)
    opened = open_scans(files.scans, files.times, topic=files.topic, at_stamp=files.at_stamp)
    there = rows_there(out, opened.times) if out is not None and table.resume else RowsThere()
    drive = relocalize_drive(opened, relocalizer, options, first=there.n_rows)
    if out is None:
        epochs = list(_printed(drive))
    else:
        epochs = written(out, there, drive, len(opened), quiet)
        where = "the whole map" if circle.around is None else f"{radius:g} m around {circle.around}"
        searched = f"searched without a prior: {where}, {relocalizer.n_cells:,} large cells"
        print_summary(epochs, out, searched, there=there)
        if table.tum is not None:
            write_trajectory(table.tum, out, there, epochs)
    if not is_whole(epochs, there, len(opened)):
        raise typer.Exit(1)


def _check(out: Path | None, circle: CircleOptions, table: TableOptions) -> None:
    """Refuse options without effect, and outputs that cannot be written."""
    if circle.radius is not None and circle.around is None:
        raise OptionError("Expected --radius together with --around X,Y, got it alone. Add the middle of the circle.")
    if out is not None:
        check_outputs(out, table)
        return
    for name, is_given in (("--resume", table.resume), ("--overwrite", table.overwrite), ("--tum", table.tum)):
        if is_given:
            raise OptionError(f"Expected {name} together with --out, got it alone. Add -o POSES.csv, or leave it out.")


def _printed(drive: "Iterator[EpochEstimate]") -> "Iterator[EpochEstimate]":
    """Print a line for each epoch once it is done."""
    for epoch in drive:
        pose = epoch.pose_global
        words = epoch.reason
        if pose is not None:
            words = f"x {pose.x:.3f} y {pose.y:.3f} z {pose.z:.3f} m, heading {math.degrees(pose.heading):.2f} degrees"
        typer.echo(f"{epoch.raw.name}: {epoch.status.value}{'; ' if words else ''}{words}")
        yield epoch.without_points()
