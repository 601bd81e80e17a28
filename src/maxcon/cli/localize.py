# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon localize`."""

from pathlib import Path
from typing import Annotated

import typer

from maxcon.cli.drive_inputs import RecordingOptions, check_outputs
from maxcon.cli.drive_opener import DriveOpener
from maxcon.cli.drive_summary import is_whole, print_alternative, print_summary
from maxcon.cli.drives import check_one_or_many, localize_many, several_workers
from maxcon.cli.method_options import parse_objective
from maxcon.cli.options import (
    AlsoTum,
    AtStamp,
    Deskew,
    GeoidHeight,
    MaxRange,
    MinRange,
    Mounting,
    Odometry,
    OdometryFrames,
    OdometryTopic,
    OverwriteTable,
    Prior,
    PriorFrames,
    PriorTopic,
    Resume,
    Risk,
    Scheduler,
    Times,
    Topic,
    TurnTime,
    Workers,
)
from maxcon.cli.pictures import drawer, parse_epochs
from maxcon.cli.progress import warn
from maxcon.cli.search_space import SpaceOptions
from maxcon.cli.table_of_poses import check_table, read_there, write_trajectory, written
from maxcon.cli.tracking import check_tracking
from maxcon.search.options import Multiplicity, SearchMethod, Weighting

__all__ = ["localize"]


