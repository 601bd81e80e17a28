"""A drive opened as the options of `maxcon localize` say, in this process or in a worker: its inputs and its method."""

import math
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from maxcon._system.engine import Engine, in_order_of
from maxcon.cli.flags import check_exclusive, check_needs
from maxcon.cli.options import (
    LARGEST_HALF_WIDTH,
    SIGMAS,
    Certainty,
    MappingDrive,
    MethodOptions,
    MotionOptions,
    RecordingOptions,
    SpaceOptions,
    parse_numbers,
)
from maxcon.cli.terminal import step_bars
from maxcon.drive.diagnosis import USUAL, above_ground, check_heights
from maxcon.drive.hypotheses import WithinSigmas
from maxcon.drive.localize import Drive, DriveOptions, EpochEstimate, read_epoch, scan_of, track_drive
from maxcon.drive.many import DriveEntry, DriveTask, ManyDrivesJob, tasks_of
from maxcon.drive.motion import MotionNoise
from maxcon.drive.tracker import Tracker
from maxcon.errors import MapError, MaxconError, OptionError, TrajectoryError
from maxcon.geometry import Pose
from maxcon.integrity import Trust
from maxcon.io.fixes import Heights, RecordedPoses
from maxcon.io.geographic_priors import is_geographic, read_geographic_prior
from maxcon.io.poses_between_crs import poses_in_crs
from maxcon.io.raw_scan import DeskewedScans, MergedScans, Scans
from maxcon.io.recordings.clouds import RecordedScans
from maxcon.io.recordings.opening import CAPTURE_SUFFIX, is_recording
from maxcon.io.recordings.poses import read_recorded_poses
from maxcon.io.recordings.transforms import parse_frames
from maxcon.io.scans import open_scans
from maxcon.io.trajectories import read_poses_of_scans, read_prior, read_trajectory
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.map.layout import ALL_BUT_KNOWN, NOT_SEARCHED
from maxcon.mapping.derived_maps import PlacedScans
from maxcon.scan.mounting import Mounting, read_mounting
from maxcon.scan.trajectory import Trajectory
from maxcon.search.objectives import Objective, as_objective, scores_of
from maxcon.search.space import PAPER_STEP_DEG, SearchSpace, rounded_up

HALF_A_TURN = 0.05  # s


@dataclass(frozen=True)
class DriveOpener:
    """The options of `maxcon localize` that are not of one drive; it is sent to the workers."""

    method: MethodOptions
    space: SpaceOptions
    recording: RecordingOptions
    motion: MotionOptions
    drive: DriveOptions
    certainty: Certainty
    threads: int = field(repr=False)  # of no effect on the rows: not written down with them

    @property
    def is_track(self) -> bool:
        """Whether an epoch needs those before it."""
        return self.motion.track

    def open_map(self, path: Path | str) -> PointMap:
        """Open a map."""
        return PointMap.open(path, left_out=ALL_BUT_KNOWN if self.method.known_only else NOT_SEARCHED)

    def open(self, entry: DriveEntry, point_map: PointMap, *, quiet: bool = True) -> "OpenedDrive":
        """Return a drive with its inputs opened; MaxconError if one cannot be read, or an option does not fit it."""
        mounting = None if self.recording.mounting is None else read_mounting(self.recording.mounting)
        scans = self._scans(entry, mounting)
        frame = frame_of(scans, mounting)
        if self.recording.at is not None:
            prior = _prior_at(point_map, self.recording.at, scans, mounting)
        else:
            prior = _prior(point_map, entry, self.recording, mounting, frame)
        later = self.recording.time_offset
        prior = replace(prior, trajectory=prior.trajectory.later(later))
        odometry, odometry_words = _odometry(entry.odometry, self.recording, mounting, frame)
        odometry = odometry and odometry.later(later)
        words = [*_words_of(scans, quiet), prior.words, odometry_words]
        if self.is_track and odometry is not None and MotionNoise.of_odometry(odometry) != MotionNoise():
            words.append("the odometry jumps as no vehicle does: it is trusted that much less")
        if self.motion.deskew:
            source = prior.trajectory if odometry is None else odometry
            scans = DeskewedScans(scans, source, self.drive.max_gap, self.motion.turn_time)
            words.append(f"deskewed by the {'prior' if odometry is None else 'odometry'}")

        how, certainty = self.method, self.certainty
        method = MaximumConsensus(
            _fixed_space(self.space), objective=parse_objective(how.objective), multiplicity=how.multiplicity,
            n_threads=self.threads if self.is_track else 1,
            trust=Trust(certainty.least_share, certainty.largest_runner_up), weighting=how.weighting, search=how.search,
            thinning=how.thinning, refinement=how.refinement, wider=self.space.wider, risk=certainty.risk,
        )  # fmt: skip
        windows = _within_sigmas(self.space, method, prior.trajectory, self.drive.max_gap, track=self.is_track)
        if self.is_track and windows is not None:
            method, windows = windows.at(float(prior.trajectory.times[0])), None
        told = tuple(filter(None, words))
        return OpenedDrive(self, entry, point_map, scans, prior, odometry, told, method, windows)

    def _scans(self, entry: DriveEntry, mounting: Mounting | None) -> Scans:
        """The scans of a drive; of several scanners in the vehicle's frame."""
        options = self.recording
        if mounting is None or not mounting.scanners:
            return open_scans(entry.scans, entry.times, topic=options.topic, at_stamp=options.at_stamp)
        of_one = {"--topic": options.topic, "--times": entry.times, "--turn-time": self.motion.turn_time}
        check_exclusive({f"several scanners, as in {options.mounting},": True}, of_one)
        parts = mounting.scanners
        opened = [open_scans(part.scans or entry.scans, topic=part.topic, at_stamp=options.at_stamp) for part in parts]
        return MergedScans(opened, [part.T_vehicle_sensor for part in parts], [part.name for part in parts])


