# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The scans and poses that `maxcon map build` makes a map of."""

from pathlib import Path
from typing import TYPE_CHECKING

from maxcon.cli.flags import OptionGroup, check_needs, flag
from maxcon.cli.options import AtStamp, MaxRange, MinRange, Times, Topic, TurnTime, check_turn_time
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
    times: Times = None
    topic: Topic = None
    at_stamp: AtStamp = False
    poses_topic: str | None = flag(None, "Which poses of a recording.", metavar="NAME")
    mounting: Path | None = flag(
        None, "Where [sensor] and [odometry] are in the vehicle, if the poses are not the scanner's.", metavar="TOML"
    )
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

    def open(self, quiet: bool) -> "PlacedScans | None":
        """Return the scans, placed by their poses; None if there are none."""
        if self.scans is None or self.poses is None:
            return None
        from maxcon.cli.drive_inputs import frame_of
        from maxcon.io.raw_scan import DeskewedScans
        from maxcon.io.recordings.clouds import RecordedScans
        from maxcon.io.recordings.opening import is_recording
        from maxcon.io.recordings.poses import read_recorded_poses
        from maxcon.io.scans import open_scans
        from maxcon.io.trajectories import read_poses_of_scans
        from maxcon.mapping.placed_scans import PlacedScans
        from maxcon.scan.mounting import read_mounting

        mounting = None if self.mounting is None else read_mounting(self.mounting)
        if mounting is not None and mounting.scanners:
            raise OptionError(
                f"Expected one scanner, [sensor], in {self.mounting}, got several. Build the map of one of them."
            )
        scans = open_scans(self.scans, self.times, topic=self.topic, at_stamp=self.at_stamp)
        frame = frame_of(scans, mounting)
        if isinstance(scans, RecordedScans):
            with step_bars(quiet) as report:
                scans.find_times(report)
        check_needs({"--poses-topic": self.poses_topic}, {"a recording as --poses": is_recording(self.poses)})
        if is_recording(self.poses):
            poses = read_recorded_poses(self.poses, self.poses_topic, is_odometry=True, sensor_frame=frame).trajectory
        else:
            poses = read_poses_of_scans(self.poses, scans.times)
        if mounting is not None:
            poses = mounting.of_odometry(poses)
        opened = DeskewedScans(scans, poses, turn_time=self.turn_time) if self.deskew else scans
        return PlacedScans(
            opened, poses, self.scans, min_range=self.min_range, max_range=self.max_range,
            margin=HALF_A_TURN if self.deskew else 0.0, poses_path=self.poses,
        )  # fmt: skip
