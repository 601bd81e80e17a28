# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The normal equations of ICP, against finite differences and by hand."""

import math

import numpy as np
import pytest

from maxcon.errors import OptionError
from maxcon.lab.baselines import Residual
from maxcon.lab.baselines.icp import smallest_step
from maxcon.search.accumulator import turn


@pytest.fixture
def correspondences():
    generator = np.random.default_rng(3)
    arms = generator.normal(0.0, 8.0, (50, 3))
    partners = arms + generator.normal(0.0, 0.5, (50, 3))
    normals = generator.normal(size=(50, 3))
    return arms, partners, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def residuals(kind, pose, arms, partners, normals):
    x, y, heading = pose
    offsets = turn(arms, heading) + [x, y, 0.0] - partners
    return (normals * offsets).sum(axis=1) if kind is Residual.PLANE else offsets.ravel()


@pytest.mark.parametrize("kind", list(Residual))
def test_normal_equations_are_those_of_finite_differences(kind, correspondences):
    arms, partners, normals = correspondences
    N, gradient = kind.normal_equations(arms, arms - partners, normals)
    step = 1e-6
    design = np.column_stack(
        [
            (residuals(kind, d, *correspondences) - residuals(kind, -d, *correspondences)) / (2 * step)
            for d in step * np.eye(3)
        ]
    )
    np.testing.assert_allclose(N, design.T @ design, rtol=1e-6, atol=1e-4)
    np.testing.assert_allclose(gradient, design.T @ residuals(kind, np.zeros(3), *correspondences), rtol=1e-6)


def test_a_step_along_the_gradient_lowers_the_sum_of_squares(correspondences):
    arms, partners, normals = correspondences
    for kind in Residual:
        step, is_full = smallest_step(kind.normal_equations(arms, arms - partners, normals), 10.0)
        assert is_full
        before, after = (residuals(kind, pose, *correspondences) for pose in (np.zeros(3), step))
        assert after @ after < before @ before


@pytest.mark.parametrize("wall_deg", [0.0, 31.0, 90.0])
def test_sliding_along_a_wall_costs_nothing(wall_deg):
    """The element-wise product n*r, squared and summed, pulls a point back along an oblique wall; n.r does not."""
    wall = math.radians(wall_deg)
    along, normal = (np.array([math.cos(wall), math.sin(wall), 0.0]), np.array([-math.sin(wall), math.cos(wall), 0.0]))
    arms = np.linspace(-10.0, 10.0, 21)[:, None] * along + 5.0 * normal
    offsets, normals = np.tile(0.3 * along, (21, 1)), np.tile(-normal, (21, 1))
    N, gradient = Residual.PLANE.normal_equations(arms, offsets, normals)
    np.testing.assert_allclose(gradient, 0.0, atol=1e-12)
    np.testing.assert_allclose(N[:2, :2] @ along[:2], 0.0, atol=1e-12)
    elementwise = (normals * normals * offsets)[:, :2].sum(axis=0)
    assert np.allclose(elementwise, 0.0, atol=1e-12) == (wall_deg in (0.0, 90.0))


def test_point_equations_by_hand():
    arms, offsets = (np.array([[2.0, 1.0, 9.0], [0.0, -3.0, 9.0]]), np.array([[0.1, 0.2, 5.0], [0.3, 0.0, 5.0]]))
    N, gradient = Residual.POINT.normal_equations(arms, offsets, np.zeros((2, 3)))
    assert N.tolist() == [[2.0, 0.0, 2.0], [0.0, 2.0, 2.0], [2.0, 2.0, 14.0]]
    np.testing.assert_allclose(gradient, [0.4, 0.2, 2.0 * 0.2 - 1.0 * 0.1 + 3.0 * 0.3])


def test_plane_equations_by_hand():
    arms, offsets = np.array([[2.0, 1.0, 9.0]]), np.array([[0.5, 0.25, 1.0]])
    N, gradient = Residual.PLANE.normal_equations(arms, offsets, np.array([[0.6, 0.0, 0.8]]))
    np.testing.assert_allclose(N, np.outer([0.6, 0.0, -0.6], [0.6, 0.0, -0.6]))
    np.testing.assert_allclose(gradient, 1.1 * np.array([0.6, 0.0, -0.6]))


def test_an_open_direction_does_not_move():
    N = np.diag([4.0, 0.0, 100.0])
    step, is_full = smallest_step((N, np.array([-2.0, 0.0, 1.0])), 5.0)
    np.testing.assert_allclose(step, [0.5, 0.0, -0.01])
    assert not is_full
    step, is_full = smallest_step((np.zeros((3, 3)), np.zeros(3)), 5.0)
    assert step.tolist() == [0.0, 0.0, 0.0]
    assert not is_full


def test_a_full_step_solves_the_equations():
    N, gradient = (np.array([[3.0, 1.0, 20.0], [1.0, 2.0, -5.0], [20.0, -5.0, 900.0]]), np.array([1.0, -2.0, 30.0]))
    step, is_full = smallest_step((N, gradient), 12.0)
    assert is_full
    np.testing.assert_allclose(N @ step, -gradient, rtol=1e-12)


def test_an_unknown_residual_is_refused():
    with pytest.raises(OptionError, match="'plane' or 'point', got 'line'"):
        Residual.parse("line")
