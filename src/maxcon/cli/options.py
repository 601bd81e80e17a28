# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

__all__ = [
    "AlsoTum",
    "AtStamp",
    "Deskew",
    "GeoidHeight",
    "HeadingStepDeg",
    "MaxRange",
    "MinRange",
    "Mounting",
    "Odometry",
    "OdometryFrames",
    "OdometryTopic",
    "OverwriteTable",
    "Prior",
    "PriorFrames",
    "PriorTopic",
    "Resume",
    "Risk",
    "Scheduler",
    "Times",
    "Topic",
    "TurnTime",
    "Workers",
]

HeadingStepDeg = Annotated[float, typer.Option(metavar="DEG", help="Step between headings, degrees.")]
MinRange = Annotated[float, typer.Option(metavar="M", help="Nearer points are left out.")]
MaxRange = Annotated[float, typer.Option(metavar="M", help="Farther points are left out.")]
Prior = Annotated[
    Path | None,
    typer.Option(
        metavar="TUM|CSV|NMEA|RECORDING",
        help="Rough poses T_map_sensor, in the CRS of the map; or by latitude and longitude, in a CSV, a"
        " log of NMEA sentences (.nmea, .log, .txt), or a recording."
        " Without it the poses in the recording of the scans.",
        show_default=False,
    ),
]
Odometry = Annotated[
    Path | None,
    typer.Option(
        metavar="TUM|CSV|RECORDING",
        help="With --track or --deskew: poses in any frame that tell the motion; else the prior's own does.",
    ),
]
Topic = Annotated[str | None, typer.Option(metavar="NAME", help="Which of several point clouds of a recording.")]
PriorTopic = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Which poses of a recording are the prior: NavSatFix, Odometry, PoseStamped or PoseWithCovarianceStamped.",
    ),
]
OdometryTopic = Annotated[str | None, typer.Option(metavar="NAME", help="Which poses of a recording are the odometry.")]
PriorFrames = Annotated[
    str | None,
    typer.Option(
        metavar="FIXED:MOVING",
        help="The prior is the way of one frame in another by the recording's transforms (TF), map:base_link for"
        " example.",
    ),
]
OdometryFrames = Annotated[
    str | None, typer.Option(metavar="FIXED:MOVING", help="Likewise the odometry: odom:base_link.")
]
GeoidHeight = Annotated[
    float | None,
    typer.Option(metavar="M", help="Of the geoid above the ellipsoid: subtracted from a receiver's heights, m."),
]
Mounting = Annotated[
    Path | None,
    typer.Option(
        metavar="TOML",
        help="Where the scanner is in the vehicle, and what the prior is of, an antenna for example: the prior's poses"
        " become the scanner's.",
    ),
]
Deskew = Annotated[
    bool, typer.Option("--deskew", help="Points have times: move them to where they were at the time of their scan.")
]
AtStamp = Annotated[
    bool,
    typer.Option(
        "--at-stamp",
        help="The time of a recorded scan is its message's, not the middle between its first and its last point.",
    ),
]
TurnTime = Annotated[
    float | None,
    typer.Option(
        metavar="S",
        help="With --deskew, where points have no times: how long a turn of the scanner takes, from behind to behind,"
        " clockwise seen from above; negative for counter-clockwise.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="Processes, about 1 GiB each; 1: all in this one. Default: as many as processors, if the extra engine is"
        " installed.",
    ),
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Of a dask scheduler, tcp://HOST:8786: its workers do the work.")
]
Risk = Annotated[
    float, typer.Option(metavar="0..1", help="Errors exceed the protection level with at most this probability.")
]
Times = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Time of each scan; default times.txt there, or the names.")
]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with POSES.csv where a call that was stopped ended.")]
OverwriteTable = Annotated[bool, typer.Option("--overwrite", help="Replace POSES.csv, if it is there.")]
AlsoTum = Annotated[Path | None, typer.Option(metavar="FILE", help="Also write the localized poses as TUM.")]
