# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""`maxcon localize`."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from maxcon.cli.drive_opener import DriveOpener, by_workers
from maxcon.cli.drive_output import (
    check_outputs,
    drawer,
    is_whole,
    parse_epochs,
    print_alternative,
    print_summary,
    write_trajectory,
    written,
)
from maxcon.cli.flags import OptionGroup, argument, flag, flags
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
from maxcon.cli.space_options import SpaceOptions
from maxcon.cli.terminal import step_bars, warn
from maxcon.errors import MaxconError, OptionError

if TYPE_CHECKING:
    from maxcon._system.engine import Engine


class DriveFiles(OptionGroup, title="Inputs"):
    """The files of a drive, or the table of many."""

    map_folder: Path | None = argument(None, "Map made by `maxcon map build`.", "MAP", show_default=False)
    scans: Path | None = argument(
        None,
        "Folder of .bin (KITTI), .pcd, .ply, .npz, .las or .laz scans; or a recording: .bag, .mcap, .db3, .pcap, or the"
        " folder of a ROS 2 bag.",
        "SCANS",
        show_default=False,
    )
    drives: Path | None = flag(
        None,
        "Instead of SCANS: a table of many drives, each with its name, scans, prior, and map where that is not MAP.",
        metavar="CSV|TOML",
    )
    prior: Path | None = flag(
        None,
        "Rough poses T_map_sensor, in the CRS of the map; or by latitude and longitude, in a CSV, a log of NMEA"
        " sentences (.nmea, .log, .txt), or a recording. Without it the poses in the recording of the scans.",
        metavar="TUM|CSV|NMEA|RECORDING",
    )
    out: Path = flag(
        ...,
        "Table to write, a row per epoch; with --drives the folder of a Parquet dataset, which goes on.",
        "--out", "-o", metavar="POSES.csv", rich_help_panel="Output",
    )  # fmt: skip


class TimeOptions(OptionGroup, title="Inputs"):
    """How scans find their priors in time."""

    max_gap: float = flag(0.5, "Largest gap in the prior to interpolate across.", metavar="S")
    times: Times = None


class PictureOptions(OptionGroup, title="Output"):
    """Which epochs are drawn."""

    plot: Path | None = flag(None, "Draw epochs into this folder.", metavar="DIR")
    plot_epochs: str | None = flag(
        None, "Epochs to draw: 0,5,10-20 or all. Default: ten over the drive.", metavar="LIST"
    )


@flags
def localize(
    *,
    files: DriveFiles,
    method: MethodOptions,
    space: SpaceOptions,
    certainty: Certainty,
    motion: MotionOptions,
    recording: RecordingOptions,
    ranges: RangeOptions,
    time: TimeOptions,
    table: TableOptions,
    pictures: PictureOptions,
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
    from maxcon.drive.poses_table import RowsThere, rows_there

    if worker.scheduler is not None:  # its workers are in other folders
        map_folder, scans, prior = (_absolute(path) for path in (files.map_folder, files.scans, files.prior))
        files = replace(files, map_folder=map_folder, scans=scans, prior=prior)
        time = replace(time, times=_absolute(time.times))
        motion = replace(motion, odometry=_absolute(motion.odometry))
        recording = replace(recording, mounting=_absolute(recording.mounting))
    is_one = files.drives is None and worker.workers is None and worker.scheduler is None
    engine = Engine(1 if is_one else worker.workers, worker.scheduler, warn)
    options = DriveOptions(ranges.min_range, ranges.max_range, time.max_gap)
    parse_objective(method.objective)  # a wrong name is said before anything is read
    opener = DriveOpener(method, space, recording, motion, options, certainty, threads)
    if files.drives is not None:
        _check_many(files, motion, time, table, pictures)
        _localize_many(files.drives, files.map_folder, files.out, opener, engine, quiet)
        return
    if files.map_folder is None or files.scans is None:
        missing = "MAP" if files.map_folder is None else "SCANS"
        raise OptionError(f"Expected MAP and SCANS, or --drives with a table of drives, got no {missing}. Name it.")
    out, plot = files.out, pictures.plot
    check_outputs(out, table, prior=files.prior, plot=plot, plot_epochs=pictures.plot_epochs, track=motion.track)
    motion.check(is_shared=not engine.is_in_process)
    entry = DriveEntry("", files.scans, files.map_folder, files.prior, time.times, motion.odometry)
    opened = opener.open(entry, opener.open_map(files.map_folder), quiet=quiet)
    point_map, inputs, searching = opened.point_map, opened.inputs, opened.windows or opened.method
    there = rows_there(out, inputs.scans.times) if table.resume else RowsThere()
    wanted = frozenset() if plot is None else parse_epochs(pictures.plot_epochs, opened.n_epochs)
    draw = None if plot is None else drawer(plot, wanted, point_map, searching, method.objective)
    started = (
        opened.estimates(there.n_rows) if engine.is_in_process else by_workers(opened, engine, there.n_rows, wanted)
    )
    epochs = written(out, there, started, opened.n_epochs, quiet, draw)
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


def _check_many(
    files: DriveFiles, motion: MotionOptions, time: TimeOptions, table: TableOptions, pictures: PictureOptions
) -> None:
    """Refuse arguments of one drive beside a table of drives."""
    alone: Mapping[str, object] = {
        "SCANS": files.scans, "--prior": files.prior, "--odometry": motion.odometry, "--times": time.times,
        "--tum": table.tum, "--plot": pictures.plot, "--plot-epochs": pictures.plot_epochs,
        "--resume": table.resume, "--overwrite": table.overwrite,
    }  # fmt: skip
    for name in [name for name, value in alone.items() if value]:
        if name == "--resume":
            raise OptionError(
                "Expected --drives without --resume, got both: the same command goes on by itself where it was stopped."
                " Leave --resume out."
            )
        if name == "--overwrite":
            raise OptionError(
                "Expected --drives without --overwrite, got both: what is there of drives is never replaced. To"
                f" localize all anew remove {files.out} yourself, to do so with one its drive=NAME there; and leave"
                " --overwrite out."
            )
        if name in ("--tum", "--plot", "--plot-epochs"):
            instead = f"; when all is done: maxcon export {files.out} --drive NAME -o FILE.tum" * (name == "--tum")
            raise OptionError(f"Expected {name} with one drive only, got it beside --drives. Leave it out{instead}.")
        raise OptionError(
            f"Expected each drive's files in the table of --drives and no {name} beside it, got both. Name the file in"
            " the table, or leave --drives out."
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
