# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Planes of a block of neighbourhoods against the plane of each, and that against numpy."""

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from maxcon.scan.plane_kernels import BLOCK, covariance, plane_normal, plane_normals

STRIDE = 80


def moments_of(points):
    """Count, sums and sums of products, as `covariance` takes them."""
    products = points.T @ points
    return len(points), points.sum(axis=0), products[np.triu_indices(3)]


def flat_neighbourhood(rng, n, share, middle_share):
    """Points whose covariance has eigenvalues about 1, middle_share and share * middle_share, turned anyhow."""
    turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    sizes = np.sqrt([1.0, middle_share, share * middle_share])
    return rng.normal(size=(n, 3)) * sizes @ turned + rng.normal(size=3)


@given(st.integers(0, 2**32), st.integers(1, BLOCK), st.sampled_from([0.0, 1e-3, 0.1, 0.3, 1.0]))
@example(43373, 11, 0.0)
def test_a_block_of_planes_is_the_plane_of_each(seed, n, share):
    rng = np.random.default_rng(seed)
    moments, planes = np.full(10 * BLOCK, np.nan), np.full(5 * BLOCK, np.nan)
    each = []
    for k in range(n):
        points = flat_neighbourhood(rng, int(rng.integers(6, 50)), share, 10.0 ** rng.uniform(-2, 0))
        count, sums, outers = moments_of(points)
        moments.reshape(10, BLOCK)[:, k] = [count, *sums, *outers]
        matrix, normal = np.empty((3, 3)), np.empty(3)
        covariance(count, sums, outers, matrix)
        each.append((*plane_normal(matrix, normal)[:2], normal))
    plane_normals(n, moments, planes)
    for k, (smallest, middle, normal) in enumerate(each):
        found = planes.reshape(5, BLOCK)[:, k]
        if smallest < 0.5 * middle:
            rounding = 1e-12  # of eigenvalues, the largest of which is about 1: the definition takes an arc cosine
            np.testing.assert_allclose(found[:2], [smallest, middle], rtol=0.0, atol=1e-10 * middle + rounding)
            np.testing.assert_allclose(np.linalg.norm(np.cross(found[2:], normal)), 0.0, atol=1e-9 + rounding / middle)
            np.testing.assert_allclose(np.linalg.norm(found[2:]), 1.0, atol=1e-14)
        else:
            assert not found[0] < 0.45 * found[1]


def test_points_on_a_line_or_at_one_place_make_no_plane():
    rng = np.random.default_rng(0)
    for _ in range(20):
        moments, planes = np.zeros(10 * BLOCK), np.zeros(5 * BLOCK)
        for k in range(BLOCK):
            along = rng.normal(size=(20, 1)) * (k % 2)
            count, sums, outers = moments_of(along * rng.normal(size=3) + rng.normal(size=3))
            moments.reshape(10, BLOCK)[:, k] = [count, *sums, *outers]
        plane_normals(BLOCK, moments, planes)
        assert not (planes.reshape(5, BLOCK)[1] > 1e-6).any()
