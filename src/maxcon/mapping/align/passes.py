"""Passes of the mapping vehicle: which points belong to each, where it measured when, and how each is corrected."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from maxcon._system import Progress
from maxcon.errors import FileError, OptionError
from maxcon.geometry import Pose
from maxcon.io.clouds import CloudHeader, open_cloud
from maxcon.io.clouds.las import LasReader, positions_of

PASSES_BY = ("time", "source", "file")  # pauses in gps_time, point source ids, or files
MOST_SECONDS = 2_000_000  # three weeks of mapping; more different ones cannot be times, and would fill the memory
MOST_PASSES = 1000
CHUNK = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Pass:
    """One drive of the mapping vehicle."""

    name: str  # "pass 1"; or the name of its file; or "source 1", by its point source id
    times: NDArray[np.float64]  # (k,): Middles of the seconds in which it measured, s, rising; a single 0 without times
    middles: NDArray[np.float64]  # (k, 3): Mean of the points of each of these seconds, global, m
    n_points: int  # How many points it has
    centre: NDArray[np.float64]  # (3,): Mean of all of them, global, m

    @property
    def start(self) -> float:
        """Begin of its first second, s."""
        return float(self.times[0]) - 0.5

    @property
    def end(self) -> float:
        """End of its last second, s."""
        return float(self.times[-1]) + 0.5

    @property
    def middle_time(self) -> float:
        """Middle of the median second in which it measured, s."""
        return float(self.times[len(self.times) // 2])


@dataclass(frozen=True, slots=True, eq=False)
class Passes:
    """All passes of a campaign, in order of their starts."""

    by: str  # What tells them apart, one of `PASSES_BY`
    passes: tuple[Pass, ...]  # At least one
    keys: NDArray[np.int64]  # (n,): Point source id of each pass, or number of its file; not used for passes by time

    def __len__(self) -> int:
        return len(self.passes)

    def __iter__(self) -> Iterator[Pass]:
        return iter(self.passes)

    def of_points(self, times: NDArray[np.float64], source_ids: NDArray[np.integer], file: int) -> NDArray[np.int16]:
        """Number of the pass of each point, shape (n,), of times (s) and source ids (n,) each, in one file."""
        if self.by == "time":
            return self.at(times)
        wanted = source_ids if self.by == "source" else np.full(len(times), file)
        order = np.argsort(self.keys)
        return order[np.searchsorted(self.keys[order], wanted)].astype(np.int16)

    def at(self, times: NDArray[np.float64]) -> NDArray[np.int16]:
        """Number of the pass under way at each time (s), shape (n,), or of the nearest one; for passes by time."""
        ends = np.array([each.end for each in self.passes[:-1]])
        starts = np.array([each.start for each in self.passes[1:]])
        return np.searchsorted(0.5 * (ends + starts), times, side="right").astype(np.int16)

    @property
    def are_apart(self) -> bool:
        """Whether no two passes were under way at the same time, so that a time tells the pass."""
        return all(next_.start >= each.end for each, next_ in zip(self.passes, self.passes[1:], strict=False))


class PassPoints(NamedTuple):
    """A chunk of the points of a file."""

    record: Any  # All fields of the points, as laspy reads them
    points: NDArray[np.float64]  # (n, 3): Global, m
    times: NDArray[np.float64]  # (n,): s; zeros where the file has none
    source_ids: NDArray[np.integer]  # (n,): Point source ids


def read_passes(header: CloudHeader) -> Iterator[PassPoints]:
    """Yield the points of a LAS or LAZ file, a million at a time, with all their fields."""
    with open_cloud(header.path) as reader:
        if not isinstance(reader, LasReader):
            raise FileError(
                f"Expected LAS or LAZ files, whose points tell when they were measured, got {header.path}. Convert it."
            )
        for record in reader.records(CHUNK):
            points = positions_of(record)
            times = np.array(record["gps_time"], np.float64) if header.has_times else np.zeros(len(points))
            if not (np.isfinite(times).all() and np.isfinite(points).all()):
                raise FileError(
                    f"Expected finite times and coordinates in {header.path}, got others. Leave out those points."
                )
            yield PassPoints(record, points, times, np.array(record["point_source_id"]))


def survey(headers: Sequence[CloudHeader], by: str, pause: float, report: Progress) -> Passes:
    """Read all clouds once, and tell their passes apart; OptionError if there are no times, or far too many of them."""
    if by not in PASSES_BY:
        raise OptionError(f"Expected passes by {', '.join(PASSES_BY)}, got {by!r}.")
    sums: defaultdict[tuple[int, int], NDArray[np.float64]] = defaultdict(lambda: np.zeros(4))
    origin, n_done, n_total = np.zeros(3), 0, sum(header.n_points for header in headers)
    for file, header in enumerate(headers):
        for part in read_passes(header):
            if n_done == 0:
                origin = np.floor(part.points[0])
            if by == "time" and not part.times.any():
                raise OptionError(
                    f"Expected gps_time in {header.path}, to tell passes apart by their pauses, got none. Say"
                    " --passes file where each file is a pass, or --passes source."
                )
            keys = np.full(len(part.times), file if by == "file" else 0, np.int64)
            keys = part.source_ids.astype(np.int64) if by == "source" else keys
            times = np.floor(part.times).astype(np.int64)
            order = np.lexsort((times, keys))
            is_first = np.ones(len(order), bool)
            is_first[1:] = (np.diff(keys[order]) != 0) | (np.diff(times[order]) != 0)
            starts = np.flatnonzero(is_first)
            positions = np.add.reduceat((part.points - origin)[order], starts, axis=0)
            counts = np.diff(starts, append=len(order))
            for row, start in enumerate(order[starts].tolist()):
                sums[int(keys[start]), int(times[start])] += (counts[row], *positions[row])
            n_done += len(part.times)
            report("finding passes", n_done, n_total)
            if len(sums) > MOST_SECONDS:
                raise OptionError(
                    f"Expected gps_time in seconds, got points of more than {MOST_SECONDS:,} different ones, the last"
                    f" in {header.path}. Are these times? If not, say --passes file."
                )
    seconds = sorted(sums)
    values = np.array([sums[second] for second in seconds])
    values[:, 1:] = values[:, 1:] / values[:, :1] + origin
    return _passes(by, headers, np.array(seconds, np.int64), values, pause)


def _passes(
    by: str, headers: Sequence[CloudHeader], seconds: NDArray[np.int64], values: NDArray[np.float64], pause: float
) -> Passes:
    """Passes of (key, second), shape (k, 2), sorted, and count and mean position, shape (k, 4), of each."""
    is_new = np.diff(seconds[:, 0], prepend=seconds[0, 0] - 1) != 0
    if by == "time":
        is_new |= np.diff(seconds[:, 1], prepend=seconds[0, 1]) > pause
    groups = np.split(np.arange(len(seconds)), np.flatnonzero(is_new)[1:])
    if len(groups) > MOST_PASSES:
        raise OptionError(f"Expected at most {MOST_PASSES} passes, got {len(groups):,}. Is --pause too short?")
    groups.sort(key=lambda rows: (seconds[rows[0], 1], seconds[rows[0], 0]))
    passes, keys = [], [int(seconds[rows[0], 0]) for rows in groups]
    for number, (rows, key) in enumerate(zip(groups, keys, strict=True), 1):
        name = {"time": f"pass {number}", "source": f"source {key}"}.get(by) or headers[key].path.name
        counts = values[rows, 0]
        centre = np.average(values[rows, 1:], axis=0, weights=counts)
        passes.append(Pass(name, seconds[rows, 1] + 0.5, values[rows, 1:], int(counts.sum()), np.asarray(centre)))
    return Passes(by, tuple(passes), np.array(keys, np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class Corrections:
    """Motions of passes that bring them together; each is a twist: a shift (m) and a rotation vector (rad).

    Each pass is moved about its centre as a whole, and about the mean of what it measured then at each of its knots,
    between which twists are interpolated linearly. All points of one pass and time are moved by the same rigid motion.
    """

    centres: NDArray[np.float64]  # (r, 3): Centres of the passes, global, m
    wholes: NDArray[np.float64]  # (r, 6): Twist of each pass about its centre
    starts: NDArray[np.float64]  # (r,): Time of the first knot of each pass, s
    steps: NDArray[np.float64]  # (r,): Time between two knots of each pass, s
    # (r + 1,): Number of the first knot of each pass; the last entry is the number of all knots
    firsts: NDArray[np.int64]
    knot_centres: NDArray[np.float64]  # (k, 3): Centres of the knots, global, m
    knots: NDArray[np.float64]  # (k, 6): Twist of each knot about its centre

    @classmethod
    def none(cls, passes: Passes, spacing: float) -> Self:
        """Corrections that move nothing yet, with knots at most `spacing` (s) apart."""
        n_knots = [1 + int(np.ceil((each.end - each.start) / spacing)) for each in passes]
        starts = np.array([each.start for each in passes])
        steps = np.array([(each.end - each.start) / (n - 1) for each, n in zip(passes, n_knots, strict=True)])
        knot_centres = [
            np.column_stack([np.interp(start + step * np.arange(n), each.times, axis) for axis in each.middles.T])
            for each, start, step, n in zip(passes, starts, steps, n_knots, strict=True)
        ]
        firsts = np.concatenate([[0], np.cumsum(n_knots)])
        centres = np.array([each.centre for each in passes])
        wholes, knots = np.zeros((len(passes), 6)), np.zeros((int(firsts[-1]), 6))
        return cls(centres, wholes, starts, steps, firsts, np.concatenate(knot_centres), knots)

    def changed(self, wholes: NDArray[np.float64], knots: NDArray[np.float64]) -> Self:
        """The same with other twists."""
        return replace(self, wholes=wholes, knots=knots)

    def _between(
        self, times: NDArray[np.float64], passes: NDArray[np.integer]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Number of the knot before each time, shape (n,), and the weight of the next one, 0 to 1."""
        n_knots = np.diff(self.firsts)[passes]
        steps = (times - self.starts[passes]) / self.steps[passes]
        before = np.clip(np.floor(steps), 0, n_knots - 2).astype(np.int64)
        return self.firsts[passes] + before, np.clip(steps - before, 0.0, 1.0)

    def jacobian(self, places: NDArray[np.float64], times: NDArray[np.float64], passes: NDArray[np.integer]) -> Any:
        """Derivatives of twists at places (n, 3), m, and times (n,), s, by those of passes, then knots, CSR."""
        from scipy.sparse import bsr_array

        n, n_passes, (first, part) = len(places), len(self.centres), self._between(times, passes)
        centres = [self.centres[passes], self.knot_centres[first], self.knot_centres[first + 1]]
        weights = np.column_stack([np.ones(n), 1.0 - part, part])
        blocks = weights[..., None, None] * twist_matrices(places[:, None] - np.stack(centres, axis=1))
        columns = np.column_stack([passes, n_passes + first, n_passes + first + 1])
        shape = (6 * n, 6 * (n_passes + len(self.knots)))
        return bsr_array((blocks.reshape(-1, 6, 6), columns.ravel(), 3 * np.arange(n + 1)), shape=shape).tocsr()

    def motions(
        self, times: NDArray[np.float64], passes: NDArray[np.integer]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Centre of rotation (m), shift (m) and rotation vector (rad), (n, 3) each, at times (n,), s, of passes."""
        from scipy.spatial.transform import Rotation

        first, part = self._between(times, passes)
        part = part[:, None]
        about = (1.0 - part) * self.knot_centres[first] + part * self.knot_centres[first + 1]
        shifts = np.zeros_like(about)
        for knots, parts in ((first, 1.0 - part), (first + 1, part)):
            turned = np.cross(self.knots[knots, 3:], about - self.knot_centres[knots])
            shifts += parts * (self.knots[knots, :3] + turned)
        turns = (1.0 - part) * self.knots[first, 3:] + part * self.knots[first + 1, 3:]
        wholes, arms = self.wholes[passes], about - self.centres[passes]
        shifts += wholes[:, :3] + Rotation.from_rotvec(wholes[:, 3:]).apply(arms) - arms
        return about, shifts, turns + wholes[:, 3:]

    def moved(
        self, points: NDArray[np.float64], times: NDArray[np.float64], passes: NDArray[np.integer]
    ) -> NDArray[np.float64]:
        """Where points, shape (n, 3), global, m, measured at times, (n,), s, by passes, (n,), lie after correction."""
        from scipy.spatial.transform import Rotation

        about, shifts, turns = self.motions(times, passes)
        return np.asarray(about + shifts + Rotation.from_rotvec(turns).apply(points - about))

    def twist_at(self, place: NDArray[np.float64], time: float, number: int) -> NDArray[np.float64]:
        """Twist, shape (6,), by which pass `number` moves a place (3,), global, m, that it measured at a time (s)."""
        times, passes = np.array([time]), np.array([number])
        turn = self.motions(times, passes)[2][0]
        return np.concatenate([self.moved(place[None], times, passes)[0] - place, turn])


def pose_of_twist(twist: NDArray[np.float64]) -> Pose:
    """The rigid motion of a shift (m) and a rotation vector (rad), shape (6,)."""
    from scipy.spatial.transform import Rotation

    return Pose.from_rotation(twist[:3], Rotation.from_rotvec(twist[3:]).as_matrix())


def twist_matrices(arms: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrices (..., 6, 6) from small twists about centres to those of points `arms` (..., 3), m, away from them."""
    x, y, z = np.moveaxis(arms, -1, 0)
    matrices = np.broadcast_to(np.eye(6), (*arms.shape[:-1], 6, 6)).copy()
    for row, column, value in ((0, 4, z), (0, 5, -y), (1, 3, -z), (1, 5, x), (2, 3, y), (2, 4, -x)):
        matrices[..., row, column] = value
    return matrices
