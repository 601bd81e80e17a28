# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Walls that are not there are told, facing by facing."""

import math
from dataclasses import replace

import numpy as np
import pytest

from maxcon import PointMap, Pose, Scan
from maxcon.refine import WallShare, group_kernels, least_wall_share, refine


def wall(azimuth, distance, n, seed):
    """Points of a wall that faces the origin, seen at an azimuth (rad); and its normals."""
    rng = np.random.default_rng(seed)
    out = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    along = np.array([-out[1], out[0], 0.0])
    points = distance * out + rng.uniform(-6, 6, (n, 1)) * along + rng.uniform(-1, 4, (n, 1)) * [0.0, 0.0, 1.0]
    return points, np.tile(-out, (n, 1))


def joined(*walls):
    return tuple(np.concatenate(parts) for parts in zip(*walls, strict=True))


HERE = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_the_least_found_facing_is_given():
    along = [wall(math.radians(75), 5.0, 30_000, 0), wall(math.radians(255), 7.0, 30_000, 1)]
    across = wall(math.radians(165), 9.0, 30_000, 2)
    point_map = PointMap.from_points(*joined(*along, across))
    seen = least_wall_share(refine(Scan(*joined(*along, across)), point_map, HERE))
    assert seen.share > 0.95
    nearer = Scan(*joined(*along, wall(math.radians(165), 4.0, 30_000, 3)))
    elsewhere = least_wall_share(refine(nearer, point_map, HERE))
    assert elsewhere.n_found == 0
    assert elsewhere.azimuth == pytest.approx(math.radians(165))
    assert f"of {elsewhere.n_points} wall points facing 165 degrees" in elsewhere.words
    assert elsewhere.words.endswith("0 lie on the map")


@pytest.mark.parametrize("seed", range(5))
def test_counts_are_those_of_azimuths(seed):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(500, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[:100] = 0.0
    normals[100:103] = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    residuals, rotation = rng.normal(0.0, 0.1, 500), Pose(0.0, 0.0, 0.0, 0.1 * seed, 0.0, 0.3 * seed).rotation
    n_points, n_found = np.zeros(6, np.int64), np.zeros(6, np.int64)
    group_kernels.count_walls(normals, residuals, rotation, 0.5, 0.08, n_points, n_found)
    turned = normals @ rotation.T
    is_wall = turned.any(axis=1) & (np.abs(turned[:, 2]) < 0.5)
    azimuths = np.arctan2(turned[is_wall, 1], turned[is_wall, 0]) % math.pi
    facings = np.minimum((azimuths / math.pi * 6).astype(int), 5)
    is_found = np.abs(residuals[is_wall]) <= 0.08
    assert n_points.tolist() == np.bincount(facings, minlength=6).tolist()
    assert n_found.tolist() == np.bincount(facings[is_found], minlength=6).tolist()


def test_few_points_of_a_facing_say_nothing():
    walls = [wall(math.radians(15), 5.0, 30_000, 0), wall(math.radians(105), 5.0, 30_000, 1)]
    point_map = PointMap.from_points(*joined(*walls))
    few = wall(math.radians(50), 3.0, 12, 2)
    assert least_wall_share(refine(Scan(*joined(*walls, few)), point_map, HERE)).share > 0.95
    bare = Scan(walls[0][0], np.zeros_like(walls[0][1]))
    assert least_wall_share(refine(bare, point_map, HERE)) is None


def seen_of(normal, residual, n_points):
    """What is told of so many points of one normal, this far (m) from the map; upright sensor."""
    points, normals = wall(0.3, 5.0, n_points, 0)
    refined = refine(Scan(points, normals), PointMap.from_points(points, normals), HERE)
    normals, residuals = np.tile(normal, (n_points, 1)), np.full(n_points, residual)
    return least_wall_share(replace(refined, pose=HERE, normals=normals, residuals=residuals))


def test_twenty_points_of_a_facing_are_enough():
    assert seen_of([1.0, 0.0, 0.0], 0.0, 19) is None
    assert seen_of([1.0, 0.0, 0.0], 0.0, 20) == WallShare(math.radians(15), 20, 20)


def test_a_wall_is_found_within_eight_centimetres():
    assert seen_of([1.0, 0.0, 0.0], 0.079, 30).n_found == 30
    assert seen_of([1.0, 0.0, 0.0], 0.081, 30).n_found == 0


def test_what_faces_up_is_no_wall():
    assert seen_of([math.sqrt(1 - 0.49**2), 0.0, 0.49], 0.0, 30).n_points == 30
    assert seen_of([math.sqrt(1 - 0.51**2), 0.0, 0.51], 0.0, 30) is None


def test_few_points_are_drawn_to_a_half():
    assert WallShare(0.0, 20, 2).share == 4 / 24
    assert WallShare(0.0, 20, 20).share == 22 / 24
