"""The adjusted pose on scenes whose true pose is known, its partners and its covariance, against plain code."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import PointMap, Pose, Scan
from maxcon.geometry import wrap_angle
from maxcon.lab.evaluation import pose_error
from maxcon.refine import covariance, map_covariance, partner_kernels, refine
from maxcon.refine.adjustment import CLUSTER_EDGE, MATCH_SIGMA, N_BINS, REACH, SCATTER_FACTORS, STEEPEST, WALL_RATIO
from upright_walls import scattered


def off(truth, rng, metres=0.09, degrees=0.25):
    """A start as a search leaves it: within a cell and a half, and half a heading step."""
    dx, dy = rng.uniform(-metres, metres, 2)
    turned = replace(truth, heading=truth.heading + math.radians(rng.uniform(-degrees, degrees)))
    return turned.translated([dx, dy, 0.0])


@pytest.mark.parametrize("share_with_normals", [1.0, 0.3, 0.0])
@pytest.mark.parametrize("seed", range(2))
def test_thin_walls_at_any_offset_from_the_voxels(yard, seed, share_with_normals):
    scan, point_map, truth = yard(seed, share_with_normals=share_with_normals)
    rng = np.random.default_rng(seed)
    for _ in range(3):
        refined = refine(scan, point_map, off(truth, rng))
        assert pose_error(refined.pose, truth).distance < 0.002
        assert abs(wrap_angle(refined.pose.heading - truth.heading)) < math.radians(0.02)
        assert abs(refined.pose.z - truth.z) < 0.002
        assert max(abs(refined.pose.roll - truth.roll), abs(refined.pose.pitch - truth.pitch)) < math.radians(0.02)


def test_there_is_no_bias_over_offsets_and_noise(yard):
    errors = []
    for seed in range(8):
        scan, point_map, truth = yard(100 + seed, noise=0.015)
        error = pose_error(refine(scan, point_map, off(truth, np.random.default_rng(seed))).pose, truth)
        errors.append((error.along, error.across))
    assert np.abs(np.mean(errors, axis=0)).max() < 0.0015 and np.abs(errors).max() < 0.005


def test_height_and_tilt_are_found_where_eaves_tell_them_and_kept_where_nothing_does(yard):
    scan, point_map, truth = yard(3)
    tilted = replace(truth.translated([0.0, 0.0, 0.1]), roll=truth.roll + 0.01, pitch=truth.pitch - 0.01)
    refined = refine(scan, point_map, tilted).pose
    assert abs(refined.z - truth.z) < 0.003
    assert max(abs(refined.roll - truth.roll), abs(refined.pitch - truth.pitch)) < 0.001
    is_wall = np.abs((scan.normals @ truth.rotation.T)[:, 2]) < 0.5
    walls = Scan(scan.points[is_wall], scan.normals[is_wall])
    higher = truth.translated([0.0, 0.0, 0.1])
    refined = refine(walls, point_map, higher).pose
    assert abs(refined.z - higher.z) < 0.02 and pose_error(refined, truth).distance < 0.003


def test_a_tenth_of_clutter_and_a_moved_wall_do_not_pull(yard):
    scan, point_map, truth = yard(5)
    rng = np.random.default_rng(0)
    points, normals = scan.points.copy(), scan.normals.copy()
    n = len(points) // 10
    points[:n] += rng.uniform(-3.0, 3.0, (n, 3))
    normals[:n] = 0.0
    moved = np.abs(points @ [0.0, 1.0, 0.0] - points[:, 1].max()) < 0.4  # a part of one wall stands half a metre off
    points[moved] += 0.5 * normals[moved]
    refined = refine(Scan(points, normals), point_map, off(truth, rng))
    assert pose_error(refined.pose, truth).distance < 0.003


def test_without_a_map_the_start_is_kept_and_its_covariance(yard):
    scan, _, truth = yard(1)
    nothing = PointMap.from_points(np.empty((0, 3)), np.empty((0, 3)))
    refined = refine(scan, nothing, truth)
    assert refined.pose == truth
    assert (refined.n_planes, refined.moved, refined.turned) == (0, 0.0, 0.0)
    start = [1.0, 1.0, 0.3, math.radians(1), math.radians(1), math.radians(5)]
    # The factors by which the coverage of docs/certainty.md was measured.
    sigmas = np.sqrt(np.diag(covariance(refined, 0.0)))
    np.testing.assert_allclose(sigmas, np.multiply([1.2, 1.2, 1.35, 1.35, 1.35, 1.2], start))
    nobody = refine(Scan(np.empty((0, 3)), np.empty((0, 3))), nothing, truth)
    assert nobody.pose == truth
    assert refined != nobody  # each is itself: arrays are not compared


def test_a_single_wall_leaves_the_rest_at_the_start():
    points, normals = scattered((5.013, -4.0), (5.013, 4.0), 4000, 0, (-1.0, 3.0))
    refined = refine(Scan(points, normals), PointMap.from_points(points, normals), Pose(0.05, 0.07, 0.0, 0, 0, 0))
    assert refined.pose.x == pytest.approx(0.0, abs=0.001)
    assert refined.pose.y == pytest.approx(0.07, abs=0.02)


def test_the_same_for_far_coordinates(yard):
    scan, point_map, truth = yard(2, at=(60_000.0, -40_000.0, 300.0))
    refined = refine(scan, point_map, truth.translated([0.05, -0.04, 0.0]))
    assert pose_error(refined.pose, truth).distance < 0.002


def along_normal(point, normal, voxels, cell, step, least_cosine):
    """(distance of the plane, voxel) of those a step along the normal, to both sides, that face as the point does."""
    places = [np.floor((point + t * cell * normal) / cell).astype(int) for t in {step, -step}]
    there = [voxels[tuple(place)] for place in places if tuple(place) in voxels]
    return [(abs(n @ (mean - point)), (n, mean)) for n, mean in there if n @ normal >= least_cosine]


def along_axes(point, voxels, cell, step):
    """(squared distance of the mean, voxel) of those a step along the axes that have a normal."""
    own = np.floor(point / cell).astype(int)
    places = {tuple(own + t * axis) for axis in np.eye(3, dtype=int) for t in (step, -step)}
    there = [voxels[place] for place in places if place in voxels]
    return [(((mean - point) ** 2).sum(), (n, mean)) for n, mean in there if n.any()]


def plain_partner(point, normal, voxels, cell, along, around, least_cosine):
    """The plane of a point, by the words of `refine`: `voxels` maps indices to (normal, mean)."""
    if normal.any():
        rings = [along_normal(point, normal, voxels, cell, step, least_cosine) for step in range(along + 1)]
        first = next((k for k, ring in enumerate(rings) if ring), 0)
        found = [each for ring in rings[: first + 2] for each in ring]
    else:
        found = next(filter(None, (along_axes(point, voxels, cell, step) for step in range(around + 1))), [])
    return min(found, key=lambda each: each[0])[1] if found else None


@given(st.integers(0, 2**32), st.integers(0, 5), st.integers(0, 3))
def test_partners_are_those_of_a_plain_search(seed, along, around):
    rng = np.random.default_rng(seed)
    cell = 0.06
    points = rng.uniform(-0.4, 0.4, (300, 3))
    normals = rng.normal(size=(300, 3)) * [1.0, 1.0, 0.3]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[rng.random(300) < 0.2] = 0.0
    point_map = PointMap.from_points(points, normals, cell)
    voxels = {}
    for tile in point_map.tiles_within(0.0, 0.0, 1.0):
        means = tile.mean_points(cell)
        for index, normal, mean in zip(tile.voxels.tolist(), tile.normals.astype(float), means, strict=True):
            voxels[tuple(index)] = (normal, mean)
    seen = points[:100] + rng.normal(0.0, 0.05, (100, 3))
    facing = normals[:100].copy()
    table = point_map.table_of(point_map.keys_around(seen, REACH))
    planes = partner_kernels.find_partners(seen, facing, np.zeros(6), cell, (along, around), 0.8, True, table)
    for point, normal, plane in zip(seen, facing, planes, strict=True):
        wanted = plain_partner(point, normal, voxels, cell, along, around, 0.8)
        if wanted is None:
            assert not plane.any()
        else:
            np.testing.assert_allclose(plane[:3], wanted[0], atol=1e-12)
            assert plane[3] == pytest.approx(wanted[0] @ wanted[1], abs=1e-9)


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


@pytest.mark.parametrize("seed", [0, 1])
def test_it_is_what_its_words_say(yard, seed):
    scan, point_map, truth = yard(seed, noise=0.01, share_with_normals=0.6)
    refined = refine(Scan(scan.points[::4], scan.normals[::4]), point_map, truth.translated([0.03, 0.02, 0.0]))
    got, wanted = covariance(refined, 0.013), plain_covariance(refined, 0.013)
    scale = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(got / scale / scale[:, None], wanted / scale / scale[:, None], atol=1e-4)
    assert np.linalg.eigvalsh(got / scale / scale[:, None]).min() > 0.0


def test_the_map_adds_what_it_is_wrong_by_and_single_walls_three_tenths_of_it(yard):
    scan, point_map, truth = yard(0)
    refined = refine(Scan(scan.points[::4], scan.normals[::4]), point_map, truth)
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
    assert sigmas[0] < 0.01 and 0.3 < sigmas[1] < 1.5
