"""What has come to a live localizer and waits: scans in order of time, and the poses of the last seconds."""

import math
import threading
from bisect import bisect_left, insort
from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from maxcon.drive.localize import pose_or_none
from maxcon.errors import OptionError
from maxcon.geometry import Pose, interpolate_poses
from maxcon.io.raw_scan import RawScan
from maxcon.scan.deskew import MAX_BEYOND
from maxcon.scan.trajectory import Trajectory

# Poses are kept for so long, s. What is earlier by more begins anew: a recording is played once more.
MEMORY = 10.0
# A scan is missing before one that comes later than so many usual periods, the median of the last few.
MISSING, N_PERIODS = 1.5, 9


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """How messages are waited for; OptionError if a number makes no sense.

    - delay: messages may come so late, s: so long a scan waits for odometry up to its end, and for a scan before it.
    - queue: scans that wait at most; of more the oldest is dropped.
    - patience: after so many scans in a row without a place, the map is searched for one without a prior.
    """

    delay: float = 0.03
    queue: int = 2
    patience: int = 10

    def __post_init__(self) -> None:
        if not 0.0 <= self.delay <= MEMORY or self.queue < 1 or self.patience < 1:
            raise OptionError(
                f"Expected a delay of 0 to {MEMORY:g} s, a queue and a patience of 1 or more, got {self}. The defaults"
                " are 0.03 s, 2 and 10."
            )


class LiveCounts(NamedTuple):
    """Scans so far.

    - n_answered: those with an answer.
    - n_dropped: those that gave way to newer ones that waited.
    - n_late: those that came when a later scan was answered or dropped already.
    - n_duplicates: those with the time of another.
    """

    n_answered: int = 0
    n_dropped: int = 0
    n_late: int = 0
    n_duplicates: int = 0


class Position(NamedTuple):
    """Where the sensor is by a receiver at a time (s), local frame, m, and the standard deviation, m."""

    time: float
    x: float
    y: float
    sigma: float


class WaitingScan(NamedTuple):
    """A scan: its time, when its last point was measured, and when it came (of another clock), s."""

    time: float
    end: float
    came: float
    raw: RawScan


Taken = tuple[RawScan, Trajectory | None, Trajectory | None, Position | None]
"""A scan, and what is known for it: poses of the odometry, priors (local frame), the last position."""


@dataclass
class Poses:
    """Poses of the last seconds by their times, s; those of other times may come in any order."""

    times: list[float] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)

    def add(self, time: float, pose: Pose) -> None:
        """Add a pose, unless there is one of its time."""
        if self.reach(time + MEMORY) > 0.0:
            self.times, self.poses = [], []
        row = bisect_left(self.times, time)
        if self.times[row : row + 1] != [time]:
            self.times.insert(row, time)
            self.poses.insert(row, pose)
        old = bisect_left(self.times, self.times[-1] - MEMORY)
        del self.times[:old], self.poses[:old]

    def reach(self, time: float) -> float:
        """How far beyond a time they reach, s; 0 if there are none."""
        return self.times[-1] - time if self.times else 0.0

    def trajectory(self) -> Trajectory | None:
        """Return them as a trajectory; None if there are none."""
        return Trajectory.from_poses(self.times, self.poses) if self.times else None


def pose_near(trajectory: Trajectory, time: float, max_gap: float) -> Pose | None:
    """Return the pose at a time (s), None where there is none; shortly after the last the motion goes on as before."""
    times = trajectory.times
    if len(times) > 1 and 1e-3 < time - times[-1] <= MAX_BEYOND and time - times[-2] <= max_gap:
        two = slice(-2, None)
        found, turns = interpolate_poses(
            times[two], trajectory.positions[two], trajectory.quaternions_xyzw[two], [time]
        )
        return Pose.from_rotation(found[0], turns.as_matrix()[0])
    return pose_or_none(trajectory, time, max_gap)


class LiveInbox:
    """What has come and waits; any thread may call it."""

    def __init__(self, options: LiveOptions) -> None:
        self.options, self.counts = options, LiveCounts()
        self.changed = threading.Condition()
        self.is_lost = True  # a prior is waited for then
        self.n_restarts = 0  # of the clock of the scans
        self.waited = 0.0  # s, the scan that was taken last
        self._forget()

    def _forget(self) -> None:
        self.odometry, self.priors = Poses(), Poses()
        self.position: Position | None = None
        self._scans: list[WaitingScan] = []
        self._last_time = -math.inf  # of the last scan that was taken from those that wait
        self._periods: deque[float] = deque(maxlen=N_PERIODS)

    def count(self, **more: int) -> None:
        """Count scans."""
        with self.changed:
            self.counts = self.counts._replace(**{name: getattr(self.counts, name) + n for name, n in more.items()})

    def add_scan(self, scan: WaitingScan) -> None:
        """Add a scan, unless it comes too late or twice; the oldest is dropped where too many wait."""
        with self.changed:
            if scan.time < self._last_time - MEMORY:
                self._forget()
                self.n_restarts += 1
            if scan.time == self._last_time or any(scan.time == other.time for other in self._scans):
                self.count(n_duplicates=1)
            elif scan.time < self._last_time:
                self.count(n_late=1)
            else:
                insort(self._scans, scan, key=lambda each: each.time)
            while len(self._scans) > self.options.queue:
                self._next()
                self.count(n_dropped=1)
            self.changed.notify_all()

    def take(self, now: float) -> Taken | None:
        """Return the first scan and what is known for it; None if none waits, or the first one still has to."""
        with self.changed:
            if not self._scans or not self._is_ready(self._scans[0], now):
                return None
            self.count(n_answered=1)
            self.waited = now - self._scans[0].came
            return self._next().raw, self.odometry.trajectory(), self.priors.trajectory(), self.position

    @property
    def n_waiting(self) -> int:
        """Scans that wait."""
        return len(self._scans)

    def drop_before(self, came: float) -> None:
        """Drop those that wait since before a time, s."""
        with self.changed:
            while self._scans and self._scans[0].came < came:
                self._next()
                self.count(n_dropped=1)

    def _next(self) -> WaitingScan:
        scan = self._scans.pop(0)
        if math.isfinite(self._last_time):
            self._periods.append(scan.time - self._last_time)
        self._last_time = scan.time
        return scan

    def _is_ready(self, scan: WaitingScan, now: float) -> bool:
        if now - scan.came >= self.options.delay:
            return True
        if self.odometry.reach(scan.end) < 0.0 or (self.is_lost and self.priors.reach(scan.time) < 0.0):
            return False
        return not self._periods or scan.time - self._last_time <= MISSING * float(np.median(self._periods))
