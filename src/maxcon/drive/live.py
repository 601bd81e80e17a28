"""LiveLocalizer: scans, odometry and positions go in as they come; a pose comes out for each scan."""

from __future__ import annotations

import math
import threading
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from maxcon.drive.live_inbox import MEMORY, LiveCounts, LiveInbox, LiveOptions, Position, Taken, WaitingScan, pose_near
from maxcon.drive.localize import DriveOptions, EpochEstimate, Read, pose_or_none, tracked_epoch
from maxcon.drive.motion import Motion, MotionNoise, UncertainPose
from maxcon.drive.tracker import Tracker
from maxcon.errors import ArrayError, MapError, MaxconError, TrajectoryError
from maxcon.estimate import Status
from maxcon.geometry import Pose
from maxcon.geometry.arrays import as_points
from maxcon.io.raw_scan import RawScan
from maxcon.localizer import MaximumConsensus
from maxcon.map import PointMap
from maxcon.map.tile import n_waited_for
from maxcon.relocalization import Relocalizer
from maxcon.scan import Scan
from maxcon.scan.deskew import deskew
from maxcon.scan.trajectory import Trajectory
from maxcon.search.coarse import CELL

# A prior is moved on by the odometry for so long, and a position used for so long, s; without odometry the vehicle may
# have driven at this speed since, m/s. Beside so many of its sigmas a position may be off by this, m.
LONGEST_AGE, FASTEST, SIGMAS, ROOM = 2.0, 30.0, 3.0, 1.0
FEWEST_OFF = 2  # positions in a row that are believed against a track
# What is known of a place that was found without a prior, before it is tracked: x, y, z (m), roll, pitch and heading.
START = np.diag(np.square([0.1, 0.1, 1.0, *np.radians([1.0, 1.0, 0.5])]))
LARGEST = 1e12  # s, or m: a larger number is none of a vehicle, and squares of it leave the range of floats
LOOK_EVERY = 0.005  # s between looks at whether a scan has waited long enough
# The map is loaded before it is needed, within so many metres one after the other, once the vehicle is so much farther.
METRES_AHEAD, EVERY_METRES = (50.0, 100.0, 150.0), 5.0
# At first an answer that comes later, s, is a rehearsal, in which code and tiles are loaded: it is not given. So many
# are at most.
IN_TIME, MOST_REHEARSALS = 0.08, 10
REHEARSED = 20  # one of so many points of a tile is rehearsed with
LONGEST_WAIT = 0.06  # s; scans that wait longer, and longer than the delay, are dropped: the next one is nearer to now


class Effort(NamedTuple):
    """What an answer took.

    - processor_ms: processor time of its thread: less than `epoch.milliseconds` where others had the processor.
    - n_tiles: tiles that were not in memory yet, so that it had to load them.
    - half_width: how far around its prediction or prior the scan was searched for, m.
    """

    processor_ms: float
    n_tiles: int
    half_width: float


@dataclass(frozen=True, slots=True, eq=False)
class LiveAnswer:
    """The answer for a scan.

    - epoch: pose, covariance, status and reason, as of a drive; its number counts the answers.
    - T_map_odom: what puts poses of the odometry into the local frame of the map, by the last scan that was localized;
      None before there is one, or without odometry.
    - counts: of scans so far.
    - effort: what it took.
    """

    epoch: EpochEstimate
    T_map_odom: Pose | None
    counts: LiveCounts
    effort: Effort


class _Around(NamedTuple):
    """The last position, how far it may be off, m, and where the sensor was then, seen from where it is."""

    position: Position
    reach: float
    moved: Pose

    @property
    def circle(self) -> tuple[tuple[float, float], float]:
        """Middle and radius (m) of a circle in which the sensor is."""
        return (self.position.x, self.position.y), self.reach + math.hypot(self.moved.x, self.moved.y)

    def is_off(self, pose: Pose) -> bool:
        """Whether the position speaks against a pose of the sensor now."""
        then = pose @ self.moved
        return math.hypot(then.x - self.position.x, then.y - self.position.y) > self.reach


