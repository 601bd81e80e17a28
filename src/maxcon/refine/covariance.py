# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How well a refined pose is known: its covariance, from how the residuals of whole surfaces scatter."""

import numpy as np
from numpy.typing import NDArray

from maxcon.refine.adjustment import MATCH_SIGMA, Refined

__all__ = ["covariance", "map_covariance"]

CLUSTER_EDGE = 3.0
"""Points of one facing within a cube of this edge scatter together, m; so do walls of one facing within this depth."""
N_FACINGS = 12
STEEPEST = 0.7
"""Of a facing by azimuth the normal's vertical part is below this; others face up or down."""
SCATTER_FACTORS = np.array([1.2, 1.2, 1.35, 1.35, 1.35, 1.2])
"""Errors of x, y, z, roll, pitch and heading over what clusters scatter: decision 20.

1.2 where walls hold the pose: of several planes a point takes the nearest, so residuals look smaller and the pose
better held than they are. 1.35 for height and tilts: the noise of walls' normals looks like knowledge of these, too.
"""
WALL_SHARE = 0.3
"""How far a whole wall lies off its planes beside all others, over the map's sigma: few passes saw both."""
TILT_LENGTH, TURN_LENGTH = 20.0, 50.0
"""Over so many metres an error of the map tilts a pose, and turns it, m: the turn as headings of real drives ask."""


def covariance(refined: Refined, map_sigma: float) -> NDArray[np.float64]:
    """Covariance of x, y, z, roll, pitch and heading, shape (6, 6), map axes, m^2, m rad and rad^2.

    Three parts. What the adjustment scatters, as the sandwich A^-1 B A^-1: A are its normal equations, B sums the outer
    products of what each cluster of points pulls with, for points of one surface are wrong together; as independent
    ones real scans would promise too much. What whole walls lie off their planes, a share of the map's sigma, carried
    through the same equations. And what the map itself is wrong by.

    Parameters
    ----------
    refined : Refined
        The adjusted pose.
    map_sigma : float
        Standard deviation of the map's own position along any axis, m.
    """
    from maxcon.refine import group_kernels, kernels

    def pulls(n_groups: int, groups: NDArray[np.int64], factors: NDArray[np.float64]) -> NDArray[np.float64]:
        sums = np.zeros((n_groups, 6))
        kernels.sum_gradients(refined.points, refined.planes, groups, refined.pose.values, factors, sums)
        return sums.T @ sums

    clusters, walls = (np.empty(len(refined.points), np.int64) for _ in range(2))
    n_clusters, n_walls = group_kernels.number_groups(
        refined.points, refined.planes, refined.weights, refined.pose.position, CLUSTER_EDGE, N_FACINGS, STEEPEST,
        clusters, walls,
    )  # fmt: skip
    A = np.linalg.inv(refined.normal_matrix + np.diag(refined.start_weights))
    weighted = np.zeros(len(refined.points))
    np.multiply(refined.weights, refined.residuals, out=weighted, where=refined.weights > 0.0)
    scatter = pulls(n_clusters, clusters, weighted) + np.diag(refined.start_weights) * MATCH_SIGMA**2
    of_scatter = SCATTER_FACTORS[:, None] * (A @ scatter @ A) * SCATTER_FACTORS
    of_walls = (WALL_SHARE * map_sigma) ** 2 * A @ pulls(n_walls, walls, refined.weights) @ A
    return np.asarray(of_scatter + of_walls + map_covariance(map_sigma), dtype=np.float64)


def map_covariance(map_sigma: float) -> NDArray[np.float64]:
    """What a map whose own position has this standard deviation along any axis (m) adds, shape (6, 6), as above."""
    tilt, turn = map_sigma / TILT_LENGTH, map_sigma / TURN_LENGTH
    return np.diag(np.array([map_sigma, map_sigma, map_sigma, tilt, tilt, turn]) ** 2)
