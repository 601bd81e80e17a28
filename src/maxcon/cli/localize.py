"""`maxcon localize` and `maxcon relocalize`."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from maxcon.cli.flags import OptionGroup, argument, check_exclusive, check_needs, flag, flags
from maxcon.cli.options import (
    AllowInexactCrs,
    AtStamp,
    Certainty,
    MethodOptions,
    MotionOptions,
    Quiet,
    RangeOptions,
    RecordingOptions,
    ScoresOptions,
    SpaceOptions,
    TableOptions,
    Times,
    Topic,
    ViewOptions,
    WorkerOptions,
    parse_numbers,
)
from maxcon.cli.terminal import warn
from maxcon.errors import OptionError


class DriveFiles(OptionGroup, title="Inputs"):
    """The files of a drive, or the table of many.

    scans: Folder of .bin (KITTI), .pcd, .ply, .npz, .las or .laz scans; or a recording: .bag, .mcap, .db3, .pcap, or
        the folder of a ROS 2 bag.
    drives: Instead of SCANS: a table of many drives, each with its name, scans, prior, and map where that is not MAP.
    prior: Rough poses T_map_sensor, in the CRS of the map; or by latitude and longitude, in a CSV, a log of NMEA
        sentences (.nmea, .log, .txt), or a recording. Without it the poses in the recording of the scans.
    max_gap: Largest gap in the prior to interpolate across.
    out: Table to write, a row per epoch; with --drives the folder of a Parquet dataset, which goes on.
    """

    map_folder: Path | None = argument(None, "Map made by `maxcon map build`.", "MAP", show_default=False)
    scans: Path | None = argument(None, None, "SCANS", show_default=False)
    drives: Path | None = flag(None, metavar="CSV|TOML")
    prior: Path | None = flag(None, metavar="TUM|CSV|NMEA|RECORDING")
    max_gap: float = flag(0.5, metavar="S")
    times: Times = None
    out: Path = flag(..., None, "--out", "-o", metavar="POSES.csv", rich_help_panel="Output")


class PictureOptions(OptionGroup, title="Output"):
    """Which epochs are drawn.

    report: Write a page of the drive: map, statuses, protection levels, worst epochs.
    reference: Poses held for true: summary and --report say how far answers are from them.
    reference_crs: CRS of the reference, if it is not the map's.
    """

    plot: Path | None = flag(None, "Draw epochs into this folder.", metavar="DIR")
    plot_epochs: str | None = flag(None, "Epochs to draw: 0,5,10-20 or all. Default: ten of the drive.", metavar="LIST")
    report: Path | None = flag(None, metavar="PAGE.html")
    reference: Path | None = flag(None, metavar="TUM|CSV")
    reference_crs: str | None = flag(None, metavar="EPSG:N|WKT")
    allow_inexact_crs: AllowInexactCrs = False

    def __post_init__(self) -> None:
        check_needs({"--plot-epochs": self.plot_epochs}, {"--plot DIR": self.plot})
        check_needs({"--reference-crs": self.reference_crs}, {"--reference": self.reference})
        check_needs({"--allow-inexact-crs": self.allow_inexact_crs}, {"--reference-crs": self.reference_crs})

    def true_poses(self, point_map: Any) -> tuple[Any, str]:
        """Return the reference in the coordinates of a map, None without one, and how it came there in words."""
        from maxcon.io.poses_between_crs import poses_in_crs
        from maxcon.io.trajectories import read_trajectory

        poses = None if self.reference is None else read_trajectory(self.reference)
        if poses is None or self.reference_crs is None:
            return poses, ""
        label, cell = str(self.reference), None if self.allow_inexact_crs else point_map.cell
        return poses_in_crs(poses, self.reference_crs, point_map.frame.crs, label, exact_to=cell)


class EpochWorkers(WorkerOptions, title="How it is done"):
    """Who localizes the epochs."""

    threads: int = flag(1, "Epochs localized at once; of a track, headings searched at once.", min=1)


@flags
def localize(
    *, files: DriveFiles, method: MethodOptions, space: SpaceOptions, certainty: Certainty, motion: MotionOptions,
    recording: RecordingOptions, ranges: RangeOptions, table: TableOptions, pictures: PictureOptions,
    view: ScoresOptions, worker: EpochWorkers, quiet: Quiet = False,
) -> None:  # fmt: skip
    """Localize every scan of a drive in a map; the row of each is in POSES.csv once it is done.

    One drive is localized in this process if neither --workers nor --scheduler says otherwise.

    Exit code 0: every epoch is localized, of a track every one from its beginning on; 1: some are not (the status
    column says why); 2: bad input.
    """
    from maxcon._system.engine import Engine
    from maxcon.cli import drive_output
    from maxcon.cli.drive_inputs import DriveOpener, by_workers, parse_objective
    from maxcon.drive.localize import DriveOptions
    from maxcon.drive.many import DriveEntry

    if worker.scheduler is not None:  # its workers are in other folders
        named = files.map_folder, files.scans, files.prior, files.times
        map_folder, scans, prior, times = map(_absolute, named)
        files = replace(files, map_folder=map_folder, scans=scans, prior=prior, times=times)
        motion = replace(motion, odometry=_absolute(motion.odometry))
        recording = replace(recording, mounting=_absolute(recording.mounting))
    is_one = files.drives is None and worker.workers is None and worker.scheduler is None
    engine = Engine(1 if is_one else worker.workers, worker.scheduler, warn)
    options = DriveOptions(ranges.min_range, ranges.max_range, files.max_gap)
    check_exclusive({"--at": recording.at}, {"--prior": files.prior, "--drives": files.drives})
    parse_objective(method.objective)  # a wrong name is said before anything is read
    opener = DriveOpener(method, space, recording, motion, options, certainty, worker.threads)
    if files.drives is not None:
        of_one = {
            "SCANS": files.scans, "--prior": files.prior, "--odometry": motion.odometry, "--times": files.times,
            "--tum": table.tum, "--plot": pictures.plot, "--report": pictures.report, "--resume": table.resume,
            "--reference": pictures.reference, "--view or --save": view.is_wanted, "--overwrite": table.overwrite,
            "--json": table.is_json,
        }  # fmt: skip
        check_exclusive({"--drives, where a table names files and a call goes on,": True}, of_one)
        drive_output.localize_many(files.drives, files.map_folder, files.out, opener, engine, quiet)
        return
    if files.map_folder is None or files.scans is None:
        missing = "MAP" if files.map_folder is None else "SCANS"
        raise OptionError(f"Expected MAP and SCANS, or --drives with a table of drives, got no {missing}. Name it.")
    # Each epoch of a track needs the one before, and where a track was is not in the table.
    has_workers = not engine.is_in_process
    check_exclusive({"--track": motion.track}, {"--resume": table.resume, "--workers or --scheduler": has_workers})
    check_needs({"--drift": motion.drift}, {"--odometry": motion.odometry})
    view.check(resume=table.resume)
    out, plot = files.out, pictures.plot
    drive_output.check_outputs(out, table, prior=files.prior, plot=plot, report=pictures.report)
    point_map = opener.open_map(files.map_folder)
    reference, reference_words = pictures.true_poses(point_map)
    entry = DriveEntry("", files.scans, files.map_folder, files.prior, files.times, motion.odometry)
    drive = opener.open(entry, point_map, quiet=quiet)
    localized = drive_output.TableOfDrive(out, table, drive.scans.times, is_track=motion.track)
    there = localized.there
    wanted = frozenset() if plot is None else drive_output.parse_epochs(pictures.plot_epochs, len(drive.scans))
    draw = None if plot is None else drive_output.drawer(drive, plot, wanted)
    needed = frozenset(range(len(drive.scans))) if view.is_wanted else wanted
    started = by_workers(drive, engine, there.n_rows, needed) if has_workers else drive.estimates(there.n_rows)
    scored = [partial(drive_output.cell_scores_of, drive)] if view.scores else []
    with view.shown(started, drive.point_map, drive.prior.trajectory.positions[0], *scored) as shown:
        localized.write(shown, quiet, draw)
    said = (*drive.words, *([f"reference: {reference_words}"] if reference_words else []))
    localized.say(*said, inputs=said)
    searched = drive_output.searched_words(drive, localized.epochs)
    localized.print_summary(drive.entry.map, searched, drive.prior.left_out)
    if not there.n_localized:
        drive_output.say_alternative(drive, localized)
    localized.write_tum()
    if pictures.report is not None or reference is not None:
        reach = f"{drive.method.space.half_width:g} m and {drive.method.space.heading_half_width_deg:g} degrees around"
        if motion.track:
            reach = f"tracked, within {reach} the prior"
        assumed = {"Searched": searched or reach, "Risk of a protection level": f"{certainty.risk:g} per scan"}
        if reference is not None:
            assumed["Reference"] = ", ".join(filter(None, [str(pictures.reference), reference_words]))
        drive_output.report_drive(pictures.report, localized, drive, reference, assumed)
    localized.end()


def _absolute(path: Path | None) -> Path | None:
    from maxcon.map.storage import address_of

    return path if path is None or address_of(path) else path.absolute()


class ScanFiles(OptionGroup, title="Recordings and scanners"):
    """The map and the scans, and how these are read.

    out: Table to write, a row per epoch; if not given, a line is printed for each.
    threads: Headings searched at once; the answers do not depend on it.
    """

    map_folder: Path = argument(..., "Map made by `maxcon map build`, with ground.", "MAP")
    scans: Path = argument(..., "Folder of scans, or a recording, as of `maxcon localize`.", "SCANS")
    out: Path | None = flag(None, None, "--out", "-o", metavar="POSES.csv", rich_help_panel="Output")
    topic: Topic = None
    at_stamp: AtStamp = False
    times: Times = None
    threads: int = flag(1, min=1, rich_help_panel="How it is done")


class CircleOptions(OptionGroup, title="Search space"):
    """The part of the map that is searched."""

    around: str | None = flag(None, "Look in a circle around this place only, m, in the CRS of the map.", metavar="X,Y")
    radius: float | None = flag(None, "Radius of that circle, m; 300 if not given.", metavar="M")

    def __post_init__(self) -> None:
        check_needs({"--radius": self.radius}, {"--around X,Y": self.around})

    @property
    def middle(self) -> list[float] | None:
        """The middle of the circle, x and y in the CRS of the map, m; None for the whole map."""
        return None if self.around is None else parse_numbers(self.around, "--around", "X,Y", "549980,5801820")


class PlaceCertainty(Certainty, title="Certainty"):
    """The same in a whole map, of which more matches by chance."""

    least_share: float = flag(0.1, metavar="0..1")


@flags
def relocalize(
    ranges: RangeOptions, files: ScanFiles, circle: CircleOptions, certainty: PlaceCertainty, table: TableOptions,
    view: ViewOptions, quiet: Quiet = False,
) -> None:  # fmt: skip
    """Find scans in a map without any prior: at any place of it, or in a circle, and at any heading.

    Exit code 0: every epoch is localized; 1: some are not (the status column says why); 2: bad input.
    """
    import numpy as np

    from maxcon.cli import drive_output
    from maxcon.drive.localize import DriveOptions, relocalize_drive
    from maxcon.integrity import Trust
    from maxcon.io.scans import open_scans
    from maxcon.map import PointMap
    from maxcon.relocalization import Relocalizer

    out = files.out
    of_table = {"--resume": table.resume, "--overwrite": table.overwrite, "--tum": table.tum, "--json": table.is_json}
    check_needs(of_table, {"--out POSES.csv": out})
    view.check(resume=table.resume)
    if out is not None:
        drive_output.check_outputs(out, table)
    trust = Trust(certainty.least_share, certainty.largest_runner_up)
    options = DriveOptions(**vars(ranges))
    point_map = PointMap.open(files.map_folder)
    radius = 300.0 if circle.radius is None else circle.radius
    middle = None if circle.middle is None else tuple(point_map.frame.to_local([[*circle.middle, 0.0]])[0, :2].tolist())
    relocalizer = Relocalizer(point_map, middle, radius, n_threads=files.threads, trust=trust, risk=certainty.risk)
    opened = open_scans(files.scans, files.times, topic=files.topic, at_stamp=files.at_stamp)
    near = np.array([*(circle.middle or point_map.frame.origin[:2]), point_map.frame.origin[2]])
    localized = drive_output.TableOfDrive(out or Path(), table, opened.times)
    started = relocalize_drive(opened, relocalizer, options, first=localized.there.n_rows)
    with view.shown(started, point_map, near) as shown:
        if out is None:
            localized.epochs += drive_output.printed(shown)
        else:
            localized.write(shown, quiet)
    if out is not None:
        where = "the whole map" if circle.around is None else f"{radius:g} m around {circle.around}"
        found = f"searched without a prior: {where}, {relocalizer.n_cells:,} large cells"
        localized.print_summary(files.map_folder, found)
        localized.write_tum()
    localized.end()
