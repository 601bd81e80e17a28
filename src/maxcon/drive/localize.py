"""A drive, epoch after epoch: localized from priors of a trajectory, tracked, or found in the whole map without any."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from maxcon._system.engine import ordered_map
from maxcon.drive.motion import Motion
from maxcon.errors import ArrayError, FileError, MapError, OptionError, TrajectoryError
from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose
from maxcon.io.crs import crs_code
from maxcon.io.scans import RawScan, Scans, check_range
from maxcon.map import PointMap
from maxcon.scan import Scan
from maxcon.scan.trajectory import Trajectory

if TYPE_CHECKING:
    from maxcon.drive.tracker import Tracker
    from maxcon.relocalization import Relocalizer

MAP_MARGIN = 30.0
"""A prior farther from any voxel tile lies outside the map. A wide square may have nothing but ground (m)."""
FAR_FROM_ZERO = 10_000.0  # m; where a map lies that far out, numbers up to 180 may be degrees

# The map is told of the tiles so far (m) around the priors of so many epochs: a remote one fetches them ahead.
EPOCHS_AHEAD, METRES_AHEAD = 10, 40.0

Read = tuple[RawScan, str]  # a scan, or why it cannot be read
NOTHING_KNOWN = "there is neither a track nor a prior to begin one"


class Method(Protocol):
    """Anything that localizes a scan (D6)."""

    def localize(self, scan: Scan, point_map: PointMap, prior: Pose) -> Estimate:
        """Return the estimate of one epoch; poses in the local frame of the map."""


@dataclass(frozen=True, slots=True)
class DriveOptions:
    """Which points and which priors are used; OptionError if not 0 <= min_range < max_range.

    - min_range, max_range: points nearer or farther than this are left out, m.
    - max_gap: largest time between two poses of the prior trajectory to interpolate across, s.
    """

    min_range: float = 1.0
    max_range: float = 120.0
    max_gap: float = 0.5

    def __post_init__(self) -> None:
        check_range(self.min_range, self.max_range)


@dataclass(frozen=True, slots=True, eq=False)
class EpochEstimate:
    """The answer for one epoch of a drive.

    - epoch: number of the scan in the drive, from 0.
    - raw: what was read, and what was dropped of it.
    - status: whether the pose may be used, in a word; `status.explanation` says what to do.
    - milliseconds: from points in memory to the pose, scan normals included.
    - scan: the points localized; none once `without_points`.
    - prior: rough pose, T_map_sensor, local frame; None without one.
    - estimate: the answer, local frame; None where nothing was searched.
    - pose_global: its pose in global coordinates, in `crs`; None unless localized.
    - reason: why there is no answer, or what casts doubt on it, where the status does not say all.
    - crs: of the global pose, EPSG:25832 or the like; empty where it is not known.
    """

    epoch: int
    raw: RawScan
    status: Status
    milliseconds: float
    scan: Scan
    prior: Pose | None = None
    estimate: Estimate | None = None
    pose_global: Pose | None = None
    reason: str = ""
    crs: str = ""

    def __repr__(self) -> str:
        return f"EpochEstimate({self.epoch}, {self.status.value}, {self.pose_global}, reason={self.reason!r})"

    def without_points(self) -> EpochEstimate:
        """Return the same answer without the points, to keep over a long drive."""
        nothing = np.empty((0, 3))
        return replace(
            self,
            raw=replace(self.raw, points=nothing, point_times=None, viewpoints=None),
            scan=Scan(nothing, time=self.scan.time),
        )


def localize_drive(
    point_map: PointMap, scans: Scans, prior: Trajectory, method: Method, options: DriveOptions | None = None, *,
    first: int = 0, n_threads: int = 1,
) -> Iterator[EpochEstimate]:  # fmt: skip
    """Return an iterator over the estimates of all scans, in order of time; what cannot work is said at once.

    - scans: as many as threads are in memory at a time, and one more.
    - prior: T_map_sensor before localization, global coordinates in the CRS of the map.
    - first: number of the epoch to begin with.
    - n_threads: epochs localized at the same time; the answers and their order do not depend on it (D8). Each then
      takes longer than by itself.

    TrajectoryError if the prior has no pose for any scan; MapError if the prior lies outside the map at every scan, or
    a tile cannot be read; OptionError if there is less than one thread. A scan that cannot be read, or whose prior
    cannot be searched around, is an epoch with a status and the reason, and the drive goes on.
    """
    if n_threads < 1:
        raise OptionError(f"Expected `n_threads` >= 1, got {n_threads}. The default is 1.")
    drive = Drive.of(point_map, scans, prior, method, options or DriveOptions())
    return drive.estimates(first, len(scans), n_threads)


def track_drive(
    point_map: PointMap, scans: Scans, prior: Trajectory, tracker: Tracker, odometry: Trajectory | None = None,
    options: DriveOptions | None = None,
) -> Iterator[EpochEstimate]:  # fmt: skip
    """Return an iterator over the estimates of all scans, each searched where the one before and the motion allow.

    `prior` may have gaps: it begins a track, and tells a wrong one. Motion is that of `odometry`, T_odometry_sensor in
    any frame, or of the prior; errors as of `localize_drive`.
    """
    options = options or DriveOptions()
    poses = priors = _priors_of_scans(point_map, scans, prior, options)
    if odometry is not None:
        poses = _poses_of_scans(scans, odometry, options, "odometry")
    motions = _motions(scans.times.tolist(), poses)

    def tracked(epoch: int) -> EpochEstimate:
        read = read_epoch(scans, epoch, options)
        return tracked_epoch(point_map, tracker, epoch, read, priors[epoch], motions[epoch])

    return map(tracked, range(len(scans)))


def tracked_epoch(
    point_map: PointMap, tracker: Tracker, epoch: int, read: Read, own: Pose | None, motion: Motion | None
) -> EpochEstimate:
    """Return a tracker's answer for a scan of `read_epoch`, its `own` prior (local frame) and its motion, if known."""
    if motion is not None:
        tracker.move(motion)
    expected = own if tracker.prediction is None else tracker.prediction.pose

    def refused(scan: Scan) -> tuple[Status | None, str]:
        status = status_without_search(point_map, scan, own, expected)
        if status is None and motion is None:
            return Status.NO_PRIOR, "the motion up to this scan is not known"
        return status, NOTHING_KNOWN if status is Status.NO_PRIOR else ""

    return _answered(
        epoch, read, own or expected, point_map, refused, lambda scan: tracker.localize(scan, point_map, own)
    )


