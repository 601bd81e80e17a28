# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The significant ray: where it runs, and the scores along it."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from maxcon import Accumulator, Pose, SearchSpace
from maxcon.errors import ArrayError
from maxcon.lab.evaluation import significant_ray

CELL = 0.06
SPACE = SearchSpace(5 * CELL, CELL, 0.5, 0.5)  # 3 headings of 10 x 10 cells
ALONG_X = (0.0, 0.0, 9.0)  # Nxx, Nxy, Nyy of facades along x: they leave x open
ALONG_Y = (9.0, 0.0, 0.0)
ROOT_2 = np.sqrt(2.0)


def made(normal_sums):
    """An accumulator with the same N in each cell."""
    moments = np.zeros((*SPACE.shape, 4))
    moments[..., 1:] = normal_sums
    return Accumulator(moments, SPACE, Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("normal_sums", "n_y", "n_x"),
    [
        (ALONG_X, 0, 1),
        ((1.0, 0.0, 9.0), 0, 1),
        (ALONG_Y, 1, 0),
        ((9.0, 0.0, 1.0), 1, 0),
        ((0.0, 0.0, 0.0), 1, 0),  # no direction: the y axis
        ((4.0, 0.0, 4.0), 1, 0),
    ],
)
def test_the_ray_of_a_street_along_an_axis(normal_sums, n_y, n_x):
    scores = np.arange(300.0).reshape(SPACE.shape)
    cell = (1, 3, 6)
    offsets, along = significant_ray(made(normal_sums), scores, cell)
    np.testing.assert_array_equal(along, scores[1, 3] if n_x else scores[1, :, 6])
    np.testing.assert_allclose(offsets, (np.arange(10) - (6 * n_x + 3 * n_y)) * CELL, atol=1e-15)


@pytest.mark.parametrize(("normal_sums", "sign"), [((2.0, -2.0, 2.0), 1), ((3.0, 2.0, 3.0), -1)])
def test_the_ray_at_45_degrees_lies_between_cells(normal_sums, sign):
    """Bilinear scores, a + b x + c y + d x y, are interpolated exactly."""
    y, x = np.mgrid[:10, :10].astype(float)
    scores = np.broadcast_to(1.0 + 2.0 * x + 3.0 * y + 0.5 * x * y, SPACE.shape)
    offsets, along = significant_ray(made(normal_sums), scores, (2, 5, 4))
    # along (1, 1) / sqrt(2) x runs from 4 down to 0 and y up to 9; along (1, -1) y from 5 down to 0, up to 9
    k = np.arange(-5, 6) if sign > 0 else np.arange(-5, 8)
    at_x, at_y = 4 + k / ROOT_2, 5 + sign * k / ROOT_2
    np.testing.assert_allclose(offsets, k * CELL, atol=1e-15)
    np.testing.assert_allclose(along, 1 + 2 * at_x + 3 * at_y + 0.5 * at_x * at_y, rtol=1e-13)
    assert along[k == 0] == scores[2, 5, 4]


@pytest.mark.parametrize("cell", [(1, 0, 0), (1, 0, 9), (1, 9, 0), (1, 9, 9)])
def test_a_ray_along_the_boundary_is_not_cut_by_rounding(cell):
    scores = np.arange(300.0).reshape(SPACE.shape)
    for normal_sums, wanted in ((ALONG_X, scores[1, cell[1]]), (ALONG_Y, scores[1, :, cell[2]])):
        _, along = significant_ray(made(normal_sums), scores, cell)
        np.testing.assert_array_equal(along, wanted)


@given(st.integers(0, 2**32), st.integers(0, 9), st.integers(0, 9))
def test_the_ray_is_the_eigenvector_of_the_largest_eigenvalue_of_q(seed, iy, ix):
    normals = np.random.default_rng(seed).normal(size=(3, 2))
    normal_matrix = normals.T @ normals
    values, vectors = np.linalg.eigh(np.linalg.inv(normal_matrix))
    assume(values[1] > 1.1 * values[0])
    y, x = (np.broadcast_to(plane, SPACE.shape).astype(float) for plane in np.mgrid[:10, :10])
    accumulator = made(normal_matrix[[0, 0, 1], [0, 1, 1]])
    offsets, at_x = significant_ray(accumulator, x, (1, iy, ix))  # scores that say where they are
    _, at_y = significant_ray(accumulator, y, (1, iy, ix))
    open_x, open_y = vectors[:, 1] * (1 if vectors[0, 1] > 0 else -1)
    np.testing.assert_allclose(at_x, ix + offsets / CELL * open_x, atol=1e-9)
    np.testing.assert_allclose(at_y, iy + offsets / CELL * open_y, atol=1e-9)
    steps = np.rint(offsets / CELL)
    assert (np.diff(steps) == 1).all()
    for beyond in (steps[0] - 1, steps[-1] + 1):  # it goes on as far as the space
        end_x, end_y = ix + beyond * open_x, iy + beyond * open_y
        assert min(end_x, end_y) < 1e-9 or max(end_x, end_y) > 9 - 1e-9


def test_the_scores_that_are_refused():
    with pytest.raises(ArrayError, match=r"scores of shape \(3, 10, 10\), got \(1, 10, 10\)"):
        significant_ray(made(ALONG_X), np.ones((1, 10, 10)), (1, 5, 5))
    with pytest.raises(ArrayError, match=r"finite scores >= 0 .*got -1 to -1"):
        significant_ray(made(ALONG_X), np.full(SPACE.shape, -1.0), (1, 5, 5))