def localize(
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="POSES.csv",
            help="Table to write, a row per epoch; with --drives the folder of a Parquet dataset, which goes on.",
        ),
    ],
    map_folder: Annotated[
        Path | None, typer.Argument(metavar="MAP", help="Map made by `maxcon map build`.", show_default=False)
    ] = None,
    scans: Annotated[
        Path | None,
        typer.Argument(
            metavar="SCANS",
            help="Folder of .bin (KITTI), .pcd, .ply, .npz, .las or .laz scans; or a recording: .bag, .mcap, .db3,"
            " .pcap, or the folder of a ROS 2 bag.",
            show_default=False,
        ),
    ] = None,
    drives: Annotated[
        Path | None,
        typer.Option(
            metavar="CSV|TOML",
            help="Instead of SCANS: a table of many drives, each with its name, scans, prior, and map where that is not"
            " MAP.",
        ),
    ] = None,
    prior: Prior = None,
    objective: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="What a cell is worth: helmert, count, max-eigenvalue, or one of your own, package.module:Name.",
        ),
    ] = "helmert",
    multiplicity: Annotated[
        Multiplicity, typer.Option(help="A match weighs one, or as many as the voxel's map points.")
    ] = Multiplicity.OCCUPIED,
    weighting: Annotated[
        Weighting,
        typer.Option(
            help="Weight of a match: the cosine between the normals, and 1/2 where the scan point has none;"
            " as published, where it is 0 then; or one."
        ),
    ] = Weighting.COSINE,
    thinning: Annotated[
        float,
        typer.Option(
            metavar="M", help="Search with one point of the scan in each cube of this edge, m; 0: all, as published."
        ),
    ] = 0.25,
    search: Annotated[
        SearchMethod, typer.Option(help="How the best cell is found; it is the same one.")
    ] = SearchMethod.BRANCH_AND_BOUND,
    refinement: Annotated[
        bool, typer.Option(help="Adjust the pose of the best cell to the surfaces of the map, and examine it there.")
    ] = True,
    wider: Annotated[
        float, typer.Option(metavar="M", help="Search so far around an answer that is in doubt, m; 0: never.")
    ] = 12.0,
    risk: Risk = 0.01,
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
        float | None, typer.Option(metavar="M", help="Instead: standard deviation of every prior's x, and of its y, m.")
    ] = None,
    sigma_heading_deg: Annotated[float | None, typer.Option(metavar="DEG", help="And of its heading, degrees.")] = None,
    sigmas: Annotated[
        float | None,
        typer.Option(
            metavar="K", help="How many standard deviations to search, these or the prior's own; 3 if not given."
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
    max_gap: Annotated[float, typer.Option(metavar="S", help="Largest gap in the prior to interpolate across.")] = 0.5,
    least_share: Annotated[
        float,
        typer.Option(metavar="0..1", help="Fewer of the scan's points matched: not trusted. Lower it for thin maps."),
    ] = 0.05,
    largest_runner_up: Annotated[
        float, typer.Option(metavar="0..1", help="A second place that scores more than this share: not trusted.")
    ] = 0.8,
    track: Annotated[
        bool,
        typer.Option("--track", help="Search each scan only where the one before and the motion since allow it to be."),
    ] = False,
    odometry: Odometry = None,
    drift: Annotated[
        float | None, typer.Option(metavar="SHARE", help="Of the way, by which the odometry is off; 0.02 if not given.")
    ] = None,
    topic: Topic = None,
    prior_topic: PriorTopic = None,
    prior_frames: PriorFrames = None,
    odometry_topic: OdometryTopic = None,
    odometry_frames: OdometryFrames = None,
    geoid_height: GeoidHeight = None,
    mounting: Mounting = None,
    deskew: Deskew = False,
    turn_time: TurnTime = None,
    at_stamp: AtStamp = False,
    times: Times = None,
    resume: Resume = False,
    overwrite: OverwriteTable = False,
    tum: AlsoTum = None,
    plot: Annotated[Path | None, typer.Option(metavar="DIR", help="Draw epochs into this folder.")] = None,
    plot_epochs: Annotated[
        str | None, typer.Option(metavar="LIST", help="Epochs to draw: 0,5,10-20 or all. Default: ten over the drive.")
    ] = None,
    threads: Annotated[
        int, typer.Option(min=1, help="Epochs localized at once; of a track, headings searched at once.")
    ] = 1,
    workers: Workers = None,
    scheduler: Scheduler = None,
    known_only: Annotated[
        bool, typer.Option("--known-only", help="In an updated map: leave out what is new, too, not only what is gone.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress bar.")] = False,
) -> None:
    """Localize every scan of a drive in a map; the row of each is in POSES.csv once it is done.

    One drive is localized in this process if neither --workers nor --scheduler says otherwise.

    Exit code 0: every epoch is localized, of a track every one from its beginning on; 1: some are not (the status
    column says why); 2: bad input.
    """
    from maxcon._system.engine import Engine
    from maxcon.drive.localize import DriveOptions
    from maxcon.drive.many import DriveEntry
    from maxcon.integrity import Trust
    from maxcon.map.storage import address_of

    check_one_or_many(
        drives, map_folder, scans, out,
        {"--prior": prior, "--odometry": odometry, "--times": times, "--tum": tum, "--plot": plot,
         "--plot-epochs": plot_epochs, "--resume": resume, "--overwrite": overwrite},
    )  # fmt: skip
    is_alone = drives is None and workers is None and scheduler is None
    if scheduler is not None:  # its workers are in other folders
        map_folder, scans, prior, times, odometry, mounting = (
            path if path is None or address_of(path) else path.absolute()
            for path in (map_folder, scans, prior, times, odometry, mounting)
        )
    engine = Engine(1 if is_alone else workers, scheduler, typer.echo, warn)
    opener = DriveOpener(
        RecordingOptions(topic, prior_topic, odometry_topic, geoid_height, deskew, at_stamp, turn_time, mounting,
                         prior_frames, odometry_frames),
        SpaceOptions(
            cell, heading_step_deg, half_width, heading_half_width_deg, height_half_width,
            sigma_position, sigma_heading_deg, sigmas, largest_half_width,
        ),
        DriveOptions(min_range, max_range, max_gap), Trust(least_share, largest_runner_up), objective, multiplicity,
        weighting, thinning, search, refinement, wider, risk, track, drift, known_only, threads,
    )  # fmt: skip
    if drives is not None:
        parse_objective(objective)
        localize_many(drives, map_folder, out, opener, engine, quiet)
        return
    assert map_folder is not None and scans is not None  # noqa: S101 - checked above
    check_outputs(prior, out, tum, plot, plot_epochs)
    check_table(out, resume=resume, overwrite=overwrite, track=track)
    check_tracking(track, odometry, drift, deskew=deskew, is_shared=not engine.is_in_process)
    parse_objective(objective)
    entry = DriveEntry("", scans, map_folder, prior, times, odometry)
    opened = opener.open(entry, opener.open_map(map_folder), quiet=quiet)
    point_map, inputs, searching = opened.point_map, opened.inputs, opened.windows or opened.method
    there = read_there(out, inputs.scans.times, resume=resume)
    wanted = parse_epochs(plot_epochs, opened.n_epochs) if plot is not None else frozenset()
    draw = drawer(plot, point_map, searching, objective) if plot is not None else None
    if engine.is_in_process:
        drive = opened.started(there.n_rows)
    else:
        drive = several_workers(opened, engine, there.n_rows, wanted)
    epochs = written(out, there, drive, opened.n_epochs, draw, wanted, quiet)
    inputs.tell()
    searched = opener.spaces.words(opened.windows, inputs.prior, epochs)
    print_summary(epochs, out, searched, there=there, left_out=inputs.left_out, track=track)
    if not there.n_localized:
        print_alternative(point_map, inputs.scans, epochs, searching, opener.drive)
    if tum is not None:
        write_trajectory(tum, out, there, epochs)
    if not is_whole(epochs, there, opened.n_epochs, track=track):
        raise typer.Exit(1)
