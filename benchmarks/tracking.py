# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Tracking over a drive, beside every epoch by itself: errors, wrong answers called localized, and time.

python benchmarks/tracking.py MAP DATASET [--prior NAME] [--trouble]

The DATASET is a dataset.toml, or a folder with one; with odometry it is tracked with that and with the prior's own
motion. `--trouble` adds, at twelve places of the drive: a gap of 100 m, with and without a prior after it; a beginning
one period of the facades (3 m) off; and odometry that slips by as much. Rows of Markdown come out.
"""

import argparse
import os
import time
from collections import Counter
from dataclasses import dataclass

# Before any library starts threads of its own: all that is timed here is one thread.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from header import header

from maxcon import MaximumConsensus, Motion, MotionNoise, PointMap, Pose, Scan, Status, Tracker, UncertainPose
from maxcon.drive.localize import DriveOptions
from maxcon.io.trajectories import read_trajectory
from maxcon.lab.dataset import Dataset
from maxcon.lab.evaluation import pose_error

PERIOD, GAP = 3.0, 100.0
N_PLACES, N_BEFORE, N_AFTER = 12, 12, 20
WARM_UP = 20
WITHIN, WRONG = 0.1, 0.3
START_SIGMAS = np.array([0.1, 0.1, 0.05, 0.005, 0.005, 0.01])


@dataclass
class Drive:
    """A drive in the local frame of its map."""

    point_map: PointMap
    scans: object
    times: list
    reference: list
    prior: list
    noise_of_prior: MotionNoise
    odometry: list | None

    @classmethod
    def open(cls, map_folder, dataset, prior):
        """Read all of a dataset but its scans."""
        point_map = PointMap.open(map_folder)
        scans = dataset.open_scans()
        times = [float(at) for at in scans.times]
        trajectory = read_trajectory(dataset.priors[prior] if prior else dataset.prior)

        def local(poses):
            return [point_map.frame.pose_to_local(poses.at(at)) for at in times]

        told = None if dataset.odometry is None else read_trajectory(dataset.odometry)
        return cls(
            point_map, scans, times, local(read_trajectory(dataset.reference)), local(trajectory),
            MotionNoise.of_prior(trajectory), None if told is None else [told.at(at) for at in times],
        )  # fmt: skip

    @property
    def way(self):
        """How far each epoch is along the drive, m."""
        positions = np.array([pose.position for pose in self.reference])
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])

    def scan(self, epoch):
        """Points and time (s) of an epoch."""
        options = DriveOptions()
        points = self.scans.read(epoch, options.min_range, options.max_range).points
        return points, self.times[epoch]

    def tracked(self, epochs, tracker, source, has_prior=lambda _: True):
        """Error (m), status and milliseconds of each epoch."""
        last = None
        for epoch in epochs:
            points, at = self.scan(epoch)
            began = time.perf_counter()
            if last is not None:
                tracker.move(Motion.between(source[last], source[epoch], at - self.times[last]))
            last = epoch
            prior = self.prior[epoch] if has_prior(epoch) else None
            estimate = tracker.localize(Scan(points, time=at), self.point_map, prior)
            yield self.judged(estimate, epoch, began)

    def alone(self, method):
        """The same, of every epoch by itself."""
        for epoch in range(len(self.times)):
            points, at = self.scan(epoch)
            began = time.perf_counter()
            yield self.judged(method.localize(Scan(points, time=at), self.point_map, self.prior[epoch]), epoch, began)

    def judged(self, estimate, epoch, began):
        """Error (m), status and milliseconds of an answer."""
        milliseconds = 1e3 * (time.perf_counter() - began)
        if estimate is None:
            return np.inf, Status.NO_PRIOR, milliseconds
        return pose_error(estimate.pose, self.reference[epoch]).distance, estimate.status, milliseconds


def print_drive(name, answers):
    """One row of the table of whole drives."""
    errors, statuses, taken = (np.array(column) for column in zip(*answers, strict=True))
    is_localized = statuses == Status.LOCALIZED
    median, p95, worst = 1e3 * np.quantile(errors[is_localized], [0.5, 0.95, 1.0])
    late = errors[WARM_UP:]
    others = Counter(statuses[~is_localized].tolist())
    said = ", ".join(f"{number} {status}" for status, number in others.items()) or "-"
    print(
        f"| {name} | {is_localized.sum()} of {len(errors)} | {said} | {(is_localized & (errors > WRONG)).sum()}"
        f" | {median:.0f} / {p95:.0f} / {worst:.0f} | {(late <= WITHIN).sum()} of {len(late)}"
        f" | {np.median(taken[3:]):.0f} / {np.quantile(taken[3:], 0.95):.0f} |",
        flush=True,
    )


def print_trouble(name, runs):
    """One row of the table of troubles."""
    n_wrong = [sum(status == Status.LOCALIZED and error > WRONG for error, status, _ in run) for run in runs]
    found = [
        next((k for k, (error, status, _) in enumerate(run) if status == Status.LOCALIZED and error < WITHIN), None)
        for run in runs
    ]
    n_ended = sum(run[-1][1] == Status.LOCALIZED and run[-1][0] < WITHIN for run in runs)
    known = [number for number in found if number is not None]
    print(
        f"| {name} | {len(known)} of {len(runs)} | {int(np.median(known)) + 1} / {max(known) + 1} | {n_ended}"
        f" | {sum(n_wrong)} of {sum(map(len, runs))} |",
        flush=True,
    )


def gaps(drive, method, has_prior):
    """Twenty epochs after each gap."""
    way, runs = drive.way, []
    for first in np.linspace(0, len(way) - 1, N_PLACES + 3).astype(int)[:-1]:
        last = first + N_BEFORE - 1
        after = int(np.searchsorted(way, way[min(last, len(way) - 1)] + GAP))
        if after + 5 > len(way):
            continue
        epochs = [*range(first, last + 1), *range(after, min(after + N_AFTER, len(way)))]
        answers = drive.tracked(
            epochs, Tracker(method), drive.odometry, lambda epoch, last=last: has_prior or epoch <= last
        )
        runs.append(list(answers)[N_BEFORE:])
    return runs


def wrong_starts(drive, method, shift):
    """Twenty epochs from each start that is shifted along the street (m)."""
    runs = []
    for first in np.linspace(0, len(drive.times) - N_AFTER, N_PLACES).astype(int):
        pose = drive.reference[first] @ Pose(shift, 0.0, 0.0, 0.0, 0.0, 0.0)
        tracker = Tracker(method, start=UncertainPose(pose, np.diag(START_SIGMAS**2)))
        runs.append(list(drive.tracked(range(first, first + N_AFTER), tracker, drive.odometry)))
    return runs


def slips(drive, method, slip):
    """Twenty epochs after odometry told a motion that was too long, once (m)."""
    runs = []
    for first in np.linspace(0, len(drive.times) - N_BEFORE - N_AFTER, N_PLACES).astype(int):
        tracker = Tracker(method)
        begun = range(first, first + N_BEFORE)
        list(drive.tracked(begun, tracker, drive.odometry))
        tracker.move(Motion(Pose(slip, 0.0, 0.0, 0.0, 0.0, 0.0), abs(slip), 0.0, 0.0))
        rest = range(first + N_BEFORE - 1, first + N_BEFORE + N_AFTER)
        runs.append(list(drive.tracked(rest, tracker, drive.odometry)))
    return runs


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("map")
    parser.add_argument("dataset")
    parser.add_argument("--prior")
    parser.add_argument("--trouble", action="store_true")
    options = parser.parse_args()
    header(f"Tracking over {options.dataset} {options.prior or ''}".rstrip())
    drive, method = Drive.open(options.map, Dataset.open(options.dataset), options.prior), MaximumConsensus()
    print("\n| | localized | else | wrong, called localized | mm | within 0.1 m from the 21st on | ms |")
    print("|---|---|---|---|---|---|---|")
    everything = range(len(drive.times))
    print_drive("every epoch by itself", drive.alone(method))
    print_drive(
        "tracked, the prior's motion", drive.tracked(everything, Tracker(method, drive.noise_of_prior), drive.prior)
    )
    if drive.odometry is None:
        return
    print_drive("tracked, odometry", drive.tracked(everything, Tracker(method), drive.odometry))
    if not options.trouble:
        return
    print("\n| | found again | after epochs, median / most | right at the end | wrong, called localized |")
    print("|---|---|---|---|---|")
    print_trouble("gap of 100 m", gaps(drive, method, has_prior=True))
    print_trouble("gap of 100 m, no prior since", gaps(drive, method, has_prior=False))
    print_trouble("begun 3 m ahead", wrong_starts(drive, method, PERIOD))
    print_trouble("begun 3 m behind", wrong_starts(drive, method, -PERIOD))
    print_trouble("odometry slips by 3 m", slips(drive, method, PERIOD))


if __name__ == "__main__":
    main()
