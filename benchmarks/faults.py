# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What can go wrong with scans, maps and priors, and how often is it noticed?

python benchmarks/faults.py --drive MAP SCANS REFERENCE [--drive ...] [--every N] [--faults NAME,NAME]

Each scan gets one fault at a time and a prior up to 8 m and 7 degrees off. It is localized without the tests of the
fit, and by default: the figures before and behind an arrow, or one where both are equal. A map that is off looks as a
scan that is off the other way, so that faults of maps are applied to scans. GICP gets the scans without a fault.
Scans of another drive are those of the drive before, the first has those of the last; no answer is right.
"""

import argparse
import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from header import header

from maxcon import MaximumConsensus, PointMap, Pose, Scan
from maxcon.errors import OptionError
from maxcon.integrity import Trust
from maxcon.io.scans import Scans, open_scans
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.baselines import Gicp, MapTargets
from maxcon.lab.evaluation import pose_error
from maxcon.scan.trajectory import Trajectory

TURN = 0.1
"""A spinning scanner turns once in this time, s."""
OFFSET, HEADING_DEG = 8.0, 7.0
"""Priors are off by up to this in x, in y, m, and in heading."""
INSIDE = 5.991
"""95 % of the squares of two normal variables together are smaller."""


def as_recorded(points, rng):
    return points


def lengthened(points, more):
    """Ranges longer by some metres, one number or shape (n,)."""
    ranges = np.linalg.norm(points, axis=1)
    return points * (1.0 + more / np.maximum(ranges, 1e-9))[:, None]


def noise(sigma):
    return lambda points, rng: lengthened(points, rng.normal(0.0, sigma, len(points)))


def clutter(ratio):
    """Of the points so many lie anywhere, 2 to 30 m away and up to 4 m above the sensor."""

    def change(points, rng):
        is_clutter = rng.random(len(points)) < ratio
        n = np.count_nonzero(is_clutter)
        ranges, azimuths = rng.uniform(2.0, 30.0, n), rng.uniform(-math.pi, math.pi, n)
        changed = points.copy()
        changed[is_clutter] = np.column_stack(
            [ranges * np.cos(azimuths), ranges * np.sin(azimuths), rng.uniform(-1.5, 4.0, n)]
        )
        return changed

    return change


def cut_short(points, rng):
    """A tenth of the points lie anywhere between the sensor and what it measured."""
    is_short = rng.random(len(points)) < 0.1
    return points * np.where(is_short, rng.uniform(0.05, 0.95, len(points)), 1.0)[:, None]


def not_deskewed(speed, turn_rate_deg=0.0):
    """The sensor moves ahead, m/s, and turns, degrees/s, while it spins, cut behind; the pose is that of mid-turn."""

    def change(points, rng):
        phases = np.mod(np.arctan2(points[:, 1], points[:, 0]) / (2.0 * math.pi) + 0.5, 1.0) - 0.5
        angles = math.radians(turn_rate_deg) * TURN * phases
        cosines, sines = np.cos(angles), np.sin(angles)
        x, y, z = points.T
        return np.column_stack([cosines * x - sines * y + speed * TURN * phases, sines * x + cosines * y, z])

    return change


def put_together(n_sweeps, step):
    """Sweeps put together as if the vehicle, so many metres farther on in each, had stood; the pose is the last's."""

    def change(points, rng):
        sweeps_later = rng.integers(0, n_sweeps, len(points))
        return points + np.outer(step * sweeps_later, [1.0, 0.0, 0.0])

    return change


def aside(choose, by):
    """The points that `choose` finds lie so far to the left, m."""

    def change(points, rng):
        changed = points.copy()
        changed[choose(*points.T), 1] += by
        return changed

    return change


def within(azimuth_deg):
    """Only so far to the left and to the right of ahead."""
    return lambda points, rng: points[np.abs(np.degrees(np.arctan2(points[:, 1], points[:, 0]))) < azimuth_deg]


def near(truth, rng):
    x, y = rng.uniform(-OFFSET, OFFSET, 2)
    turn = math.radians(rng.uniform(-HEADING_DEG, HEADING_DEG))
    return replace(truth, heading=truth.heading + turn).translated([x, y, 0.0])


def along(truth, rng):
    """25 to 70 m ahead or behind, farther than is searched."""
    by = rng.uniform(25.0, 70.0) * rng.choice([-1.0, 1.0])
    return truth.translated([by * math.cos(truth.heading), by * math.sin(truth.heading), 0.0])


