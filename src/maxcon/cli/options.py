"""Options that several commands have, and the option groups of those that localize."""

import math
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Option

from maxcon.cli.flags import OptionGroup, argument, check_exclusive, check_needs, flag
from maxcon.errors import OptionError

SIGMAS, LARGEST_HALF_WIDTH = 3.0, 24.0

Quiet = Annotated[bool, Option("--quiet", "-q", help="No progress bar.", rich_help_panel="Output")]
Times = Annotated[Path | None, Option(metavar="FILE", help="Times of the scans; default times.txt, or the names.")]
Risk = Annotated[float, Option(metavar="0..1", help="Largest probability of errors above the protection level.")]
Topic = Annotated[str | None, Option(metavar="NAME", help="Which of several point clouds of a recording.")]
AtStamp = Annotated[
    bool, Option("--at-stamp", help="A recorded scan's time is its message's, not midway between first and last point.")
]
TurnTime = Annotated[
    float | None,
    Option(
        metavar="S",
        help="With --deskew, where points have no times: how long a turn of the scanner takes, from behind to behind,"
        " clockwise seen from above; negative for counter-clockwise.",
    ),
]
IsJson = Annotated[bool, Option("--json", help="Print one JSON object instead of sentences.")]
AllowInexactCrs = Annotated[
    bool, Option("--allow-inexact-crs", help="The CRS may be converted to less exactly than to a voxel of the map.")
]
GeoidHeight = Annotated[
    float | None,
    Option(metavar="M", help="Height of the geoid above the ellipsoid: subtracted from a receiver's heights, m."),
]
MinRange = Annotated[float, Option(metavar="M", help="Nearer points are left out.")]
MaxRange = Annotated[float, Option(metavar="M", help="Farther points are left out.")]
Scheduler = Annotated[
    str | None, Option(metavar="ADDRESS", help="Dask scheduler, tcp://HOST:8786: its workers do the work.")
]


def check_turn_time(turn_time: float | None, *, deskew: bool) -> None:
    """Refuse the time of a turn that is not used, or is none of a scanner: OptionError."""
    check_needs({"--turn-time": turn_time}, {"--deskew": deskew})
    if turn_time is not None and not 0.0 < abs(turn_time) <= 2.0:
        raise OptionError(f"Expected --turn-time of up to 2 s, got {turn_time}. Most scanners take 0.1 s.")


