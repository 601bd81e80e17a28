# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What can go wrong with the vehicle and the odometry of a track, and how often is it noticed?

python benchmarks/faults_of_tracks.py --drive MAP SCANS REFERENCE [--drive ...] [--tracks N] [--faults 'NAME;NAME']

N tracks of each drive begin at places evenly along it, with priors up to 1 m and 2 degrees off; all but the first
epochs have none where it says so. Odometry is that of the reference, 1 % too long, turning 0.05 degrees a second too
much. Beside them, GICP starts each time from its last answer and the odometry.
"""

import argparse
import math
from dataclasses import dataclass, replace

import numpy as np
from faults import Answer, figures, opened, print_head

from maxcon import MaximumConsensus, Motion, Scan, Tracker
from maxcon.lab.baselines import Gicp, MapTargets

N_BEFORE, N_AFTER = 12, 19
"""Epochs of a track before the fault, and with it."""
CARRIED = 97.0
OFFSET, HEADING_DEG = 1.0, 2.0
"""Priors are off by up to this in x, in y, m, and in heading."""
TOO_LONG, DRIFT_DEG = 1.01, 0.05


@dataclass(frozen=True)
class Fault:
    """carried: so far along the drive, m, after the first epochs; drift_deg: of the odometry, degrees a second."""

    carried: float = 0.0
    drift_deg: float = 0.0
    has_prior: bool = False


FAULTS = {
    "none": Fault(),
    f"carried {CARRIED:g} m away": Fault(carried=CARRIED),
    f"carried {CARRIED:g} m away, priors": Fault(carried=CARRIED, has_prior=True),
    "odometry turns 1 degree/s": Fault(drift_deg=1.0),
    "odometry turns 5 degrees/s": Fault(drift_deg=5.0),
    "odometry turns 5 degrees/s, priors": Fault(drift_deg=5.0, has_prior=True),
}


class FrameByFrame:
    """A method without memory that starts from its last answer and the motion; it moves and localizes as a tracker."""

    def __init__(self, method):
        self.method, self.pose = method, None

    def move(self, motion):
        """Take account of a motion since the last scan."""
        self.pose = self.pose @ motion.pose

    def localize(self, scan, point_map, prior):
        """Find the pose of a scan from the prediction; the prior begins."""
        estimate = self.method.localize(scan, point_map, prior if self.pose is None else self.pose)
        self.pose = estimate.pose
        return estimate


def told(before, after, seconds, drift_deg):
    """The motion between two true poses, as odometry tells it."""
    true = Motion.between(before, after, seconds)
    turn = math.radians(drift_deg) * seconds
    pose = replace(true.pose, x=TOO_LONG * true.pose.x, heading=true.pose.heading + turn)
    return replace(true, pose=pose, distance=TOO_LONG * true.distance, turned=abs(pose.heading))


def prior_of(truth, rng):
    x, y = rng.uniform(-OFFSET, OFFSET, 2)
    turn = math.radians(rng.uniform(-HEADING_DEG, HEADING_DEG))
    return replace(truth, heading=truth.heading + turn).translated([x, y, 0.0])


def way_of(poses):
    """How far along the drive each pose is, m."""
    positions = np.array([pose.position[:2] for pose in poses])
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions, axis=0), axis=1))])


def epochs_of(way, first, carried):
    """Epochs of a track: the first ones, and those with the fault, carried so far ahead or, where more follow, back."""
    last = first + N_BEFORE - 1
    ahead = int(np.searchsorted(way, way[last] + carried)) if carried else last + 1
    back = int(np.searchsorted(way, way[last] - carried)) if way[last] >= carried > 0.0 else len(way)
    after = min(ahead, back, key=lambda epoch: max(epoch, len(way) - N_AFTER))
    return range(first, last + 1), range(after, min(after + N_AFTER, len(way)))


def answers_of(make, fault, drives, n_tracks):
    """Answers to the epochs with the fault, of a tracker that `make` returns anew for each track."""
    for drive in drives:
        times = drive.scans.times.tolist()
        truths = [drive.point_map.frame.pose_to_local(drive.reference.at(at)) for at in times]
        way = way_of(truths)
        for number, first in enumerate(np.linspace(0, len(way) - N_BEFORE - N_AFTER, n_tracks).astype(int).tolist()):
            before, after = epochs_of(way, first, fault.carried)
            tracker, rng, last = make(), np.random.default_rng([number, len(way)]), first
            for epoch in [*before, *after]:
                points, truth = drive.points_and_truth(epoch)
                if fault.carried and epoch == after.start:
                    last = epoch  # without notice: as if the vehicle had stood
                if epoch != first:
                    tracker.move(told(truths[last], truth, times[epoch] - times[last], fault.drift_deg))
                last, prior = epoch, prior_of(truth, rng)
                has_prior = epoch in before or fault.has_prior
                scan = Scan(points, time=times[epoch])
                estimate = tracker.localize(scan, drive.point_map, prior if has_prior else None)
                if epoch in after:
                    yield Answer.of(estimate, truth)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--drive", nargs=3, action="append", required=True, metavar=("MAP", "SCANS", "REFERENCE"))
    parser.add_argument("--tracks", type=int, default=10, metavar="N", help="of each drive")
    parser.add_argument("--faults", default=";".join(FAULTS), metavar="NAME;NAME", help="these alone")
    parser.add_argument("--without-gicp", action="store_true")
    options = parser.parse_args()
    names, drives = opened(options, FAULTS, ";")
    print_head(f"Faults of tracks, {options.tracks} of each drive", "track")
    targets = MapTargets()
    methods = {"": lambda: Tracker(MaximumConsensus())}
    if not options.without_gicp:
        methods["GICP, 1 m: "] = lambda: FrameByFrame(Gicp(1.0, targets=targets))
    for prefix, make in methods.items():
        for name in names:
            cells = figures(list(answers_of(make, FAULTS[name], drives, options.tracks)), not prefix)
            print(f"| {prefix}{name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
