# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What `maxcon localize` reads: scans, priors and odometry, each from files or from a recording."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from maxcon.cli.options import MotionOptions, RecordingOptions
from maxcon.cli.terminal import step_bars
from maxcon.errors import MapError, OptionError, TrajectoryError

if TYPE_CHECKING:
    from maxcon.drive.many import DriveEntry
    from maxcon.io.raw_scan import MergedScans
    from maxcon.io.scans import Scans
    from maxcon.map import PointMap
    from maxcon.scan.mounting import Mounting
    from maxcon.scan.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class DriveInputs:
    """The inputs of a drive, and in words what was taken from a recording."""

    scans: "Scans"
    prior: "Trajectory"
    odometry: "Trajectory | None"
    words: tuple[str, ...]
    left_out: tuple[str, ...] = ()

    @classmethod
    def open(
        cls,
        point_map: "PointMap",
        entry: "DriveEntry",
        max_gap: float,
        options: RecordingOptions,
        motion: MotionOptions,
        *,
        quiet: bool = False,
    ) -> "DriveInputs":
        """Return the inputs of a drive; OptionError if there is no prior, or an option has nothing to act on."""
        from maxcon.io.raw_scan import DeskewedScans
        from maxcon.io.scans import open_scans
        from maxcon.scan.mounting import read_mounting

        options.check()
        motion.check_turn_time()
        mounting = None if options.mounting is None else read_mounting(options.mounting)
        if mounting is not None and mounting.scanners:
            opened: Scans = _of_scanners(entry, options, motion, mounting)
        else:
            opened = open_scans(entry.scans, entry.times, topic=options.topic, at_stamp=options.at_stamp)
        frame = _frame_of(opened) if mounting is None else ""
        prior, prior_words, left_out = _prior(point_map, entry, options, mounting, frame)
        odometry, odometry_words = _odometry(entry.odometry, options, frame)
        if mounting is not None and odometry is not None:
            odometry = mounting.of_odometry(odometry)
        words = [*_words_of(opened, quiet), prior_words, odometry_words]
        if motion.deskew:
            opened = DeskewedScans(opened, prior if odometry is None else odometry, max_gap, motion.turn_time)
            words.append(f"deskewed by the {'prior' if odometry is None else 'odometry'}")
        return cls(opened, prior, odometry, tuple(filter(None, words)), left_out)

    def tell(self) -> None:
        """Print what was taken from a recording."""
        for line in self.words:
            typer.echo(line)


def _of_scanners(
    entry: "DriveEntry", options: RecordingOptions, motion: MotionOptions, mounting: "Mounting"
) -> "MergedScans":
    """The scans of several scanners, in the vehicle's frame."""
    from maxcon.io.raw_scan import MergedScans
    from maxcon.io.scans import open_scans

    given = {"--topic": options.topic, "--times": entry.times, "--turn-time": motion.turn_time}
    for name in [name for name, value in given.items() if value is not None]:
        raise OptionError(
            f"Expected several scanners, as {options.mounting} tells of them, got {name}, which is for one. Leave it"
            " out."
        )
    scanners = mounting.scanners
    opened = [
        open_scans(scanner.scans or entry.scans, topic=scanner.topic, at_stamp=options.at_stamp) for scanner in scanners
    ]
    return MergedScans(
        opened, [scanner.T_vehicle_sensor for scanner in scanners], [scanner.name for scanner in scanners]
    )


def _frame_of(scans: "Scans") -> str:
    """Name of the scanner's frame, where a recording tells it."""
    from maxcon.io.recordings.recorded_scans import RecordedScans

    return scans.source.frame if isinstance(scans, RecordedScans) else ""


def _words_of(scans: "Scans", quiet: bool) -> list[str]:
    """What was taken from a recording; the times of its scans are found here, with a bar of progress."""
    from maxcon.io.raw_scan import MergedScans
    from maxcon.io.recordings.recorded_scans import RecordedScans

    words = []
    for part in scans.scanners if isinstance(scans, MergedScans) else (scans,):
        if isinstance(part, RecordedScans):
            with step_bars("scans", quiet) as report:
                part.find_times(report)
            words.append(part.words)
    return [*words, scans.words] if isinstance(scans, MergedScans) else words