class LiveLocalizer:
    """Localizes scans as they come: it starts lost, tracks, doubts, and finds itself again.

    `add_scan`, `add_odometry`, `add_prior` and `add_position` take what comes, in any order, from any thread; `answers`
    yields an answer for each scan that need not wait any longer, the same as `track_drive` gives. Where there is
    neither a track nor a prior, the map is searched without one: the whole, or around the last position.

    Stamps are in s, of one clock for all. Where a method takes `now`, that is when it is called, s, of any clock that
    does not jump: the machine's if not given.

    Parameters
    ----------
    point_map : PointMap
        The map; with ground, if it is to be searched without a prior.
    method : MaximumConsensus, optional
        How scans are compared with the map.
    noise : MotionNoise, optional
        Of the odometry; of priors, where they tell the motion.
    options : LiveOptions, optional
        How messages are waited for.
    drive : DriveOptions, optional
        Which points are used, and the largest gap in odometry and priors.

    Raises
    ------
    ArrayError
        From methods that take what comes, if a shape is wrong, or a number not finite or above 1e12.
    """

    def __init__(
        self, point_map: PointMap, method: MaximumConsensus | None = None, noise: MotionNoise | None = None,
        options: LiveOptions | None = None, *, drive: DriveOptions | None = None,
    ) -> None:  # fmt: skip
        self.map, self.options, self.drive = point_map, options or LiveOptions(), drive or DriveOptions()
        self._method, self._noise = method or MaximumConsensus(), noise or MotionNoise()
        n_threads = self._method.n_threads
        self._relocalizer = Relocalizer(point_map, n_threads=n_threads) if point_map.has_ground else None
        self._inbox = LiveInbox(self.options)
        self._puts_off = False  # whether answers come before what may as well be done after them
        self._n_restarts = 0
        self._correction: Pose | None = None
        self._place: tuple[float, float] | None = None  # of the last answer, local frame, m
        # The search without a prior for the last scan, if it was put off; and the words of the last such search
        self._search: Callable[[], EpochEstimate] | None = None
        self._search_words = ""
        self._last_position = -math.inf  # time of the last one that was compared with a pose, s
        self._begin()

    def _begin(self, start: UncertainPose | None = None) -> None:
        """Begin a track."""
        self._tracker = Tracker(self._method, self._noise, start=start, puts_off=self._puts_off)
        # Time and pose of the last scan whose motion was known, and whether by odometry.
        self._before: tuple[float, Pose, bool] | None = None
        self._n_without, self._n_off = 1, 0  # scans in a row without a place, positions in a row that are off
        # m; until the place that was found is believed, and driven since the last position
        self._to_confirm, self._way = 0.0, 0.0

    def rehearse(self) -> None:
        """Localize points of the map itself, so that the code of a search is in memory before the first scan comes."""
        keys = sorted(self.map.tile_keys)
        if not keys:
            return
        with suppress(MaxconError):  # it is said where the tile is needed
            points = self.map.tile(keys[len(keys) // 2]).mean_points(self.map.cell)[::REHEARSED]
            x, y, z = points.mean(axis=0).tolist()
            here = Pose(x, y, z, 0.0, 0.0, 0.0)
            for prior in (here, here.translated([1.0, 0.0, 0.0])):
                self._method.localize(Scan(points - here.position), self.map, prior)

    # --- what comes in ----------------------------------------------------------------------------------------

    def add_scan(
        self, time: float, points: ArrayLike, point_times: ArrayLike | None = None, *, now: float | None = None
    ) -> None:
        """Take a scan.

        - time: stamp, s.
        - points: shape (n, 3); sensor frame, m.
        - point_times: shape (n,); when each was measured, s after `time`, if the scan is to be deskewed.
        """
        found = as_points(points, "points")
        offsets = None if point_times is None else np.asarray(point_times, dtype=np.float64)
        _check("a scan", time, 0.0 if offsets is None else np.abs(offsets).max(initial=0.0))
        if offsets is not None and offsets.shape != (len(found),):
            raise ArrayError(f"Expected a time for each of {len(found)} points or none, got shape {offsets.shape}.")
        ranges = np.sqrt(np.einsum("ij,ij->i", found, found))
        kept = (ranges > 0.0) & (ranges >= self.drive.min_range) & (ranges <= self.drive.max_range)
        raw = RawScan(
            found[kept], time, f"{time:.6f}", len(found), 0, int(np.count_nonzero(~kept)),
            point_times=None if offsets is None else offsets[kept],
        )  # fmt: skip
        end = time if raw.point_times is None else time + float(raw.point_times.max(initial=0.0))
        self._inbox.add_scan(WaitingScan(time, end, clock.monotonic() if now is None else now, raw))

    def add_odometry(self, time: float, T_odom_sensor: Pose) -> None:
        """Take a pose of the sensor by its odometry, in any frame, which may drift; time in s."""
        _check("odometry", time, *T_odom_sensor.values)
        with self._inbox.changed:
            self._inbox.odometry.add(time, T_odom_sensor)
            self._inbox.changed.notify_all()

    def add_prior(self, time: float, T_map_sensor: Pose) -> None:
        """Take a rough pose of the sensor, global coordinates in the CRS of the map; time in s."""
        _check("a prior", time, *T_map_sensor.values)
        local = self.map.frame.pose_to_local(T_map_sensor)
        with self._inbox.changed:
            self._inbox.priors.add(time, local)
            self._inbox.changed.notify_all()

    def add_position(self, time: float, x: float, y: float, sigma: float) -> None:
        """Take a position without a heading: time, s; x, y in the CRS of the map, and their standard deviation, m."""
        _check("a position", time, x, y, sigma)
        x_low, y_low, _ = self.map.frame.origin
        last = self._inbox.position
        if last is None or not 0.0 < last.time - time < MEMORY:
            self._inbox.position = Position(time, x - x_low, y - y_low, sigma)

    # --- what comes out ---------------------------------------------------------------------------------------

    def answers(self, now: float | None = None) -> Iterator[LiveAnswer]:
        """Yield the answers for all scans that need not wait any longer, in order of time."""
        while (answer := self.answer(now)) is not None:
            yield answer

    @contextmanager
    def working(self, tell: Callable[[LiveAnswer], None]) -> Iterator[threading.Thread]:
        """While this is open, a thread calls `tell` with each answer; it ends where that raises something.

        Another thread loads the map around. At first, until code and map are in memory, answers that would come late
        are dropped, as are scans that wait longer than 0.06 s and the delay. What an answer does not need is done
        after it: a scan without a place is searched for while none waits, and the next one tells what was found.
        """
        ended = threading.Event()
        jobs = (self._work, tell, ended), (self._load_ahead, ended)
        threads = [threading.Thread(target=job, args=args, name="live", daemon=True) for job, *args in jobs]
        self._puts_off = self._tracker.puts_off = True
        for thread in threads:
            thread.start()
        try:
            yield threads[0]
        finally:
            ended.set()
            for thread in threads:
                thread.join()
            self._puts_off = self._tracker.puts_off = False

    def _work(self, tell: Callable[[LiveAnswer], None], ended: threading.Event) -> None:
        """Answer what comes."""
        n_rehearsals = 0
        while not ended.is_set():
            if (answer := self.answer()) is None:
                with self._inbox.changed:
                    self._inbox.changed.wait(LOOK_EVERY)
                continue
            is_late = self._inbox.waited + answer.epoch.milliseconds / 1e3 > IN_TIME
            if is_late and n_rehearsals < MOST_REHEARSALS:
                n_rehearsals += 1
                self._inbox.count(n_answered=-1, n_dropped=1)
            else:
                n_rehearsals = n_rehearsals if answer.epoch.estimate is None else MOST_REHEARSALS
                tell(answer)
            if self._inbox.n_waiting == 0:
                self._work_off()
            self._inbox.drop_before(clock.monotonic() - max(LONGEST_WAIT, self.options.delay + 2.0 * LOOK_EVERY))

    def _work_off(self) -> None:
        """Do what was put off: look for other places than that of the track, or for any."""
        with suppress(MaxconError):  # a tile that cannot be read: others may be
            self._tracker.work_off()
        if self._search is not None:
            self._search_words = self._search().reason

    def _load_ahead(self, ended: threading.Event) -> None:
        """Load the map where the sensor may be."""
        loaded: list[tuple[float, float]] = []
        while not ended.wait(LOOK_EVERY):
            places = self._places()
            if all(any(math.dist(place, before) < EVERY_METRES for before in loaded) for place in places):
                continue
            for reach, (x, y) in product(METRES_AHEAD, places):
                if not ended.is_set():
                    self._load_around(x, y, reach)
            loaded = places

    def _load_around(self, x: float, y: float, reach: float) -> None:
        """Load the map within so many metres of a place, and the level of it that is searched first."""
        with suppress(MaxconError):  # it is said where the tile is needed
            self.map.prepare(x, y, reach)
            self.map.nearest_level(CELL).tiles_within(x, y, reach)

    def _places(self) -> list[tuple[float, float]]:
        """Where the sensor may be, local frame, m: by the last answer, the last position, the last prior."""
        with self._inbox.changed:
            position, poses = self._inbox.position, self._inbox.priors.poses[-1:]
        places = [] if self._place is None else [self._place]
        places += [] if position is None else [(position.x, position.y)]
        return places + [(pose.x, pose.y) for pose in poses]

    def answer(self, now: float | None = None) -> LiveAnswer | None:
        """Return the answer for the next scan; None if none waits, or the first one still has to."""
        taken = self._inbox.take(clock.monotonic() if now is None else now)
        if taken is None:
            return None
        if self._inbox.n_restarts != self._n_restarts:
            self._n_restarts, self._correction = self._inbox.n_restarts, None
            self._begin()
        began, on_processor, n_tiles = clock.perf_counter(), clock.thread_time(), n_waited_for()
        told = replace(self._localized(taken), milliseconds=1e3 * (clock.perf_counter() - began))
        effort = Effort(1e3 * (clock.thread_time() - on_processor), n_waited_for() - n_tiles, self._tracker.searched)
        self._inbox.is_lost = told.pose_global is None
        if told.estimate is not None and told.pose_global is not None:
            self._place = told.estimate.pose.x, told.estimate.pose.y
        return LiveAnswer(told, self._correction, self._inbox.counts, effort)

    def _localized(self, taken: Taken) -> EpochEstimate:
        """Track the scan; look for it without a prior where that gives no place."""
        raw, odometry, priors, position = taken
        self._search = None
        if odometry is not None and raw.time - odometry.times[-1] > LONGEST_AGE:
            odometry = None  # it has ended: priors tell the motion, too
        source = priors if odometry is None else odometry
        pose = None if source is None else pose_near(source, raw.time, self.drive.max_gap)
        motion = None if pose is None else self._motion(raw.time, pose, source, is_odometry=odometry is not None)
        own = None if priors is None else self._prior_at(raw.time, priors, odometry)
        read = self._deskewed(raw, source)
        told = self._tracked(self._inbox.counts.n_answered - 1, read, own, motion)
        around = self._around(position, raw.time, pose, odometry)
        self._n_without = 0 if told.pose_global is not None else self._n_without + 1
        is_due = self._n_without > 0 and self._n_without % self.options.patience == 0
        if self._tracker.prediction is None or motion is None:  # at first a position is waited for
            is_due = is_due or around is not None or self._n_without == 1
        if told.pose_global is None and own is None and is_due and not read[1] and len(raw.points):
            if self._puts_off and motion is not None:  # not to be late: the next scan goes on from where this one was
                self._search = partial(self._found, replace(told, reason=""), read, around, motion)
            else:
                told, motion = self._found(told, read, around, motion), None
        words, self._search_words = self._search_words, ""
        told = replace(told, reason="; ".join(filter(None, [told.reason, words])))
        if told.pose_global is None or told.estimate is None:
            return told
        self._n_without = 0
        told = told if own is not None else self._doubted(told, told.estimate.pose, around, motion)
        if told.pose_global is not None and pose is not None and odometry is not None and told.estimate is not None:
            self._correction = told.estimate.pose @ pose.inverse
        return told

    def _tracked(self, number: int, read: Read, own: Pose | None, motion: Motion | None) -> EpochEstimate:
        try:
            return tracked_epoch(self.map, self._tracker, number, read, own, motion)
        except MaxconError as error:  # a tile that cannot be read: others may be
            return tracked_epoch(self.map, self._tracker, number, (read[0], str(error)), own, None)

    def _motion(self, time: float, pose: Pose, source: Trajectory | None, *, is_odometry: bool) -> Motion:
        """Motion since the last scan; that one's pose is looked up once more, for by now more may be known of it."""
        if self._before is not None and self._before[2] is not is_odometry:
            self._begin()
        motion = Motion.none()
        if self._before is not None and source is not None:
            before, told, _ = self._before
            motion = Motion.between(pose_or_none(source, before, self.drive.max_gap) or told, pose, time - before)
        self._before = time, pose, is_odometry
        return motion

    def _prior_at(self, time: float, priors: Trajectory, odometry: Trajectory | None) -> Pose | None:
        """The prior at a time (s); the last one before, moved on by the odometry, where that one is too old."""
        pose = pose_or_none(priors, time, self.drive.max_gap)
        if pose is not None or odometry is None:
            return pose or pose_near(priors, time, self.drive.max_gap)
        row = int(np.searchsorted(priors.times, time)) - 1
        if row < 0 or time - float(priors.times[row]) > LONGEST_AGE:
            return None
        before, here = (pose_near(odometry, at, self.drive.max_gap) for at in (float(priors.times[row]), time))
        return None if before is None or here is None else priors.pose(row) @ (before.inverse @ here)

    def _deskewed(self, raw: RawScan, source: Trajectory | None) -> Read:
        """The scan, deskewed where its points have times, or why it cannot be."""
        if raw.point_times is None or not len(raw.points):
            return raw, ""
        if source is None:
            return raw, "Expected odometry, to deskew the scan, got none so far."
        try:
            points = deskew(raw.points, raw.point_times + raw.time, source, raw.time, self.drive.max_gap)
        except TrajectoryError as error:
            return raw, str(error)
        return replace(raw, points=points), ""

    # --- doubts -----------------------------------------------------------------------------------------------

    def _around(
        self, position: Position | None, time: float, pose: Pose | None, odometry: Trajectory | None
    ) -> _Around | None:
        """Where the sensor is by the last position, if that is not too old, and by the odometry since."""
        if position is None or abs(position.time - time) > LONGEST_AGE:
            return None
        reach = SIGMAS * position.sigma + ROOM
        then = None if odometry is None or pose is None else pose_near(odometry, position.time, self.drive.max_gap)
        if then is None or pose is None:
            return _Around(position, reach + FASTEST * abs(position.time - time), Motion.none().pose)
        return _Around(position, reach, pose.inverse @ then)

    def _doubted(self, told: EpochEstimate, pose: Pose, around: _Around | None, motion: Motion | None) -> EpochEstimate:
        """The answer with a pose, but lost where the positions speak against it, or have not confirmed it so far."""
        self._way += 0.0 if motion is None else motion.distance
        if around is not None and around.position.time != self._last_position:  # each speaks once
            self._last_position = around.position.time
            self._n_off = self._n_off + 1 if around.is_off(pose) else 0
            self._to_confirm -= self._way
            self._way = 0.0
        if self._n_off >= (1 if self._to_confirm > 0.0 else FEWEST_OFF):
            why = f"{self._n_off} positions in a row speak against it"
            if self._to_confirm > 0.0 or self._n_off >= self.options.patience:
                self._begin()
            return _lost(told, why)
        if self._to_confirm > 0.0:
            return _lost(told, f"to be confirmed by positions over {self._to_confirm:.0f} m")
        return told

    def _found(self, told: EpochEstimate, read: Read, around: _Around | None, motion: Motion | None) -> EpochEstimate:
        """The answer with the place of the scan in the whole map, or around a position, where a track begins."""
        circle = None if around is None else around.circle
        where = "the whole map" if circle is None else f"{circle[1]:.0f} m around the last position"
        if self._relocalizer is None:
            return _lost(told, "the map has no ground, to search it without a prior")
        try:
            estimate = (self._relocalizer if circle is None else self._relocalizer.within(*circle)).localize(told.scan)
        except (MapError, ArrayError) as error:
            return _lost(told, str(error))
        if not estimate.is_localized:
            return _lost(told, f"searched {where}: {'; '.join(filter(None, [estimate.status, estimate.reason]))}")
        reason = f"found in {where}"
        if motion is None:  # nothing to track with
            pose = self.map.frame.pose_to_global(estimate.pose)
            return replace(told, status=estimate.status, reason=reason, estimate=estimate, pose_global=pose)
        before = self._before
        self._begin(UncertainPose(estimate.pose, START))
        self._before = before
        # The other direction of a street may look alike: positions have to agree over as much as they may be off.
        self._to_confirm = 0.0 if around is None else around.reach
        begun = self._tracked(told.epoch, read, None, Motion.none())
        return replace(begun, reason="; ".join(filter(None, [reason, begun.reason])))


def _check(what: str, *numbers: float) -> None:
    """Refuse numbers that would spoil what is known: ArrayError."""
    if not all(abs(number) <= LARGEST for number in numbers):
        raise ArrayError(f"Expected {what} with numbers up to {LARGEST:g}, got {[*map(float, numbers)]}. Leave it out.")


def _lost(told: EpochEstimate, why: str) -> EpochEstimate:
    """The answer as one that may not be used."""
    reason = "; ".join(filter(None, [told.reason, why]))
    estimate = None if told.estimate is None else replace(told.estimate, status=Status.LOST)
    return replace(told, status=Status.LOST, reason=reason, estimate=estimate, pose_global=None)