@dataclass
class OpenedDrive:
    """A drive with its inputs opened; its priors are looked at when the first epoch is asked for."""

    opener: DriveOpener
    entry: DriveEntry
    point_map: PointMap
    scans: Scans
    # prior, odometry: of the scanner
    prior: RecordedPoses
    odometry: Trajectory | None
    words: tuple[str, ...]  # what was taken from a recording
    # method, windows: the first searches, or the other, within standard deviations of each prior
    method: MaximumConsensus
    windows: WithinSigmas | None

    @property
    def searching(self) -> WithinSigmas | MaximumConsensus:
        """What searches first."""
        return self.windows or self.method

    def estimates(self, first: int = 0, last: int | None = None) -> Iterator[EpochEstimate]:
        """Localize the epochs `first` to `last` - 1; a track from its beginning to its end."""
        if not self.opener.is_track:
            return self.drive.estimates(first, len(self.scans) if last is None else last, self.opener.threads)

        prior, drift = self.prior.trajectory, self.opener.motion.drift
        noise = MotionNoise.of_prior(prior) if self.odometry is None else MotionNoise.of_odometry(self.odometry, drift)
        tracker = Tracker(self.method, noise)
        with self._naming_files():
            return track_drive(self.point_map, self.scans, prior, tracker, self.odometry, self.opener.drive)

    @cached_property
    def drive(self) -> Drive:
        """The drive with its priors found; what cannot work is said, with the files."""
        with self._naming_files():
            return Drive.of(self.point_map, self.scans, self.prior.trajectory, self.searching, self.opener.drive)

    def with_points(self, epoch: EpochEstimate) -> EpochEstimate:
        """Return an answer that came back without its points with them."""
        raw, _ = read_epoch(self.scans, epoch.epoch, self.opener.drive)
        return replace(epoch, raw=raw, scan=scan_of(raw))

    @contextmanager
    def _naming_files(self) -> Iterator[None]:
        """Put the names of the files before what the library says of a prior that fits neither scans nor map."""
        prior = self.entry.odometry or self.entry.prior or self.entry.scans
        try:
            yield
        except TrajectoryError as error:
            raise TrajectoryError(f"{prior} and {self.entry.scans}: {error}") from error
        except MapError as error:
            raise MapError(f"{prior} and {self.entry.map}: {error}") from error


def by_workers(opened: OpenedDrive, engine: Engine, first: int, with_points: frozenset[int]) -> Iterator[EpochEstimate]:
    """Yield the epochs from one on, in order, localized by workers; points of those `with_points` are read again."""
    epochs = range(first, len(opened.drive.scans))  # what cannot work is said before anything is started
    found = in_order_of(epochs, _done(opened, engine, list(tasks_of(opened.entry, epochs))))
    return (opened.with_points(epoch) if epoch.epoch in with_points else epoch for epoch in found)


def _done(opened: OpenedDrive, engine: Engine, tasks: list[DriveTask]) -> Iterator[tuple[int, EpochEstimate]]:
    """Yield epochs with their numbers as they are done; MaxconError where a task cannot be."""
    for _, found in engine.run(ManyDrivesJob(opened.opener), tasks, len(tasks)):
        if isinstance(found, str):
            raise MaxconError(found)
        yield from ((epoch.epoch, epoch) for epoch in found)


def frame_of(scans: Scans, mounting: Mounting | None) -> str:
    """Return the name of the scanner's frame, if a recording has to tell where it is on the vehicle; else nothing."""
    return scans.source.frame if mounting is None and isinstance(scans, RecordedScans) else ""