def _prior(
    point_map: "PointMap",
    entry: "DriveEntry",
    options: RecordingOptions,
    mounting: "Mounting | None",
    sensor_frame: str,
) -> "tuple[Trajectory, str, tuple[str, ...]]":
    """The prior of the scanner; what it is in words, where that is not plain; rows that are no poses."""
    from maxcon.io.geographic_priors import is_geographic
    from maxcon.io.recordings.opening import CAPTURE_SUFFIX, is_recording
    from maxcon.io.trajectories import read_prior

    prior = entry.prior
    source = entry.scans if prior is None else prior
    if is_recording(source) and source.suffix.lower() != CAPTURE_SUFFIX:
        return _recorded_prior(source, point_map, options, mounting, sensor_frame)
    if prior is None:
        raise OptionError(
            f"Expected --prior with rough poses beside {entry.scans}, got none. Give it; only recordings with poses in"
            " them do without."
        )
    of_recordings = {"--prior-topic": options.prior_topic, "--prior-frames": options.prior_frames}
    _check_without(of_recordings, "a recording", prior)
    if not is_recording(prior) and is_geographic(prior):
        return _geographic_prior(prior, point_map, options, mounting)
    _check_without({"--geoid-height": options.geoid_height}, "a receiver (in latitude and longitude)", prior)
    read = read_prior(prior)
    return _of_sensor(read.trajectory, mounting), "", read.left_out


def _recorded_prior(
    source: Path, point_map: "PointMap", options: RecordingOptions, mounting: "Mounting | None", sensor_frame: str
) -> "tuple[Trajectory, str, tuple[str, ...]]":
    from maxcon.drive.diagnosis import check_heights
    from maxcon.io.recordings.poses import read_recorded_poses
    from maxcon.io.recordings.transforms import parse_frames

    frames = None if options.prior_frames is None else parse_frames(options.prior_frames, "--prior-frames")
    poses = read_recorded_poses(
        source, options.prior_topic, point_map.frame.crs, options.geoid_height,
        are_sure=mounting is not None, frames=frames, sensor_frame=sensor_frame,
    )  # fmt: skip
    trajectory = _of_sensor(poses.trajectory, mounting, has_orientations=poses.has_orientations)
    if poses.has_ellipsoidal_heights:
        check_heights(point_map, trajectory)
    return trajectory, f"prior: {poses.words}", ()


def _geographic_prior(
    prior: Path, point_map: "PointMap", options: RecordingOptions, mounting: "Mounting | None"
) -> "tuple[Trajectory, str, tuple[str, ...]]":
    from maxcon.drive.diagnosis import check_heights
    from maxcon.io.fixes import Heights
    from maxcon.io.geographic_priors import read_geographic_prior

    placed = read_geographic_prior(prior, point_map.frame.crs, options.geoid_height, are_sure=mounting is not None)
    trajectory = _of_sensor(placed.trajectory, mounting, has_orientations=placed.has_orientations)
    if placed.heights is not None:
        check_heights(point_map, trajectory, are_orthometric=placed.heights is Heights.ORTHOMETRIC)
    return trajectory, f"prior: {placed.words}", placed.left_out


def _check_without(given: Mapping[str, object], what: str, prior: Path) -> None:
    """Refuse options that act on priors of another kind."""
    for name in [name for name, value in given.items() if value is not None]:
        raise OptionError(f"Expected {name} with priors of {what}, got it with {prior}. Leave it out.")


def _of_sensor(trajectory: "Trajectory", mounting: "Mounting | None", *, has_orientations: bool = True) -> "Trajectory":
    """The poses of the scanner, from those of what the prior is of."""
    if mounting is None:
        return trajectory
    return mounting.of_prior(trajectory, has_orientations=has_orientations)


def _odometry(odometry: Path | None, options: RecordingOptions, sensor_frame: str) -> "tuple[Trajectory | None, str]":
    from maxcon.io.recordings.opening import is_recording
    from maxcon.io.recordings.poses import read_recorded_poses
    from maxcon.io.recordings.transforms import parse_frames
    from maxcon.io.trajectories import read_trajectory

    topic, frames = options.odometry_topic, options.odometry_frames
    if odometry is None or not is_recording(odometry):
        for name, value in (("topic", topic), ("frames", frames)):
            if value is not None:
                raise OptionError(
                    f"Expected --odometry-{name} together with --odometry and a recording, got it alone. Add that, or"
                    " leave it out."
                )
        return None if odometry is None else read_trajectory(odometry), ""
    parsed = None if frames is None else parse_frames(frames, "--odometry-frames")
    poses = read_recorded_poses(odometry, topic, is_odometry=True, frames=parsed, sensor_frame=sensor_frame)
    return poses.trajectory, f"odometry: {poses.words}"


@contextmanager
def naming_files(prior: Path, scans: Path, map_folder: Path | str) -> Iterator[None]:
    """Put the names of the files before what the library says of a prior that fits neither scans nor map."""
    try:
        yield
    except TrajectoryError as error:
        raise TrajectoryError(f"{prior} and {scans}: {error}") from error
    except MapError as error:
        raise MapError(f"{prior} and {map_folder}: {error}") from error
