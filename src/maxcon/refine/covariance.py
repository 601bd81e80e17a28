# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How well a refined pose is known: its covariance, from residuals whose errors are shared within a surface."""

import numpy as np
from numpy.typing import NDArray

from maxcon.refine.adjustment import MATCH_SIGMA, Refined

__all__ = ["covariance", "map_covariance"]

CLUSTER_EDGE = 3.0
"""Edge, m, of the cubes within which points of one facing are off together; walls of one facing are this deep."""
N_FACINGS = 12
"""Sectors of azimuth, of a full turn, that normals are sorted into."""
STEEPEST = 0.7
"""Normals with a larger vertical part face up or down, which is one facing more; others face an azimuth."""
SCATTER_FACTORS = np.array([1.2, 1.2, 1.35, 1.35, 1.35, 1.2])
"""True standard deviations of x, y, z, roll, pitch and heading over those that clusters predict: decision 20.

1.2 where walls hold the pose: of several planes a point takes the nearest, so residuals look smaller and the pose
better held than they are. 1.35 for height and tilts: the noise of walls' normals looks like knowledge of these, too.
"""
WALL_SHARE = 0.3
"""Standard deviation of one wall's position relative to the others, over the map's sigma: few passes saw both."""
TILT_LENGTH, TURN_LENGTH = 20.0, 50.0
"""The map tilts and turns a pose by its sigma over these lengths, m; the second as headings of real drives scatter."""


def covariance(refined: Refined, map_sigma: float) -> NDArray[np.float64]:
    """Covariance of x, y, z, roll, pitch and heading, shape (6, 6), map axes, m^2, m rad and rad^2.

    A sum of three parts. The scatter of the adjustment is the cluster-robust "sandwich" A^-1 B A^-1: A is its normal
    matrix, and B sums g g' over clusters of points, g the sum of weight times residual times gradient over a cluster.
    Points of one surface are off together; taken for independent, they would promise too much of real scans. Whole
    walls are off by a share of the map's sigma, propagated through the same equations. And the map itself is off.

    Parameters
    ----------
    refined : Refined
        The adjusted pose.
    map_sigma : float
        Standard deviation of the map's own position along any axis, m.
    """
    from maxcon.refine import group_kernels, kernels

    def outer_sums(n_groups: int, groups: NDArray[np.int64], factors: NDArray[np.float64]) -> NDArray[np.float64]:
        sums = np.zeros((n_groups, 6))
        kernels.sum_gradients(refined.points, refined.planes, groups, refined.pose.values, factors, sums)
        return sums.T @ sums

    clusters, walls = (np.empty(len(refined.points), np.int64) for _ in range(2))
    n_clusters, n_walls = group_kernels.number_groups(
        refined.points, refined.planes, refined.weights, refined.pose.position, CLUSTER_EDGE, N_FACINGS, STEEPEST,
        clusters, walls,
    )  # fmt: skip
    A_inv = np.linalg.inv(refined.normal_matrix + np.diag(refined.start_weights))
    weighted = np.zeros(len(refined.points))
    np.multiply(refined.weights, refined.residuals, out=weighted, where=refined.weights > 0.0)
    scatter = outer_sums(n_clusters, clusters, weighted) + np.diag(refined.start_weights) * MATCH_SIGMA**2
    of_scatter = SCATTER_FACTORS[:, None] * (A_inv @ scatter @ A_inv) * SCATTER_FACTORS
    of_walls = (WALL_SHARE * map_sigma) ** 2 * A_inv @ outer_sums(n_walls, walls, refined.weights) @ A_inv
    return np.asarray(of_scatter + of_walls + map_covariance(map_sigma), dtype=np.float64)


def map_covariance(map_sigma: float) -> NDArray[np.float64]:
    """Covariance, (6, 6), that the map's own error adds to that of a pose: see `covariance`.

    Parameters
    ----------
    map_sigma : float
        Standard deviation of the map's own position along any axis, m.
    """
    tilt, turn = map_sigma / TILT_LENGTH, map_sigma / TURN_LENGTH
    return np.diag(np.array([map_sigma, map_sigma, map_sigma, tilt, tilt, turn]) ** 2)
