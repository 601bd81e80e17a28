# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The scans and poses that `maxcon map build` makes a map of."""

from pathlib import Path
from typing import TYPE_CHECKING

from maxcon.cli.flags import OptionGroup, check_needs, flag
from maxcon.cli.options import AtStamp, Topic
from maxcon.cli.terminal import step_bars
from maxcon.errors import OptionError

if TYPE_CHECKING:
    from maxcon.mapping.placed_scans import PlacedScans


HALF_A_TURN = 0.05  # s


class DriveOptions(OptionGroup, title="Scans instead of clouds"):
    """A drive that a map is made of."""

    scans: Path | None = flag(
        None, "Scans as `maxcon localize` takes them: a folder, or a recording.", metavar="FOLDER|RECORDING"
    )
    poses: Path | None = flag(
        None,
        "Where the scanner was, of a SLAM program for example: with times, interpolated; or KITTI's 12 numbers a line,"
        " one line per scan. z is up.",
        metavar="TUM|CSV|KITTI|RECORDING",
    )
    times: Path | None = flag(None, "Time of each scan; default times.txt there, or the names.", metavar="FILE")
    topic: Topic = None
    at_stamp: AtStamp = False
    poses_topic: str | None = flag(None, "Which poses of a recording.", metavar="NAME")
    mounting: Path | None = flag(
        None, "Where [sensor] and [odometry] are in the vehicle, if the poses are not the scanner's.", metavar="TOML"
    )
    deskew: bool = flag(False, "Points have times, and are not deskewed: move them by the poses.")
    turn_time: float | None = flag(
        None, "With --deskew, where points have no times: as of `maxcon localize`.", metavar="S"
    )
    min_range: float = flag(1.0, "Points nearer to the scanner are left out.", metavar="M")
    max_range: float = flag(120.0, "Points farther away are left out.", metavar="M")
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
        check_needs({"--turn-time": self.turn_time}, {"--deskew": self.deskew})

    def open(self, quiet: bool) -> "PlacedScans | None":
        """Return the scans, placed by their poses; None if there are none."""
        if self.scans is None or self.poses is None:
            return None
        from maxcon.io.raw_scan import DeskewedScans
        from maxcon.io.recordings.opening import is_recording
        from maxcon.io.recordings.poses import read_recorded_poses
        from maxcon.io.recordings.recorded_scans import RecordedScans
        from maxcon.io.scans import open_scans
        from maxcon.io.trajectories import read_poses_of_scans
        from maxcon.mapping.placed_scans import PlacedScans
        from maxcon.scan.mounting import read_mounting

        scans = open_scans(self.scans, self.times, topic=self.topic, at_stamp=self.at_stamp)
        frame = ""
        if isinstance(scans, RecordedScans):
            frame = scans.source.frame
            with step_bars(quiet) as report:
                scans.find_times(report)
        check_needs({"--poses-topic": self.poses_topic}, {"a recording as --poses": is_recording(self.poses)})
        if is_recording(self.poses):
            poses = read_recorded_poses(self.poses, self.poses_topic, is_odometry=True, sensor_frame=frame).trajectory
        else:
            poses = read_poses_of_scans(self.poses, scans.times)
        if self.mounting is not None:
            mounting = read_mounting(self.mounting)
            if mounting.scanners:
                raise OptionError(
                    f"Expected one scanner, [sensor], in {self.mounting}, got several. Build the map of one of them."
                )
            poses = mounting.of_odometry(poses)
        opened = DeskewedScans(scans, poses, turn_time=self.turn_time) if self.deskew else scans
        return PlacedScans(
            opened, poses, self.scans, min_range=self.min_range, max_range=self.max_range,
            margin=HALF_A_TURN if self.deskew else 0.0, poses_path=self.poses,
        )  # fmt: skip