def _words_of(scans: Scans, quiet: bool) -> list[str]:
    """What was taken from a recording; the times of its scans are found here, with a bar of progress."""
    words = []
    for part in scans.scanners if isinstance(scans, MergedScans) else (scans,):
        if isinstance(part, RecordedScans):
            with step_bars(quiet) as report:
                part.find_times(report)
            words.append(part.words)
    return [*words, scans.words] if isinstance(scans, MergedScans) else words


def _prior_at(point_map: PointMap, at: str, scans: Scans, mounting: Mounting | None) -> RecordedPoses:
    """The rough pose of the one scan: level, as high above the map's ground as scanners usually are."""
    x, y, heading_deg = parse_numbers(at, "--at", "X,Y,HEADING_DEG", "549980,5801820,90")
    if len(scans) != 1:
        raise OptionError(f"Expected one scan with --at, got {len(scans)}. Name the file of one, or give --prior.")
    prior = Trajectory.from_poses(scans.times, [Pose(x, y, 0.0, 0.0, 0.0, math.radians(heading_deg))])
    if mounting is not None:
        prior = mounting.of_prior(prior)
    off = above_ground(point_map, point_map.frame.to_local(prior.positions)) - USUAL
    if math.isnan(off):
        raise OptionError(f"Expected --at where the map has ground, got {at}. Is it in its CRS? Else give --prior.")
    return RecordedPoses(replace(prior, positions=prior.positions - [0.0, 0.0, off]))


def _prior(
    point_map: PointMap, entry: DriveEntry, options: RecordingOptions, mounting: Mounting | None, sensor_frame: str
) -> RecordedPoses:
    """Rough poses of the scanner."""
    crs, asked = point_map.frame.crs, {"--prior-topic": options.prior_topic, "--prior-frames": options.prior_frames}
    source = entry.prior or entry.scans
    if entry.prior is None and (not is_recording(source) or source.suffix.lower() == CAPTURE_SUFFIX):
        raise OptionError(
            f"Expected --prior with rough poses beside {entry.scans}, got none. Give it, or of one scan --at; only"
            " recordings with poses in them do without."
        )
    frames = options.prior_frames and parse_frames(options.prior_frames, "--prior-frames")
    how = {"topic": options.prior_topic, "frames": frames or None, "sensor_frame": sensor_frame}
    poses = read_rough_poses(source, crs, options.geoid_height, asked, are_sure=mounting is not None, **how)
    if options.prior_crs is not None:
        if poses.operation is not None:
            raise OptionError(f"Expected no --prior-crs with latitudes and longitudes, as in {source}. Leave it out.")
        trajectory, words = poses_in_crs(poses.trajectory, options.prior_crs, crs, str(source))
        poses = replace(poses, trajectory=trajectory, words="; ".join(filter(None, [poses.words, words])))
    trajectory = poses.trajectory
    if mounting is not None:
        trajectory = mounting.of_prior(trajectory, has_orientations=poses.has_orientations)
    if poses.heights is not None:
        try:
            check_heights(point_map, trajectory, are_orthometric=poses.heights is Heights.ORTHOMETRIC)
        except TrajectoryError as error:
            raise TrajectoryError(f"{error} The prior: {poses.words}.") from error
    return replace(poses, trajectory=trajectory, words=poses.words and f"prior: {poses.words}")


def read_rough_poses(
    path: Path, crs: str | None, geoid_height: float | None, asked: Mapping[str, str | None], *,
    are_sure: bool, **how: Any,
) -> RecordedPoses:  # fmt: skip
    """Return the poses of a recording (`asked` are options of those alone), a table or a log, as they are there."""
    if is_recording(path) and path.suffix.lower() != CAPTURE_SUFFIX:
        return read_recorded_poses(path, crs=crs, geoid_height=geoid_height, are_sure=are_sure, **how)
    check_exclusive({f"{path}, which is no recording,": True}, asked)
    if not is_recording(path) and is_geographic(path):
        return read_geographic_prior(path, crs, geoid_height, are_sure=are_sure)
    check_exclusive({f"{path}, which is not in latitude and longitude,": True}, {"--geoid-height": geoid_height})
    return read_prior(path)


def _odometry(
    source: Path | None, options: RecordingOptions, mounting: Mounting | None, sensor_frame: str
) -> tuple[Trajectory | None, str]:
    """The odometry of the scanner, if there is any, and what of a recording it is."""
    is_recorded = source is not None and is_recording(source)
    asked = {"--odometry-topic": options.odometry_topic, "--odometry-frames": options.odometry_frames}
    check_needs(asked, {"--odometry and a recording": is_recorded})
    if source is None:
        return None, ""
    if not is_recorded:
        trajectory, words = read_trajectory(source), ""
    else:
        frames = options.odometry_frames and parse_frames(options.odometry_frames, "--odometry-frames")
        poses = read_recorded_poses(
            source, options.odometry_topic, is_odometry=True, frames=frames or None, sensor_frame=sensor_frame
        )
        trajectory, words = poses.trajectory, f"odometry: {poses.words}"
    return trajectory if mounting is None else mounting.of_odometry(trajectory), words