def _motions(times: Sequence[float], poses: Sequence[Pose | None]) -> list[Motion | None]:
    """Motion up to each time (s) since the last one with a pose; None where there is no pose."""
    motions: list[Motion | None] = []
    last: tuple[float, Pose] | None = None
    for at, pose in zip(times, poses, strict=True):
        if pose is None:
            motions.append(None)
            continue
        motions.append(Motion.none() if last is None else Motion.between(last[1], pose, at - last[0]))
        last = (at, pose)
    return motions


def relocalize_drive(
    scans: Scans, relocalizer: Relocalizer, options: DriveOptions | None = None, *, first: int = 0
) -> Iterator[EpochEstimate]:
    """Return an iterator over the estimates of all scans without a prior; MapError if a scanner may stand nowhere."""
    options = options or DriveOptions()
    relocalizer.check()

    def relocalized(epoch: int) -> EpochEstimate:
        told = _answered(
            epoch, read_epoch(scans, epoch, options), None, relocalizer.map,
            lambda scan: (None if len(scan) else Status.NO_POINTS, ""), relocalizer.localize,
        )  # fmt: skip
        return replace(told, estimate=None) if told.status is Status.NO_MATCH else told

    return map(relocalized, range(first, len(scans)))


@dataclass(frozen=True, slots=True)
class Drive:
    """A drive whose epochs can be localized in any order, each from its own of the `priors` (local frame)."""

    point_map: PointMap
    scans: Scans
    prior: Trajectory
    method: Method
    options: DriveOptions
    priors: list[Pose | None]

    @classmethod
    def of(cls, point_map: PointMap, scans: Scans, prior: Trajectory, method: Method, options: DriveOptions) -> Drive:
        """Return a drive with its priors found; errors as of `localize_drive`."""
        return cls(point_map, scans, prior, method, options, _priors_of_scans(point_map, scans, prior, options))

    def localize(self, epoch: int) -> EpochEstimate:
        """Return the answer for one epoch."""
        ahead = self.priors[epoch : epoch + EPOCHS_AHEAD]
        self.point_map.prefetch_around([(pose.x, pose.y) for pose in ahead if pose is not None], METRES_AHEAD)
        prior = self.priors[epoch]

        def refused(scan: Scan) -> tuple[Status | None, str]:
            status = status_without_search(self.point_map, scan, prior)
            if status is Status.NO_PRIOR:
                try:
                    self.prior.at(scan.time, self.options.max_gap)
                except TrajectoryError as error:
                    return status, str(error)
            return status, ""

        def localized(scan: Scan) -> Estimate | None:
            return None if prior is None else self.method.localize(scan, self.point_map, prior)

        read = read_epoch(self.scans, epoch, self.options)
        return _answered(epoch, read, prior, self.point_map, refused, localized)

    def estimates(self, first: int, last: int, n_threads: int = 1) -> Iterator[EpochEstimate]:
        """Yield the answers for the epochs from `first` up to, not including, `last`, in order."""
        if n_threads == 1:
            yield from map(self.localize, range(first, last))
            return
        pool = ThreadPoolExecutor(n_threads, thread_name_prefix="epoch")
        try:
            yield from ordered_map(pool, self.localize, range(first, last), n_threads + 1)
        finally:
            pool.shutdown(cancel_futures=True)


