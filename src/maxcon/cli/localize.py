# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon localize`."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maxcon.cli.drive_inputs import check_outputs
from maxcon.cli.drive_opener import DriveOpener, several_workers
from maxcon.cli.drive_summary import is_whole, print_alternative, print_summary
from maxcon.cli.flags import flags
from maxcon.cli.options import (
    Certainty,
    MethodOptions,
    MotionOptions,
    Quiet,
    RangeOptions,
    RecordingOptions,
    TableOptions,
    Times,
    WorkerOptions,
    parse_objective,
)
from maxcon.cli.poses_csv import check_table, drawer, parse_epochs, read_there, write_trajectory, written
from maxcon.cli.space_options import SpaceOptions
from maxcon.cli.terminal import step_bars, warn
from maxcon.errors import MaxconError, OptionError

if TYPE_CHECKING:
    from maxcon._system.engine import Engine

__all__ = ["localize"]


@flags
def localize(
    *,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            metavar="POSES.csv",
            help="Table to write, a row per epoch; with --drives the folder of a Parquet dataset, which goes on.",
            rich_help_panel="Output",
        ),
    ],
    method: MethodOptions,
    space: SpaceOptions,
    certainty: Certainty,
    motion: MotionOptions,
    recording: RecordingOptions,
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
            rich_help_panel="Inputs",
        ),
    ] = None,
    prior: Annotated[
        Path | None,
        typer.Option(
            metavar="TUM|CSV|NMEA|RECORDING",
            help="Rough poses T_map_sensor, in the CRS of the map; or by latitude and longitude, in a CSV, a"
            " log of NMEA sentences (.nmea, .log, .txt), or a recording."
            " Without it the poses in the recording of the scans.",
            show_default=False,
            rich_help_panel="Inputs",
        ),
    ] = None,
    ranges: RangeOptions,
    max_gap: Annotated[
        float,
        typer.Option(metavar="S", help="Largest gap in the prior to interpolate across.", rich_help_panel="Inputs"),
    ] = 0.5,
    times: Times = None,
    table: TableOptions,
    plot: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Draw epochs into this folder.", rich_help_panel="Output")
    ] = None,
    plot_epochs: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            help="Epochs to draw: 0,5,10-20 or all. Default: ten over the drive.",
            rich_help_panel="Output",
        ),
    ] = None,
    threads: Annotated[
        int,
        typer.Option(
            min=1,
            help="Epochs localized at once; of a track, headings searched at once.",
            rich_help_panel="How it is done",
        ),
    ] = 1,
    worker: WorkerOptions,
    quiet: Quiet = False,
) -> None:
    """Localize every scan of a drive in a map; the row of each is in POSES.csv once it is done.

    One drive is localized in this process if neither --workers nor --scheduler says otherwise.

    Exit code 0: every epoch is localized, of a track every one from its beginning on; 1: some are not (the status
    column says why); 2: bad input.
    """
    from maxcon._system.engine import Engine
    from maxcon.drive.localize import DriveOptions
    from maxcon.drive.many import DriveEntry

    alone = {
        "SCANS": scans, "--prior": prior, "--odometry": motion.odometry, "--times": times, "--tum": table.tum,
        "--plot": plot, "--plot-epochs": plot_epochs, "--resume": table.resume, "--overwrite": table.overwrite,
    }  # fmt: skip
    _check_one_or_many(drives, map_folder, out, alone)
    if worker.scheduler is not None:  # its workers are in other folders
        map_folder, scans, prior, times = (_absolute(path) for path in (map_folder, scans, prior, times))
        motion = replace(motion, odometry=_absolute(motion.odometry))
        recording = replace(recording, mounting=_absolute(recording.mounting))
    engine = Engine(1 if drives is None and worker.is_alone else worker.workers, worker.scheduler, warn)
    options = DriveOptions(ranges.min_range, ranges.max_range, max_gap)
    opener = DriveOpener(method, space, recording, motion, options, certainty, threads)
    parse_objective(method.objective)  # a wrong name is said before anything is read
    if drives is not None:
        _localize_many(drives, map_folder, out, opener, engine, quiet)
        return
    assert map_folder is not None and scans is not None  # noqa: S101 - checked above
    check_outputs(prior, out, table.tum, plot, plot_epochs)
    check_table(out, resume=table.resume, overwrite=table.overwrite, track=motion.track)
    motion.check(is_shared=not engine.is_in_process)
    entry = DriveEntry("", scans, map_folder, prior, times, motion.odometry)
    opened = opener.open(entry, opener.open_map(map_folder), quiet=quiet)
    point_map, inputs, searching = opened.point_map, opened.inputs, opened.windows or opened.method
    there = read_there(out, inputs.scans.times, resume=table.resume)
    wanted = parse_epochs(plot_epochs, opened.n_epochs) if plot is not None else frozenset()
    draw = drawer(plot, point_map, searching, method.objective) if plot is not None else None
    if engine.is_in_process:
        drive = opened.started(there.n_rows)
    else:
        drive = several_workers(opened, engine, there.n_rows, wanted)
    epochs = written(out, there, drive, opened.n_epochs, draw, wanted, quiet)
    inputs.tell()
    searched = space.words(opened.windows, inputs.prior, epochs)
    print_summary(epochs, out, searched, there=there, left_out=inputs.left_out, track=motion.track)
    if not there.n_localized:
        print_alternative(point_map, inputs.scans, epochs, searching, options)
    if table.tum is not None:
        write_trajectory(table.tum, out, there, epochs)
    if not is_whole(epochs, there, opened.n_epochs, track=motion.track):
        raise typer.Exit(1)


