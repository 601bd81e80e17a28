# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""An objective of your own: a class with `score(moments)`, used without touching the package.

It chooses the best cell; whether another place is as good is judged by Helmert's score, whatever the objective, so that
a logarithm does as well. `maxcon study --methods own_objective:Determinant` compares its best cells with ours.
"""

import numpy as np
from localize_one_scan import room

import maxcon


class Determinant:
    """The square root of det N: D-optimality, where Helmert's 1 / tr(Q) is A-optimality."""

    def score(self, moments: np.ndarray) -> np.ndarray:
        """Scores, shape (...), of moments, shape (..., 4): count, Nxx, Nxy, Nyy."""
        nxx, nxy, nyy = (moments[..., channel] for channel in (1, 2, 3))
        return np.sqrt(np.maximum(0.0, nxx * nyy - nxy**2))


def main() -> None:
    points, normals = room()
    point_map = maxcon.PointMap.from_points(points, normals)
    seen = np.random.default_rng(0).choice(len(points), 4000, replace=False)
    scan = maxcon.Scan(points[seen] - [5.0, 0.5, 1.8], normals[seen])
    prior = maxcon.Pose(x=5.6, y=0.2, z=1.8, roll=0.0, pitch=0.0, heading=0.0)

    for objective in (maxcon.Count(), maxcon.Helmert(), Determinant()):
        estimate = maxcon.MaximumConsensus(objective=objective).localize(scan, point_map, prior)
        name = type(objective).__name__
        print(f"{name:<12} x {estimate.pose.x:.2f} m, y {estimate.pose.y:.2f} m, {estimate.status}")


if __name__ == "__main__":
    main()
