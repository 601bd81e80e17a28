# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What the covariance says, and against a plain computation of it."""

import math

import numpy as np
import pytest

from maxcon import PointMap, Pose, Scan
from maxcon.refine import covariance, kernels, map_covariance, refine
from maxcon.refine.adjustment import CLUSTER_EDGE, MATCH_SIGMA, N_BINS, SCATTER_FACTORS, STEEPEST, WALL_RATIO


def plain_covariance(refined, map_sigma):
    """The docstring's words, point by point."""
    pose = refined.pose
    at = np.array([pose.x, pose.y, pose.z, pose.roll, pose.pitch, pose.heading])
    pulls, walls = {}, {}
    A = np.diag(refined.start_weights)
    for point, plane, residual, weight in zip(
        refined.points, refined.planes, refined.residuals, refined.weights, strict=True
    ):
        if weight == 0.0:
            continue
        gradient = np.empty(6)
        for k in range(6):
            step = np.zeros(6)
            step[k] = 1e-5
            there, back = Pose(*(at + step)).apply(point[None])[0], Pose(*(at - step)).apply(point[None])[0]
            gradient[k] = plane[:3] @ (there - back) / 2e-5
        own_bin = N_BINS
        if abs(plane[2]) <= STEEPEST:
            own_bin = math.floor(math.atan2(plane[1], plane[0]) / (2 * math.pi) * N_BINS) % N_BINS
        cube = tuple(np.floor(point / CLUSTER_EDGE).astype(int))
        depth = math.floor((plane[3] - plane[:3] @ pose.position) / CLUSTER_EDGE)
        pulls[cube, own_bin] = pulls.get((cube, own_bin), 0.0) + weight * residual * gradient
        walls[depth, own_bin] = walls.get((depth, own_bin), 0.0) + weight * gradient
        A = A + weight * np.outer(gradient, gradient)
    scatter = sum(np.outer(pull, pull) for pull in pulls.values()) + np.diag(refined.start_weights) * MATCH_SIGMA**2
    wall = sum(np.outer(pull, pull) for pull in walls.values())
    inverse = np.linalg.inv(A)
    factors = np.diag(SCATTER_FACTORS)
    of_map = np.diag(np.array([1, 1, 1, 1 / 20, 1 / 20, 1 / 50]) * map_sigma) ** 2
    of_walls = (WALL_RATIO * map_sigma) ** 2 * inverse @ wall @ inverse
    return factors @ inverse @ scatter @ inverse @ factors + of_walls + of_map


@pytest.mark.parametrize("seed", range(3))
def test_groups_are_those_of_cubes_depths_and_azimuths(seed):
    rng = np.random.default_rng(seed)
    n, edge = 400, 3.0
    points, position = rng.uniform(-9, 9, (n, 3)), rng.uniform(-50, 50, 3)
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[:4] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]
    planes = np.column_stack([normals, normals @ position + rng.uniform(-9, 9, n)])
    weights = rng.uniform(size=n) * (rng.random(n) < 0.8)
    clusters, walls = np.empty(n, np.int64), np.empty(n, np.int64)
    n_groups = kernels.number_groups(points, planes, weights, position, edge, N_BINS, STEEPEST, clusters, walls)
    azimuths = np.arctan2(normals[:, 1], normals[:, 0]) / (2 * math.pi) * N_BINS
    bins = np.where(np.abs(normals[:, 2]) > STEEPEST, N_BINS, np.floor(azimuths) % N_BINS)
    depths = np.floor((planes[:, 3] - normals @ position) / edge)
    for numbers, columns, n_numbers in (
        (clusters, [*np.floor(points / edge).T, bins], n_groups[0]),
        (walls, [depths, bins], n_groups[1]),
    ):
        assert (numbers[weights == 0.0] == -1).all()
        rows = np.column_stack(columns)[weights > 0.0]
        pairs = np.column_stack([rows, numbers[weights > 0.0]])
        different = len(np.unique(rows, axis=0))
        assert different == len(np.unique(pairs, axis=0)) == n_numbers
        assert set(numbers[weights > 0.0]) == set(range(n_numbers))


@pytest.mark.parametrize("seed", [0, 1])
def test_it_is_what_its_words_say(yard, seed):
    scan, point_map, truth = yard(seed, noise=0.01, share_with_normals=0.6)
    refined = refine(scan, point_map, truth.translated([0.03, 0.02, 0.0]))
    got, wanted = covariance(refined, 0.013), plain_covariance(refined, 0.013)
    scale = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(got / scale / scale[:, None], wanted / scale / scale[:, None], atol=1e-4)
    assert np.linalg.eigvalsh(got / scale / scale[:, None]).min() > 0.0


def test_the_map_adds_what_it_is_wrong_by_and_single_walls_three_tenths_of_it(yard):
    scan, point_map, truth = yard(0)
    refined = refine(scan, point_map, truth)
    np.testing.assert_allclose(np.sqrt(np.diag(map_covariance(0.05))), [0.05] * 3 + [0.0025, 0.0025, 0.001], rtol=1e-6)
    of_walls = covariance(refined, 0.05) - covariance(refined, 0.0) - map_covariance(0.05)
    wanted = plain_covariance(refined, 0.05) - plain_covariance(refined, 0.0) - map_covariance(0.05)
    assert (CLUSTER_EDGE, STEEPEST, WALL_RATIO) == (3.0, 0.7, 0.3)
    np.testing.assert_allclose(np.diag(of_walls), np.diag(wanted), rtol=1e-3)
    sigmas = np.sqrt(np.diag(of_walls))
    assert (sigmas > 0.0).all() and (sigmas[:3] < WALL_RATIO * 0.05).all()


def test_between_two_walls_the_open_direction_is_as_uncertain_as_the_start():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.choice([-5.0, 6.0], 6000), rng.uniform(-9, 9, 6000), rng.uniform(-1, 4, 6000)])
    normals = np.column_stack([-np.sign(points[:, 0]), np.zeros(6000), np.zeros(6000)])
    refined = refine(Scan(points, normals), PointMap.from_points(points, normals), Pose(0, 0, 0, 0, 0, 0))
    sigmas = np.sqrt(np.diag(covariance(refined, 0.0)))
    assert sigmas[0] < 0.01
    assert 0.3 < sigmas[1] < 1.5


def test_without_partners_it_is_that_of_the_start(yard):
    scan, _, truth = yard(0)
    nothing = PointMap.from_points(np.empty((0, 3)), np.empty((0, 3)))
    sigmas = np.sqrt(np.diag(covariance(refine(scan, nothing, truth), 0.0)))
    start = [1.0, 1.0, 0.3, math.radians(1), math.radians(1), math.radians(5)]
    # The factors by which the coverage of docs/certainty.md was measured.
    np.testing.assert_allclose(sigmas, np.multiply([1.2, 1.2, 1.35, 1.35, 1.35, 1.2], start))