def _absolute(path: Path | None) -> Path | None:
    from maxcon.map.storage import address_of

    return path if path is None or address_of(path) else path.absolute()


def _check_one_or_many(drives: Path | None, map_folder: Path | None, out: Path, alone: Mapping[str, object]) -> None:
    """Refuse arguments of one drive beside a table of drives, and one drive without its arguments."""
    if drives is None:
        missing = "MAP" if map_folder is None else "SCANS"
        if map_folder is None or alone["SCANS"] is None:
            raise OptionError(f"Expected MAP and SCANS, or --drives with a table of drives, got no {missing}. Name it.")
        return
    name = next((name for name, value in alone.items() if value), None)
    if name is None:
        return
    if name == "--resume":
        raise OptionError(
            "Expected --drives without --resume, got both: the same command goes on by itself where it was stopped."
            " Leave --resume out."
        )
    if name == "--overwrite":
        raise OptionError(
            "Expected --drives without --overwrite, got both: what is there of drives is never replaced. To localize"
            f" all anew remove {out} yourself, to do so with one its drive=NAME there; and leave --overwrite out."
        )
    if name in ("--tum", "--plot", "--plot-epochs"):
        instead = f"; when all is done: maxcon export {out} --drive NAME -o FILE.tum" if name == "--tum" else ""
        raise OptionError(f"Expected {name} with one drive only, got it beside --drives. Leave it out{instead}.")
    raise OptionError(
        f"Expected each drive's files in the table of --drives and no {name} beside it, got both. Name the file in the"
        " table, or leave --drives out."
    )


def _localize_many(
    drives: Path, map_folder: Path | None, out: Path, opener: DriveOpener, engine: "Engine", quiet: bool
) -> None:
    """Localize a table of drives into a dataset; MaxconError if a drive cannot be localized, when the others are."""
    from maxcon.drive.many import ManyDrivesJob, localize_drives, read_drives

    entries = read_drives(drives, map_folder)
    with step_bars("epochs", quiet) as report:
        done = localize_drives(entries, ManyDrivesJob(opener), out, engine, report)
    before = f", {done.n_epochs - done.n_new} of them were there" if done.n_epochs > done.n_new else ""
    typer.echo(
        f"{done.n_localized:,} of {done.n_epochs:,} epochs of {done.n_drives:,} drives localized{before}; in {out}"
    )
    if done.refused:
        name, reason = next(iter(done.refused.items()))
        raise MaxconError(
            f"Expected drives that can be localized, but {len(done.refused)} of {len(entries)} cannot; the first,"
            f" {name}: {reason}"
        )
    if done.n_localized < done.n_epochs:
        raise typer.Exit(1)
