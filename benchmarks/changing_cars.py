# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Write the simulated campaign's map cloud with other cars parked in every round: a truth for temporary objects.

python benchmarks/changing_cars.py OUT [--seed 0] [--rounds 5] [--occupancy 0.7] [--reach 150]

The circuit is mapped as in `maxcon simulate --campaign`, within `reach` m of its start; in each round other cars are
parked, of class 64. Then `python benchmarks/found_classes.py OUT/*.laz --temporary 64`.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from maxcon.geometry import LocalFrame
from maxcon.lab.simulation import CAMPAIGN_GRID, MAPPING_SCANNERS, CampaignWorld, RayCaster, build_city
from maxcon.lab.simulation.datasets import CITY_ORIGIN, CRS, MapTiles


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--occupancy", type=float, default=0.7)
    parser.add_argument("--reach", type=float, default=150.0)
    arguments = parser.parse_args()
    world = CampaignWorld.build(arguments.seed, arguments.rounds)
    city = build_city([arguments.seed, 0], grid=CAMPAIGN_GRID)
    arguments.out.mkdir(parents=True)
    with MapTiles(arguments.out, LocalFrame(CITY_ORIGIN, CRS)) as tiles:
        for number, drive in enumerate(world.mapping.drives):
            caster = RayCaster(city.with_parked_cars([arguments.seed, 100 + number], arguments.occupancy))
            seed = [arguments.seed, 5, number]
            mapping = replace(world.mapping, caster=caster, drives=[drive], seed=seed)
            pieces = mapping.pieces(MAPPING_SCANNERS)
            times = np.array([drive.times[0] + piece.first / piece.scanner.line_rate for piece in pieces])
            places = np.array([[pose.x, pose.y] for pose in drive.poses(times)])
            is_near = np.hypot(*(places - places[0]).T) < arguments.reach
            near = [piece for piece, wanted in zip(pieces, is_near, strict=True) if wanted]
            for returns in mapping.returns(near):
                tiles.write(returns)


if __name__ == "__main__":
    main()