def _fixed_space(given: SpaceOptions) -> SearchSpace:
    """The space of the half widths, the usual ones if not given, rounded up to whole steps."""

    def in_steps(reach: float | None, usual: float, step: float | None) -> float:
        reach = usual if reach is None else reach
        # What makes no sense stays as it is, to be refused in words.
        makes_sense = 0.0 <= reach < math.inf and (step is None or 0.0 < step < math.inf)
        return rounded_up(reach, step) if makes_sense else reach

    usual, cell = SearchSpace(), given.cell
    step_deg = PAPER_STEP_DEG if given.heading_step_deg is None and cell else given.heading_step_deg
    half_width, height = (
        in_steps(given.half_width, usual.half_width, cell),
        in_steps(given.height_half_width, 0.0, cell),
    )
    turn = in_steps(given.heading_half_width_deg, usual.heading_half_width_deg, step_deg)
    return SearchSpace(half_width, cell, turn, given.heading_step_deg, height)


def _within_sigmas(
    given: SpaceOptions, method: MaximumConsensus, prior: Trajectory, max_gap: float, *, track: bool
) -> WithinSigmas | None:
    """What searches within standard deviations, given or of the prior; None for half widths, those of tracks."""
    if given.sigma_position is not None and given.sigma_heading_deg is not None:
        variances = np.square([given.sigma_position, given.sigma_position, math.radians(given.sigma_heading_deg)])
        covariances = np.tile(np.diag(variances), (len(prior), 1, 1))
        prior = Trajectory(prior.times, prior.positions, prior.quaternions_xyzw, covariances)
    elif given.half_width is not None or given.heading_half_width_deg is not None:
        return None
    elif track or prior.covariances is None:
        numbers = {"--sigmas": given.sigmas, "--largest-half-width": given.largest_half_width}
        # Neither is there, or it would not have come to this.
        check_needs(numbers, {"--sigma-position": None, "a CSV prior with covariances and no --track": None})
        return None
    largest = LARGEST_HALF_WIDTH if given.largest_half_width is None else given.largest_half_width
    return WithinSigmas(method, prior, SIGMAS if given.sigmas is None else given.sigmas, largest, max_gap)


def placed_scans(drive: MappingDrive, path: Path, poses_path: Path, quiet: bool) -> PlacedScans:
    """Return scans that a map is made of, placed by their poses."""
    mounting = None if drive.mounting is None else read_mounting(drive.mounting)
    if mounting is not None and mounting.scanners:
        raise OptionError(f"Expected one scanner, [sensor], in {drive.mounting}, got several. Build a map of one.")
    scans = open_scans(path, drive.times, topic=drive.topic, at_stamp=drive.at_stamp)
    _words_of(scans, quiet)
    check_needs({"--poses-topic": drive.poses_topic}, {"a recording as --poses": is_recording(poses_path)})
    if is_recording(poses_path):
        frame = frame_of(scans, mounting)
        poses = read_recorded_poses(poses_path, drive.poses_topic, is_odometry=True, sensor_frame=frame).trajectory
    else:
        poses = read_poses_of_scans(poses_path, scans.times)
    if mounting is not None:
        poses = mounting.of_odometry(poses)
    opened = DeskewedScans(scans, poses, turn_time=drive.turn_time) if drive.deskew else scans
    return PlacedScans(
        opened, poses, path, min_range=drive.min_range, max_range=drive.max_range,
        margin=HALF_A_TURN if drive.deskew else 0.0, poses_path=poses_path,
    )  # fmt: skip


def parse_objective(word: str) -> Objective:
    """Return the objective of a name, or one's own, "package.module:Name", also of the working folder."""
    module_name, colon, name = word.partition(":")
    if not colon:
        return as_objective(word)
    sys.path.insert(0, "")
    try:
        found = getattr(import_module(module_name), name)
        objective = as_objective(found() if isinstance(found, type) else found)
    except OptionError:
        raise
    except Exception as error:  # the user's own code may fail in any way
        raise OptionError(
            f"Expected {word!r} to name an objective in a module that can be imported, got"
            f" {type(error).__name__}: {error}. Write it as package.module:Name."
        ) from error
    finally:
        sys.path.remove("")
        if "" not in sys.path:
            sys.path.append("")  # where workers look for it, too
    scores_of(objective, np.array([[[[9.0, 5.0, 1.0, 4.0], [4.0, 3.0, 0.0, 1.0]]]]))  # fails before work begins
    return objective
