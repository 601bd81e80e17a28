# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Rounds of a simulated campaign, each displaced by errors that are known: what `map align` is judged on.

    python benchmarks/displaced_rounds.py CAMPAIGN OUT --drift 0.02

CAMPAIGN is what `maxcon simulate --campaign` wrote. Its own georeferencing errors are taken off; each round is turned
about its middle and shifted, and drifts besides. OUT holds map/*.laz and map/trajectory.txt.
"""

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from maxcon.geometry import rotation_matrices
from maxcon.io.trajectories import read_trajectory, write_tum
from maxcon.lab.simulation.datasets import CITY_ORIGIN
from maxcon.lab.simulation.drive import GeoreferencingErrors, draw_georeferencing_errors
from maxcon.lab.simulation.worlds import CampaignWorld
from maxcon.scan.trajectory import Trajectory

PAUSE = 20.0
CENTRE = np.array(CITY_ORIGIN)


@dataclass(frozen=True)
class Displacement:
    """What each round is moved by: true points to displaced ones.

    starts : (n_rounds,), s; shifts : (n_rounds, 3), m; turns : (n_rounds, 3), roll, pitch, heading, rad, about the
    middle of the city; drift : m, over time.
    """

    starts: np.ndarray
    shifts: np.ndarray
    turns: np.ndarray
    drift: GeoreferencingErrors

    def moved(self, points, times):
        """Where true points, global, m, of some times, s, are said to be."""
        rounds = self.rounds(times)
        moved = points - CENTRE
        for number in np.unique(rounds):
            rows = rounds == number
            moved[rows] = moved[rows] @ rotation_matrices(*self.turns[number]).T + self.shifts[number]
        return moved + CENTRE + self.drift.at(times)

    def rounds(self, times):
        """Number of the round of each time."""
        return np.searchsorted(self.starts, times, side="right") - 1


def displacement_of(drives, seed, sigma, sigma_deg, drift):
    rng = np.random.default_rng([seed, 16])
    starts = np.array([drive.times[0] for drive in drives]) - 0.5 * PAUSE
    first, last = float(drives[0].times[0]) - 10.0, float(drives[-1].times[-1]) + 10.0
    return Displacement(
        starts,
        rng.normal(0.0, sigma, (len(drives), 3)),
        rng.normal(0.0, math.radians(sigma_deg), (len(drives), 3)),
        draw_georeferencing_errors([seed, 17], first, last, drift),
    )


def displace_cloud(source, target, displacement, believed):
    import laspy

    with laspy.open(source) as reader:
        header = reader.header
        with laspy.open(target, mode="w", header=header, do_compress=True) as writer:
            for record in reader.chunk_iterator(1_000_000):
                times = np.array(record.gps_time)
                points = np.column_stack([record.x, record.y, record.z]) - believed.at(times)
                points = displacement.moved(points, times)
                scaled = np.rint((points - header.offsets) / header.scales).astype(np.int32)
                record.X, record.Y, record.Z = scaled.T
                writer.write_points(record)


def add_arguments(parser):
    parser.add_argument("campaign", type=Path)
    parser.add_argument("--campaign-seed", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sigma", type=float, default=0.1)
    parser.add_argument("--sigma-deg", type=float, default=0.05)
    parser.add_argument("--drift", type=float, default=0.0)


def truth_of(options):
    """The errors that the campaign was simulated with, and those it is displaced by."""
    world = CampaignWorld.build(options.campaign_seed)
    given = (options.seed, options.sigma, options.sigma_deg, options.drift)
    return world.mapping.georeferencing, displacement_of(world.mapping.drives, *given)


def main():
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    parser.add_argument("out", type=Path)
    parser.add_argument("--only", default="tile_*.laz")
    options = parser.parse_args()
    believed, displacement = truth_of(options)
    (options.out / "map").mkdir(parents=True)
    for source in sorted((options.campaign / "map").glob(options.only)):
        displace_cloud(source, options.out / "map" / source.name, displacement, believed)
    read = read_trajectory(options.campaign / "map/trajectory.txt")
    positions = displacement.moved(read.positions - believed.at(read.times), read.times)
    write_tum(options.out / "map/trajectory.txt", Trajectory(read.times, positions, read.quaternions_xyzw))
    np.set_printoptions(precision=4, suppress=True)
    print(np.column_stack([displacement.shifts, np.degrees(displacement.turns)]))


if __name__ == "__main__":
    main()