def _answered(
    epoch: int, read: Read, prior: Pose | None, point_map: PointMap,
    refused: Callable[[Scan], tuple[Status | None, str]], localize: Callable[[Scan], Estimate | None],
) -> EpochEstimate:  # fmt: skip
    """Return the timed answer for a scan of `read_epoch`; numbers that no map can hold get a status, not an error."""
    raw, reason = read
    scan = scan_of(raw)
    status, reason = (Status.UNREADABLE, reason) if reason else refused(scan)
    if status is not None:
        return EpochEstimate(epoch, raw, status, 0.0, scan, prior, reason=reason)
    start = time.perf_counter()
    try:
        estimate = localize(scan)
    except ArrayError as error:
        return EpochEstimate(epoch, raw, Status.FAILED, 0.0, scan, prior, reason=str(error))
    milliseconds = 1e3 * (time.perf_counter() - start)
    if estimate is None:
        return EpochEstimate(epoch, raw, Status.NO_PRIOR, milliseconds, scan, prior, reason=NOTHING_KNOWN)
    pose = point_map.frame.pose_to_global(estimate.pose) if estimate.is_localized else None
    crs = crs_code(point_map.frame.crs)
    return EpochEstimate(epoch, raw, estimate.status, milliseconds, scan, prior, estimate, pose, estimate.reason, crs)


def failed_epoch(epoch: int, scans: Scans, reason: str) -> EpochEstimate:
    """Return what stands for the answer of an epoch that ended the process it was given to, or never came back."""
    raw = _nothing_read(epoch, scans)
    return EpochEstimate(epoch, raw, Status.FAILED, 0.0, scan_of(raw), reason=reason)


def scan_of(raw: RawScan) -> Scan:
    """Return a scan as it is localized, of what was read of it."""
    return Scan(raw.points, time=raw.time, viewpoints=raw.viewpoints)


def read_epoch(scans: Scans, epoch: int, options: DriveOptions) -> Read:
    """Return the scan of an epoch, or one without points and the reason why it cannot be read."""
    try:
        return scans.read(epoch, options.min_range, options.max_range), ""
    except FileError as error:
        return _nothing_read(epoch, scans), str(error)


def _nothing_read(epoch: int, scans: Scans) -> RawScan:
    return RawScan(np.empty((0, 3)), float(scans.times[epoch]), scans.name(epoch), 0, 0, 0)


