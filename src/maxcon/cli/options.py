# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Options that several commands have, and the option groups of those that localize."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from maxcon.cli.flags import OptionGroup, flag
from maxcon.errors import OptionError

if TYPE_CHECKING:
    from maxcon.search.objectives import Objective

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress bar.", rich_help_panel="Output")]
Times = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Time of each scan; default times.txt there, or the names.", rich_help_panel="Inputs"
    ),
]
Risk = Annotated[
    float, typer.Option(metavar="0..1", help="Errors exceed the protection level with at most this probability.")
]
Topic = Annotated[str | None, typer.Option(metavar="NAME", help="Which of several point clouds of a recording.")]
AtStamp = Annotated[
    bool,
    typer.Option(
        "--at-stamp",
        help="The time of a recorded scan is its message's, not the middle between its first and its last point.",
    ),
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler, tcp://HOST:8786: its workers do the work.")
]


class RangeOptions(OptionGroup, title="Inputs"):
    """Which points of a scan take part, by their distance from the sensor, m."""

    min_range: float = flag(1.0, "Nearer points are left out.", metavar="M")
    max_range: float = flag(120.0, "Farther points are left out.", metavar="M")


class RecordingOptions(OptionGroup, title="Recordings and scanners"):
    """What of a recording is used, and how; None for what is not given."""

    topic: Topic = None
    prior_topic: str | None = flag(
        None,
        "Which poses of a recording are the prior: NavSatFix, Odometry, PoseStamped or PoseWithCovarianceStamped.",
        metavar="NAME",
    )
    prior_frames: str | None = flag(
        None,
        "The prior is the way of one frame in another by the recording's transforms (TF), map:base_link for example.",
        metavar="FIXED:MOVING",
    )
    odometry_topic: str | None = flag(None, "Which poses of a recording are the odometry.", metavar="NAME")
    odometry_frames: str | None = flag(None, "Likewise the odometry: odom:base_link.", metavar="FIXED:MOVING")
    geoid_height: float | None = flag(
        None, "Height of the geoid above the ellipsoid: subtracted from a receiver's heights, m.", metavar="M"
    )
    mounting: Path | None = flag(
        None,
        "Where the scanner is in the vehicle, and what the prior is of, an antenna for example: the prior's poses"
        " become the scanner's.",
        metavar="TOML",
    )
    at_stamp: AtStamp = False

    def check(self) -> None:
        """Refuse poses that are asked for twice: OptionError."""
        for what, topic, frames in (
            ("prior", self.prior_topic, self.prior_frames),
            ("odometry", self.odometry_topic, self.odometry_frames),
        ):
            if topic is not None and frames is not None:
                raise OptionError(f"Expected either --{what}-topic or --{what}-frames, got both. Leave one out.")


class MotionOptions(OptionGroup, title="Motion"):
    """What is known and made of the vehicle's motion."""

    track: bool = flag(False, "Search each scan only where the one before and the motion since allow it to be.")
    odometry: Path | None = flag(
        None,
        "With --track or --deskew: poses in any frame that tell the motion; else the prior's own does.",
        metavar="TUM|CSV|RECORDING",
    )
    drift: float | None = flag(
        None, "Error of the odometry as a fraction of the way; 0.02 if not given.", metavar="SHARE"
    )
    deskew: bool = flag(False, "Points have times: move them to where they were at the time of their scan.")
    turn_time: float | None = flag(
        None,
        "With --deskew, where points have no times: how long a turn of the scanner takes, from behind to behind,"
        " clockwise seen from above; negative for counter-clockwise.",
        metavar="S",
    )

    def check(self, *, is_shared: bool) -> None:
        """Refuse options without effect, and a track that is shared among workers: OptionError."""
        if self.track and is_shared:
            raise OptionError(
                "Expected one process for --track, as each epoch needs the one before, got --workers or --scheduler."
                " Leave it out, or take --threads."
            )
        if self.odometry is not None and not (self.track or self.deskew):
            raise OptionError(
                "Expected --odometry together with --track or --deskew, got it alone. Add one, or leave it out."
            )
        if self.drift is not None and self.odometry is None:
            raise OptionError("Expected --drift together with --odometry, got it alone. Leave it out.")

    def check_turn_time(self) -> None:
        """Refuse a time of a turn that is none, or without effect: OptionError."""
        if self.turn_time is not None and not self.deskew:
            raise OptionError("Expected --turn-time together with --deskew, got it alone. Add --deskew.")
        if self.turn_time is not None and not 0.0 < abs(self.turn_time) <= 2.0:
            raise OptionError(f"Expected --turn-time of up to 2 s, got {self.turn_time}. Most scanners take 0.1 s.")


class MethodOptions(OptionGroup, title="Method"):
    """How a scan is searched for in the map."""

    objective: str = flag(
        "helmert",
        "What a cell is worth: helmert, count, max-eigenvalue, or one of your own, package.module:Name.",
        metavar="NAME",
    )
    multiplicity: Literal["occupied", "points"] = flag(
        "occupied", "A match weighs one, or as many as the voxel's map points."
    )
    weighting: Literal["cosine", "published", "one"] = flag(
        "cosine",
        "Weight of a match: the cosine between the normals, and 1/2 where the scan point has none; as published,"
        " where it is 0 then; or one.",
    )
    thinning: float = flag(
        0.25, "Search with one point of the scan in each cube of this edge, m; 0: all, as published.", metavar="M"
    )
    search: Literal["exhaustive", "branch-and-bound"] = flag(
        "branch-and-bound", "How the best cell is found; it is the same one."
    )
    refinement: bool = flag(True, "Adjust the pose of the best cell to the surfaces of the map, and examine it there.")
    known_only: bool = flag(False, "In an updated map: leave out what is new, too, not only what is gone.")


class Certainty(OptionGroup, title="Certainty"):
    """From where on an answer is not trusted."""

    risk: Risk = 0.01
    least_share: float = flag(
        0.05, "An answer that fewer of the scan's points match is not trusted. Lower it for thin maps.", metavar="0..1"
    )
    largest_runner_up: float = flag(
        0.8, "Not trusted if the second best place scores more than this fraction of the best.", metavar="0..1"
    )


class TableOptions(OptionGroup, title="Output"):
    """How POSES.csv is begun, and what is written beside it."""

    resume: bool = flag(False, "Go on with POSES.csv where a call that was stopped ended.")
    overwrite: bool = flag(False, "Replace POSES.csv, if it is there.")
    tum: Path | None = flag(None, "Also write the localized poses as TUM.", metavar="FILE")


class WorkerOptions(OptionGroup, title="How it is done"):
    """Who does the work: this process if neither is given."""

    workers: int | None = flag(
        None, "Processes, about 1 GiB each; 1: all in this one. Default: as many as processors.", metavar="N", min=1
    )
    scheduler: Scheduler = None


def parse_objective(word: str) -> "Objective":
    """Return the objective of a name, or one's own, "package.module:Name": a class or an object.

    Modules are looked for in the working folder, too. OptionError if there is none.
    """
    import sys
    from importlib import import_module

    from maxcon.search.objectives import as_objective

    module_name, colon, name = word.partition(":")
    if not colon:
        return as_objective(word)
    sys.path.insert(0, "")
    try:
        found = getattr(import_module(module_name), name)
        return as_objective(found() if isinstance(found, type) else found)
    except Exception as error:  # the user's own code may fail in any way
        raise OptionError(
            f"Expected --objective {word!r} to name an objective in a module that can be imported, got"
            f" {type(error).__name__}: {error}. Write it as package.module:Name."
        ) from error
    finally:
        sys.path.remove("")
