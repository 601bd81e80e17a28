# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon localize`."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from maxcon.cli.drive_summary import print_alternative, print_summary
from maxcon.cli.method_options import MultiplicityName, ObjectiveName, SearchName, WeightingName
from maxcon.cli.options import MaxRange, MinRange
from maxcon.cli.pictures import drawer, parse_epochs
from maxcon.cli.search_space import SpaceOptions
from maxcon.cli.table_of_poses import check_table, read_there, write_trajectory, written
from maxcon.cli.tracking import check_tracking, started_drive

__all__ = ["localize"]


def localize(
    map_folder: Annotated[Path, typer.Argument(metavar="MAP", help="Map made by `maxcon map build`.")],
    scans: Annotated[
        Path,
        typer.Argument(metavar="SCANS", help="Folder of .bin (KITTI), .pcd, .ply, .npz, .las or .laz scans."),
    ],
    prior: Annotated[
        Path, typer.Option(metavar="TUM|CSV", help="Rough poses T_map_sensor, in the CRS of the map.")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="POSES.csv", help="Table to write, a row per epoch.")
    ],
    objective: Annotated[ObjectiveName, typer.Option(help="What a cell is worth.")] = ObjectiveName.HELMERT,
    multiplicity: Annotated[
        MultiplicityName, typer.Option(help="A match weighs one, or as many as the voxel's map points.")
    ] = MultiplicityName.OCCUPIED,
    weighting: Annotated[
        WeightingName,
        typer.Option(
            help="Weight of a match: the cosine between the normals, and 1/2 where the scan point has none;"
            " as published, where it is 0 then; or one."
        ),
    ] = WeightingName.COSINE,
    thinning: Annotated[
        float,
        typer.Option(
            metavar="M",
            help="Search with one point of the scan in each cube of this edge, m; 0: all, as published.",
        ),
    ] = 0.25,
    search: Annotated[
        SearchName, typer.Option(help="How the best cell is found; it is the same one.")
    ] = SearchName.BRANCH_AND_BOUND,
    refinement: Annotated[
        bool,
        typer.Option(
            help="Adjust the pose of the best cell to the surfaces of the map, and examine it there."
        ),
    ] = True,
    wider: Annotated[
        float,
        typer.Option(metavar="M", help="Search so far around an answer that is in doubt, m; 0: never."),
    ] = 12.0,
    risk: Annotated[
        float,
        typer.Option(
            metavar="0..1", help="Errors exceed the protection level with at most this probability."
        ),
    ] = 0.01,
    half_width: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Largest offset from the prior in x and y, m. If not given: of the prior's covariances, or 12.",
        ),
    ] = None,
    heading_half_width_deg: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="Largest turn from the prior's heading, degrees; likewise, or 10."),
    ] = None,
    height_half_width: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Largest offset from the prior in z, m, searched where the ground does not tell the height; a multiple"
            " of the cell. 0 if not given: the height is the prior's there.",
        ),
    ] = None,
    sigma_position: Annotated[
        float | None,
        typer.Option(metavar="M", help="Instead: standard deviation of every prior's x, and of its y, m."),
    ] = None,
    sigma_heading_deg: Annotated[
        float | None, typer.Option(metavar="DEG", help="And of its heading, degrees.")
    ] = None,
    sigmas: Annotated[
        float | None,
        typer.Option(
            metavar="K",
            help="How many standard deviations to search, these or the prior's own; 3 if not given.",
        ),
    ] = None,
    largest_half_width: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="No search within standard deviations is wider than this, nor one that is repeated, twice as wide each"
            " time, where the answer is in doubt, m; 24 if not given.",
        ),
    ] = None,
    cell: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            help="Search in cells of this edge alone, m: the map's, or 2, 4, ... 32 times it. If neither this nor a"
            " heading step is given, coarse to fine.",
        ),
    ] = None,
    heading_step_deg: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="Step between headings, degrees; 0.5 beside --cell, if not given."),
    ] = None,
    min_range: MinRange = 1.0,
    max_range: MaxRange = 120.0,
    max_gap: Annotated[
        float, typer.Option(metavar="S", help="Largest gap in the prior to interpolate across.")
    ] = 0.5,
    least_share: Annotated[
        float,
        typer.Option(
            metavar="0..1", help="Fewer of the scan's points matched: not trusted. Lower it for thin maps."
        ),
    ] = 0.05,
    largest_runner_up: Annotated[
        float,
        typer.Option(metavar="0..1", help="A second place that scores more than this share: not trusted."),
    ] = 0.8,
    track: Annotated[
        bool,
        typer.Option(
            "--track", help="Search each scan only where the one before and the motion since allow it to be."
        ),
    ] = False,
    odometry: Annotated[
        Path | None,
        typer.Option(
            metavar="TUM|CSV",
            help="With --track: poses in any frame that tell the motion between scans; else the prior's own does.",
        ),
    ] = None,
    drift: Annotated[
        float | None,
        typer.Option(metavar="SHARE", help="Of the way, by which the odometry is off; 0.02 if not given."),
    ] = None,
    times: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Time of each scan; default times.txt there, or the names."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with POSES.csv where a call that was stopped ended.")
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace POSES.csv, if it is there.")
    ] = False,
    tum: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write the localized poses as TUM.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(metavar="DIR", help="Draw epochs into this folder.")] = None,
    plot_epochs: Annotated[
        str | None,
        typer.Option(metavar="LIST", help="Epochs to draw: 0,5,10-20 or all. Default: ten over the drive."),
    ] = None,
    threads: Annotated[int, typer.Option(min=1, help="Headings searched at once.")] = 1,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress bar.")] = False,
) -> None:
    """Localize every scan of a drive in a map; the row of each is in POSES.csv once it is done.

    Exit code 0: every epoch is localized; 1: some are not (the status column says why); 2: bad input.
    """
    from maxcon.atomic import check_folder, check_writable
    from maxcon.drive import DriveOptions
    from maxcon.integrity import Trust
    from maxcon.io.scans import open_scans
    from maxcon.io.trajectories import read_prior
    from maxcon.maximum_consensus import MaximumConsensus
    from maxcon.point_map import PointMap

    _check_options(prior, out, tum, plot, plot_epochs)
    check_tracking(track, odometry, drift)
    for path in (out, tum):
        if path is not None:
            check_writable(path)
    check_table(out, resume=resume, overwrite=overwrite, track=track)
    if plot is not None:
        check_folder(plot)
    point_map = PointMap.open(map_folder)
    folder = open_scans(scans, times)
    there = read_there(out, folder.times, resume=resume)
    prior_trajectory, left_out = read_prior(prior)
    spaces = SpaceOptions(
        cell, heading_step_deg, half_width, heading_half_width_deg, height_half_width,
        sigma_position, sigma_heading_deg, sigmas, largest_half_width,
    )  # fmt: skip
    trust = Trust(least_share, largest_runner_up)
    method = MaximumConsensus(
        spaces.fixed(), objective.objective, multiplicity.value, threads, trust, weighting.value,
        search.value.replace("-", " "), thinning, refinement, wider, risk,
    )  # fmt: skip
    windows = spaces.within_sigmas(method, prior_trajectory, max_gap, track=track)
    if track and windows is not None:
        method, windows = windows.at(float(prior_trajectory.times[0])), None
    wanted = parse_epochs(plot_epochs, len(folder)) if plot is not None else frozenset()
    draw = drawer(plot, point_map, windows or method, objective) if plot is not None else None
    options = DriveOptions(min_range, max_range, max_gap)
    with _naming(odometry or prior, scans, map_folder):
        drive = started_drive(
            point_map, folder, prior_trajectory, method, options,
            windows=windows, track=track, odometry=odometry, drift=drift, first=there.n_rows,
        )  # fmt: skip
    epochs = written(out, there, drive, len(folder), draw, wanted, quiet)
    searched = spaces.words(windows, prior_trajectory, epochs)
    print_summary(epochs, out, searched, there=there, left_out=left_out)
    if not there.n_localized:
        print_alternative(point_map, folder, epochs, windows or method, options)
    if tum is not None:
        write_trajectory(tum, out, there, epochs)
    if there.n_localized + sum(epoch.pose_global is not None for epoch in epochs) < len(folder):
        raise typer.Exit(1)


@contextmanager
def _naming(prior: Path, scans: Path, map_folder: Path) -> Iterator[None]:
    """Put the names of the files before what the library says of a prior that fits neither scans nor map."""
    from maxcon.errors import MapError, TrajectoryError

    try:
        yield
    except TrajectoryError as error:
        raise TrajectoryError(f"{prior} and {scans}: {error}") from error
    except MapError as error:
        raise MapError(f"{prior} and {map_folder}: {error}") from error


def _check_options(prior: Path, out: Path, tum: Path | None, plot: Path | None, numbers: str | None) -> None:
    """Refuse outputs that would replace each other or the prior, and options without effect."""
    from maxcon.errors import OptionError

    named = [path.resolve() for path in (prior, out, tum) if path is not None]
    if len(set(named)) < len(named):
        raise OptionError("Expected different files as --prior, --out and --tum, got one twice. Rename one.")
    if numbers is not None and plot is None:
        raise OptionError("Expected --plot DIR with --plot-epochs, got none. Name a folder for the pictures.")