def status_without_search(point_map: PointMap, scan: Scan, *priors: Pose | None) -> Status | None:
    """Return why there is nothing to search for a scan around any of its priors (local frame); None if there is."""
    known = [prior for prior in priors if prior is not None]
    if not known:
        return Status.NO_PRIOR
    if not any(point_map.covers(prior.x, prior.y, MAP_MARGIN) for prior in known):
        return Status.OUTSIDE_MAP
    return Status.NO_POINTS if len(scan) == 0 else None


def pose_or_none(trajectory: Trajectory, at: float, max_gap: float) -> Pose | None:
    """Return the pose at a time (s), None where there is none: such an epoch gets a status, not an error."""
    try:
        return trajectory.at(at, max_gap)
    except TrajectoryError:
        return None


def _priors_of_scans(point_map: PointMap, scans: Scans, prior: Trajectory, options: DriveOptions) -> list[Pose | None]:
    """The prior of each scan, local frame, None where there is none; MapError if all lie outside the map."""
    priors = _poses_of_scans(scans, prior, options, "prior")
    local = [point_map.frame.pose_to_local(pose) if pose is not None else None for pose in priors]
    check_inside(point_map, local)
    return local


def _poses_of_scans(scans: Scans, trajectory: Trajectory, options: DriveOptions, what: str) -> list[Pose | None]:
    """The pose at the time of each scan, None where there is none; TrajectoryError if there is none for any."""
    poses = [pose_or_none(trajectory, float(at), options.max_gap) for at in scans.times]
    if all(pose is None for pose in poses):
        raise TrajectoryError(
            f"Expected poses of the {what} for the scans, {scans.times[0]:.3f} to {scans.times[-1]:.3f} s, but the"
            f" {what} trajectory has none near any of them ({trajectory.times[0]:.3f} to {trajectory.times[-1]:.3f} s)."
            f" Do both use the same clock? {_clocks_in_words(float(scans.times[0]), float(trajectory.times[0]))}"
            "Give the scans' times with --times, or what is to be added to the others: --time-offset."
        )
    return poses


def _clocks_in_words(first: float, other: float) -> str:
    """What two first times, s, that lie apart suggest: another unit, or whole hours between clocks."""
    for which, ratio in (("the trajectory's", other / (first or math.inf)), ("the scans'", first / (other or 1.0))):
        for unit, factor in (("ms", 1e3), ("us", 1e6), ("ns", 1e9)):
            if abs(ratio / factor - 1.0) < 0.01:
                return f"It looks as if {which} times were in {unit}. "
    hours = round((other - first) / 3600.0)
    is_whole = 0 < abs(hours) <= 14 and abs(other - first - 3600.0 * hours) < 60.0
    return f"They begin {other - first:+.3f} s apart{f', about {hours:+d} h: a time zone' * is_whole}. "


def check_inside(point_map: PointMap, priors: Sequence[Pose | None], what: str = "the prior") -> None:
    """Refuse poses (local frame) that all lie outside the map; MapError if so."""
    known = [pose for pose in priors if pose is not None]
    if any(point_map.covers(pose.x, pose.y, MAP_MARGIN) for pose in known):
        return
    first = point_map.frame.pose_to_global(known[0])
    (x_low, y_low), (x_high, y_high) = point_map.bounds
    x, y, _ = point_map.frame.to_local([[first.y, first.x, 0.0]])[0].tolist()
    low, high = point_map.frame.to_global([[x_low, y_low, 0.0], [x_high, y_high, 0.0]])
    remedy = "Are both in the same CRS?"
    if point_map.covers(x, y, MAP_MARGIN):
        remedy = "Are x and y swapped?"
    elif point_map.frame.crs and max(abs(first.x), abs(first.y)) > FAR_FROM_ZERO:
        remedy += " `maxcon localize --prior-crs` takes poses of another."
    elif max(abs(first.x), abs(first.y)) <= 180.0 and np.abs(low[:2]).max() > FAR_FROM_ZERO:
        remedy += " Degrees belong into a CSV that names them: time,latitude,longitude,... (docs/priors.md)."
    raise MapError(
        f"Expected {what} inside the map, x {low[0]:.7g} to {high[0]:.7g} and y {low[1]:.7g} to"
        f" {high[1]:.7g} m, got x {first.x:.7g}, y {first.y:.7g} m. {remedy}"
    )