def raised(by):
    return lambda truth, rng: near(truth, rng).translated([0.0, 0.0, by])


@dataclass(frozen=True)
class Fault:
    """change: of points, shape (n, 3), sensor frame (x ahead, m); start: the prior, of the true pose."""

    change: Callable[[np.ndarray, np.random.Generator], np.ndarray] = as_recorded
    start: Callable[[Pose, np.random.Generator], Pose] = near


NONE, ELSEWHERE = "none", "scans of another drive"
FAULTS = {
    NONE: Fault(),
    "points shuffled": Fault(lambda points, rng: points[rng.permutation(len(points))]),
    "noise 3 cm": Fault(noise(0.03)),
    "noise 6 cm": Fault(noise(0.06)),
    "noise 10 cm": Fault(noise(0.10)),
    "a tenth cut short": Fault(cut_short),
    "clutter 30 %": Fault(clutter(0.3)),
    "clutter 60 %": Fault(clutter(0.6)),
    "every 2nd point": Fault(lambda points, rng: points[::2]),
    "every 4th point": Fault(lambda points, rng: points[::4]),
    "every 8th point": Fault(lambda points, rng: points[::8]),
    "prior 0.2 m too low": Fault(start=raised(-0.2)),
    "prior 0.2 m too high": Fault(start=raised(0.2)),
    "not deskewed at 5 m/s": Fault(not_deskewed(5.0)),
    "not deskewed at 15 m/s": Fault(not_deskewed(15.0)),
    "not deskewed at 30 m/s": Fault(not_deskewed(30.0)),
    "turning 20 degrees/s": Fault(not_deskewed(0.0, 20.0)),
    "10 m/s and 30 degrees/s": Fault(not_deskewed(10.0, 30.0)),
    "8 m/s and -25 degrees/s": Fault(not_deskewed(8.0, -25.0)),
    "5 sweeps at 0.1 m": Fault(put_together(5, 0.1)),
    "5 sweeps at 0.2 m": Fault(put_together(5, 0.2)),
    "scale +1 %": Fault(lambda points, rng: 1.01 * points),
    "scale -2 %": Fault(lambda points, rng: 0.98 * points),
    "range +0.2 m": Fault(lambda points, rng: lengthened(points, 0.2)),
    "range +0.3 m": Fault(lambda points, rng: lengthened(points, 0.3)),
    "mirrored": Fault(lambda points, rng: points * [1.0, -1.0, 1.0]),
    "left side 0.3 m off": Fault(aside(lambda x, y, z: y > 2.5, 0.3)),
    "left side 0.5 m off": Fault(aside(lambda x, y, z: y > 2.5, 0.5)),
    "left side 1 m off": Fault(aside(lambda x, y, z: y > 2.5, 1.0)),
    "left side 1 m nearer": Fault(aside(lambda x, y, z: y > 2.5, -1.0)),
    "facade 0.3 m nearer": Fault(aside(lambda x, y, z: (y > 2.5) & (np.abs(x) < 15.0) & (z > -1.2), -0.3)),
    "front half 0.3 m aside": Fault(aside(lambda x, y, z: x > 0.0, 0.3)),
    "sector of 90 degrees": Fault(within(45.0)),
    "sector of 45 degrees": Fault(within(22.5)),
    "range 12 m": Fault(lambda points, rng: points[np.linalg.norm(points, axis=1) < 12.0]),
    "prior 25 to 70 m off": Fault(start=along),
    ELSEWHERE: Fault(),
}
METHODS = (MaximumConsensus(trust=Trust(largest_misfit=math.inf)), MaximumConsensus())


@dataclass(frozen=True)
class Answer:
    """is_inside: within the ellipse of 95 % of x and y; is_exceeded: a protection level is."""

    is_right: bool
    is_localized: bool
    distance: float
    is_inside: bool
    is_exceeded: bool

    @classmethod
    def of(cls, estimate, truth):
        """An estimate, judged."""
        error, off = pose_error(estimate.pose, truth), estimate.pose.position[:2] - truth.position[:2]
        # Levels are along and across the heading of the estimate.
        seen_from_answer = pose_error(truth, estimate.pose)
        is_inside = False
        if np.isfinite(estimate.covariance[:2, :2]).all():
            is_inside = bool(off @ np.linalg.solve(estimate.covariance[:2, :2], off) <= INSIDE)
        level_along, level_across = estimate.protection_level
        is_exceeded = abs(seen_from_answer.along) > level_along or abs(seen_from_answer.across) > level_across
        return cls(error.is_success, estimate.is_localized, error.distance, is_inside, is_exceeded)