def parse_numbers(text: str, name: str, metavar: str, example: str) -> list[float]:
    """Return the numbers of an option that are separated by commas, as many as `metavar` names: OptionError if not."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != len(metavar.split(",")) or not all(map(math.isfinite, numbers)):
        raise OptionError(
            f"Expected {name} {metavar}, numbers in the CRS of the map, m, and degrees, got {text!r:.80}. Write it as"
            f" {name} {example}."
        )
    return numbers


class RangeOptions(OptionGroup, title="Inputs"):
    """Which points of a scan take part, by their distance from the sensor, m."""

    min_range: MinRange = 1.0
    max_range: MaxRange = 120.0


class RecordingOptions(OptionGroup, title="Recordings and scanners"):
    """What of a recording is used, and how; None for what is not given.

    prior_topic: Which poses of a recording are the prior: NavSatFix, Odometry, PoseStamped or
        PoseWithCovarianceStamped.
    prior_frames: The prior is the way of one frame in another by the recording's transforms (TF), map:base_link for
        example.
    mounting: Where the scanner is in the vehicle, and what the prior is of, an antenna for example: the prior's poses
        become the scanner's.
    prior_crs: CRS of the prior's x and y (east and north), if it is not the map's: positions and headings are
        transformed.
    at: Of one scan, instead of --prior: a place on the map's ground in its CRS, m, and the heading there, degrees
        counter-clockwise from +x.
    """

    topic: Topic = None
    prior_topic: str | None = flag(None, metavar="NAME")
    prior_frames: str | None = flag(None, metavar="FIXED:MOVING")
    odometry_topic: str | None = flag(None, "Which poses of a recording are the odometry.", metavar="NAME")
    odometry_frames: str | None = flag(None, "Likewise the odometry: odom:base_link.", metavar="FIXED:MOVING")
    geoid_height: GeoidHeight = None
    mounting: Path | None = flag(None, metavar="TOML")
    at_stamp: AtStamp = False
    time_offset: float = flag(0.0, "Added to the times of the prior and of the odometry.", metavar="S")
    prior_crs: str | None = flag(None, metavar="EPSG:N|WKT", rich_help_panel="Inputs")
    at: str | None = flag(None, metavar="X,Y,HEADING_DEG", rich_help_panel="Inputs")

    def __post_init__(self) -> None:
        of_priors = {"--prior-topic": self.prior_topic, "--geoid-height": self.geoid_height}
        of_priors |= {"--prior-frames": self.prior_frames, "--prior-crs": self.prior_crs}
        check_exclusive({"--at": self.at}, of_priors)
        check_exclusive({"--prior-topic": self.prior_topic}, {"--prior-frames": self.prior_frames})
        check_exclusive({"--odometry-topic": self.odometry_topic}, {"--odometry-frames": self.odometry_frames})


class MotionOptions(OptionGroup, title="Motion"):
    """What is known and made of the vehicle's motion.

    odometry: With --track or --deskew: poses in any frame that tell the motion; else the prior's own does.
    """

    track: bool = flag(False, "Search each scan only where the one before and the motion since allow it to be.")
    odometry: Path | None = flag(None, metavar="TUM|CSV|RECORDING")
    drift: float | None = flag(None, "Error of the odometry as a share of the way; 0.02 if not given.", metavar="SHARE")
    deskew: bool = flag(False, "Points have times: move them to where they were at the time of their scan.")
    turn_time: TurnTime = None

    def __post_init__(self) -> None:
        check_needs({"--odometry": self.odometry}, {"--track": self.track, "--deskew": self.deskew})
        check_turn_time(self.turn_time, deskew=self.deskew)


class Topics(OptionGroup, title="Inputs"):
    """What is listened to."""

    map_folder: Path = argument(..., "Map made by `maxcon map build`.", "MAP")
    ros2: bool = flag(False, "Messages come by ROS 2 (DDS): the only way so far.")
    domain: int = flag(0, "Domain of ROS 2.", metavar="N", min=0, max=232, envvar="ROS_DOMAIN_ID")
    points: str = flag("/points", "Topic of the scans (PointCloud2).", metavar="TOPIC")
    odometry: str = flag("/odom", "Topic of the odometry (Odometry).", metavar="TOPIC")
    fix: str = flag("/fix", "Topic of positions (NavSatFix), where the map has a CRS; no heights.", metavar="TOPIC")
    mounting: Path | None = flag(None, "Where scanner, antenna and odometry are in the vehicle.", metavar="TOML")
    at_stamp: AtStamp = False
    deskew: bool = flag(False, "Points have times: move them to where they were at the time of their scan.")


class Outputs(OptionGroup, title="Output"):
    """What is published."""

    map_frame: str = flag("map", "Name of the map's local frame.", metavar="NAME")
    map_spacing: float = flag(1.0, "Publish the map, a point per cube of this edge, m; 0: do not.", metavar="M", min=0)
    tf_ahead: float = flag(0.2, "Stamp the transform so much later than its scan, for what comes next.", metavar="S")


class MethodOptions(OptionGroup, title="Method"):
    """How a scan is searched for in the map.

    objective: What a cell is worth: helmert, count, max-eigenvalue, or your own package.module:Name.
    weighting: Weight of a match: the cosine between the normals, and 1/2 where the scan point has none; as published,
        where it is 0 then; or one.
    thinning: With --cell: search with one point of a scan per cube of this edge, m; 0: all, as published.
    search: How the best cell is found; it is the same one.
    """

    objective: str = flag("helmert", metavar="NAME")
    multiplicity: Literal["occupied", "points"] = flag("occupied", "A match weighs one, or its voxel's map points.")
    weighting: Literal["cosine", "published", "one"] = flag("cosine")
    thinning: float = flag(0.25, metavar="M")
    search: Literal["exhaustive", "branch-and-bound"] = flag("branch-and-bound")
    refinement: bool = flag(True, "Adjust the pose of the best cell to the surfaces of the map, and examine it there.")
    known_only: bool = flag(False, "In an updated map: leave out what is new, too, not only what is gone.")


class SpaceOptions(OptionGroup, title="Search space"):
    """Where a scan is searched for around its prior; None for what is not given.

    half_width: Largest offset from the prior in x and y, m; else of the prior's covariances, or 12.
    heading_half_width_deg: Largest turn from the prior's heading, degrees; likewise, or 10.
    height_half_width: Largest offset from the prior in z, m, searched where the ground does not tell the height; a
        multiple of the cell. 0 if not given: the height is the prior's there.
    sigma_position: Instead of half widths: standard deviation of every prior's x, and of its y, m.
    sigmas: How many standard deviations to search, these or the prior's own; 3 if not given.
    largest_half_width: No search within standard deviations is wider than this, nor one that is repeated, twice as wide
        each time, where the answer is in doubt, m; 24 if not given.
    cell: Search in cells of this edge alone, m: the map's, or 2, 4, ... 32 times it. If neither this nor a heading step
        is given, coarse to fine.
    heading_step_deg: Step between headings, degrees; 0.5 beside --cell, if not given.
    """

    wider: float = flag(12.0, "Search so far around an answer that is in doubt, m; 0: never.", metavar="M")
    half_width: float | None = flag(None, metavar="M")
    heading_half_width_deg: float | None = flag(None, metavar="DEG")
    height_half_width: float | None = flag(None, metavar="M")
    sigma_position: float | None = flag(None, metavar="M")
    sigma_heading_deg: float | None = flag(None, "Standard deviation of its heading, degrees.", metavar="DEG")
    sigmas: float | None = flag(None, metavar="K")
    largest_half_width: float | None = flag(None, metavar="M")
    cell: float | None = flag(None, metavar="M")
    heading_step_deg: float | None = flag(None, metavar="DEG")

    def __post_init__(self) -> None:
        position, heading = {"--sigma-position": self.sigma_position}, {"--sigma-heading-deg": self.sigma_heading_deg}
        numbers = {"--sigmas": self.sigmas, "--largest-half-width": self.largest_half_width}
        half_widths = {"--half-width": self.half_width, "--heading-half-width-deg": self.heading_half_width_deg}
        check_exclusive(half_widths, position | heading | numbers)
        check_needs(position, heading)
        check_needs(heading, position)
        for name, value in (position | heading | {"--sigmas": self.sigmas}).items():
            if value is not None and not 0.0 <= value < 1e9:
                raise OptionError(f"Expected {name} to be a finite number >= 0, got {value}. Left out --sigmas is 3.")


class Certainty(OptionGroup, title="Certainty"):
    """From where on an answer is not trusted.

    least_share: An answer that fewer of the scan's points match is not trusted. Lower it for thin maps.
    largest_runner_up: Not trusted if the second best place scores more than this fraction of the best.
    """

    risk: Risk = 0.01
    least_share: float = flag(0.05, metavar="0..1")
    largest_runner_up: float = flag(0.8, metavar="0..1")


class TableOptions(OptionGroup, title="Output"):
    """How POSES.csv is begun, and what is written beside it."""

    resume: bool = flag(False, "Go on with POSES.csv where a call that was stopped ended.")
    overwrite: bool = flag(False, "Replace POSES.csv, if it is there.")
    tum: Path | None = flag(None, "Also write the localized poses as TUM.", metavar="FILE")
    is_json: bool = flag(False, "Print the summary as one JSON object instead of sentences.", "--json")

    def __post_init__(self) -> None:
        check_exclusive({"--resume": self.resume}, {"--overwrite": self.overwrite})


class WorkerOptions(OptionGroup, title="How it is done"):
    """Who does the work: this process if neither is given."""

    workers: int | None = flag(
        None, "Processes, about 1 GiB each; 1: all in this one. Default: as many as processors.", metavar="N", min=1
    )
    scheduler: Scheduler = None


class ViewOptions(OptionGroup, title="Output"):
    """Whether a drive is shown, or recorded; both need the extra view."""

    view: bool = flag(False, "Show the map, and of a drive scans and answers as they come, in Rerun (extra view).")
    save: Path | None = flag(None, "Write that as a recording; `rerun FILE` opens it (extra view).", metavar="FILE.rrd")

    @property
    def is_wanted(self) -> bool:
        """Whether epochs are shown."""
        return self.view or self.save is not None

    def check(self, *, resume: bool = False) -> None:
        """Refuse, before the work, what cannot be shown or written."""
        if not self.is_wanted:
            return
        from maxcon._system.atomic import check_writable
        from maxcon.export.scene import RERUN_SUFFIX, with_rerun

        check_exclusive({"--save": self.save}, {"--view": self.view, "--resume": resume})
        rerun_recording = with_rerun()
        if self.save is None:
            rerun_recording.find_viewer()
        elif self.save.suffix.lower() != RERUN_SUFFIX:
            raise OptionError(f"Expected a recording {RERUN_SUFFIX} as --save, got {self.save}. Rename it.")
        else:
            check_writable(self.save)

    def shown(self, epochs: Any, point_map: Any, near: Any, *scored: Any) -> AbstractContextManager[Any]:
        """Return what yields the same epochs, shown if that is wanted; parameters as of `rerun_recording.shown`."""
        from maxcon.export.scene import with_rerun

        is_wanted = self.is_wanted
        return with_rerun().shown(epochs, point_map, near, self.save, *scored) if is_wanted else nullcontext(epochs)


class ScoresOptions(ViewOptions, title="Output"):
    """Whether scores of cells are shown, too."""

    scores: bool = flag(False, "With --view or --save: show the cells' scores, too, searched anew, some 0.1 s a scan.")

    def __post_init__(self) -> None:
        check_needs({"--scores": self.scores}, {"--view": self.view, "--save": self.save})


class MappingDrive(OptionGroup, title="Scans instead of clouds"):
    """A drive that a map is made of.

    scans: Scans as `maxcon localize` takes them: a folder, or a recording.
    poses: Where the scanner was, of a SLAM program for example: with times, interpolated; or KITTI's 12 numbers a line,
        one line per scan. z is up.
    mounting: Where [sensor] and [odometry] are in the vehicle, if the poses are not the scanner's.
    """

    scans: Path | None = flag(None, metavar="FOLDER|RECORDING")
    poses: Path | None = flag(None, metavar="TUM|CSV|KITTI|RECORDING")
    times: Times = None
    topic: Topic = None
    at_stamp: AtStamp = False
    poses_topic: str | None = flag(None, "Which poses of a recording.", metavar="NAME")
    mounting: Path | None = flag(None, metavar="TOML")
    deskew: bool = flag(False, "Points have times, and are not deskewed: move them by the poses.")
    turn_time: TurnTime = None
    min_range: MinRange = 1.0
    max_range: MaxRange = 120.0
    keep_moving: bool = flag(False, "Keep what later rays went through; else it is gone, as in `maxcon map update`.")

    def __post_init__(self) -> None:
        both = {"--scans": self.scans, "--poses": self.poses}
        for name, value in both.items():
            check_needs({name: value}, {other: given for other, given in both.items() if other != name})
        others = {
            "--times": self.times, "--topic": self.topic, "--at-stamp": self.at_stamp, "--deskew": self.deskew,
            "--poses-topic": self.poses_topic, "--mounting": self.mounting, "--keep-moving": self.keep_moving,
        }  # fmt: skip
        check_needs(others, {"--scans": self.scans})
        check_turn_time(self.turn_time, deskew=self.deskew)