def figures(answers, has_covariance=True):
    """The cells of a row of the table, as words."""
    numbers = [
        sum(answer.is_right is is_right and answer.is_localized is is_localized for answer in answers)
        for is_right, is_localized in ((True, True), (True, False), (False, True), (False, False))
    ]
    localized = [answer for answer in answers if answer.is_localized]
    worst = f"{max(answer.distance for answer in localized):.2f}" if localized else "-"
    inside = exceeded = "-"
    if localized and has_covariance:
        inside = f"{100.0 * sum(answer.is_inside for answer in localized) / len(localized):.0f}"
        exceeded = str(sum(answer.is_exceeded for answer in localized))
    return [*map(str, numbers), worst, inside, exceeded]


@dataclass(frozen=True)
class Drive:
    """A map, scans, and the poses held for true, global coordinates."""

    point_map: PointMap
    scans: Scans
    reference: Trajectory

    def points_and_truth(self, epoch):
        """Points of an epoch within range, m, and its true pose in the map."""
        raw = self.scans.read(epoch, 1.0, 120.0)
        return raw.points.astype(np.float64), self.point_map.frame.pose_to_local(self.reference.at(raw.time))


def answers_of(methods, name, drives, every):
    """Answers of each method to the scans of all drives with one fault."""
    answers = [[] for _ in methods]
    for number, drive in enumerate(drives):
        for epoch in range(0, len(drive.scans), every):
            points, truth = drive.points_and_truth(epoch)
            if name == ELSEWHERE:
                other = drives[number - 1]
                points, _ = other.points_and_truth(epoch % len(other.scans))
            rng = np.random.default_rng([epoch, zlib.crc32(name.encode())])
            prior = FAULTS[name].start(truth, rng)
            points = FAULTS[name].change(points, rng)
            for found, method in zip(answers, methods, strict=True):
                answer = Answer.of(method.localize(Scan(points), drive.point_map, prior), truth)
                found.append(replace(answer, is_right=answer.is_right and name != ELSEWHERE))
    return answers


def opened(options, faults, separator):
    """The names of faults that were asked for, and the drives."""
    names = options.faults.split(separator)
    if not set(names) <= set(faults):
        known = f"{separator} ".join(faults)
        raise OptionError(f"Expected names of faults, got {options.faults}. Take some of: {known}.")
    return names, [
        Drive(PointMap.open(point_map), open_scans(scans), read_trajectory(reference))
        for point_map, scans, reference in options.drive
    ]


def print_head(title, of):
    """Print what comes before the rows of `figures`."""
    header(title)
    print(
        f"| {of} | right, localized | right, refused | wrong, localized | wrong, refused | worst localized, m |"
        " inside 95 %, % | levels exceeded |"
    )
    print("|---|---|---|---|---|---|---|---|")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--drive", nargs=3, action="append", required=True, metavar=("MAP", "SCANS", "REFERENCE"))
    parser.add_argument("--every", type=int, default=1, metavar="N", help="take each N-th scan")
    parser.add_argument("--faults", default=",".join(FAULTS), metavar="NAME,NAME", help="these alone")
    options = parser.parse_args()
    names, drives = opened(options, FAULTS, ",")
    n_epochs = sum(len(range(0, len(drive.scans), options.every)) for drive in drives)
    print_head(f"Faults, {n_epochs} epochs each", "fault")
    for name in names:
        before, after = map(figures, answers_of(METHODS, name, drives, options.every))
        cells = [a if a == b else f"{a}→{b}" for a, b in zip(before, after, strict=True)]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    targets = MapTargets()
    peers = {f"{NONE}: GICP, {gate:g} m": Gicp(gate, targets=targets) for gate in (1.0, 3.0)} if NONE in names else {}
    for name, found in zip(peers, answers_of(list(peers.values()), NONE, drives, options.every), strict=True):
        print(f"| {name} | {' | '.join(figures(found, has_covariance=False))} |")


if __name__ == "__main__":
    main()
