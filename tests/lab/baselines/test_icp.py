"""ICP on streets whose answer is known, and where it must say that it does not know."""

import math
from dataclasses import replace

import numpy as np
import pytest
from walled_streets import Street, skip_without_its_package

from maxcon import PointMap, Pose, Status
from maxcon.lab.baselines import Gicp, Icp, Residual
from maxcon.search.accumulator import turn


def test_point_to_point_at_a_corner():
    corner = Street().wall((12.0, -8.0), (12.0, 7.0), (-9.0, 7.0))
    estimate = Icp("point").localize(corner.scan(), corner.point_map, corner.prior(0.3, 0.2, 0.5))
    assert estimate.is_localized and corner.distance(estimate.pose) < 0.03
    np.testing.assert_allclose(estimate.cofactor, np.eye(2) / estimate.score)


@pytest.mark.parametrize("angle", [0.0, 0.54])
@pytest.mark.parametrize("heading", [0.4, 2.0])
@pytest.mark.parametrize(("method", "step"), [(Icp(), 0.15), (Gicp(), 0.02)])
def test_one_wall_leaves_a_direction_open(method, step, heading, angle):
    skip_without_its_package(method)
    wall = Street(angle, Pose(3.217, -1.463, 1.7, 0.0, 0.0, heading)).wall((-20.0, 6.0), (20.0, 6.0))
    estimate = method.localize(wall.scan(step=step), wall.point_map, wall.prior(0.4, 0.4))
    assert estimate.status == Status.UNDETERMINED
    along, across = wall.error(estimate.pose)
    assert abs(across) < 0.02
    assert 0.3 < along < 0.5 or isinstance(method, Gicp)  # nothing pulls it


def test_without_normals_there_are_no_planes_and_without_sides_the_answer_is_the_same(street, street_map, street_scan):
    indices, _, normals = street_map.all_voxels()
    centres = (indices + 0.5) * street_map.cell
    bare = PointMap.from_points(centres, np.zeros_like(normals), street_map.cell)
    assert Icp("plane").localize(street_scan, bare, street.sensor).status == Status.NO_MATCH
    assert Icp("point").localize(street_scan, bare, street.sensor).is_localized
    flipped = normals * np.random.default_rng(0).choice([-1.0, 1.0], (len(normals), 1))
    unsigned = PointMap.from_points(centres, flipped, street_map.cell, is_signed=False)
    estimate = Icp().localize(street_scan, unsigned, street.prior(0.4, 0.2))
    assert estimate.is_localized and street.distance(estimate.pose) < 0.003


def test_the_heading_turns_about_the_sensor():
    """Far from the origin a turn about anything else would carry the sensor away at once."""
    far = Street(sensor=Pose(812.3, -455.7, 1.7, 0.0, 0.0, -2.9))
    far.facades().pilasters([-13.7, -6.1, 3.3, 9.4])
    start = far.prior(turn_deg=2.0)
    one_step = Icp(max_iterations=1).localize(far.scan(), far.point_map, start)
    assert far.distance(one_step.pose) < 0.3
    assert abs(one_step.pose.heading - far.sensor.heading) < 0.5 * math.radians(2.0)
    estimate = Icp().localize(far.scan(), far.point_map, start)
    assert far.distance(estimate.pose) < 0.005
    assert abs(estimate.pose.heading - far.sensor.heading) < math.radians(0.02)


@pytest.mark.parametrize(("method", "step"), [(Icp(thinning=0.0), 0.15), (Gicp(), 0.04)])
def test_the_gate_decides_whether_a_far_wall_is_seen(method, step):
    skip_without_its_package(method)
    dead_end = Street().facades(length=30.0).wall((14.0, -6.0), (14.0, 6.0))
    scan, point_map, start = dead_end.scan(step=step), dead_end.point_map, dead_end.prior(along=-2.0)
    narrow, wide = (replace(method, gate=gate).localize(scan, point_map, start) for gate in (1.0, 3.0))
    assert dead_end.distance(narrow.pose) > 1.0 and wide.is_localized
    assert dead_end.distance(wide.pose) < 0.05 and narrow.share < 0.9 < wide.share


def test_a_periodic_facade_traps_it_one_period_off():
    periodic = Street().facades(length=61.0).pilasters(np.arange(-28.5, 29.0, 3.0))
    estimate = Icp(gate=1.0).localize(periodic.scan(), periodic.point_map, periodic.prior(along=2.2))
    along, across = periodic.error(estimate.pose)
    assert estimate.is_localized  # and wrong: it cannot know
    assert abs(along - 3.0) < 0.05 and abs(across) < 0.02


@pytest.mark.parametrize("angle_deg", [0.0, 58.0, 149.0])
def test_in_a_street_at_any_angle_roll_pitch_and_height_are_the_prior_s(angle_deg):
    sensor = Pose(3.2, -1.4, 1.9, 0.05, -0.04, 0.9)
    street = Street(math.radians(angle_deg), sensor).facades().pilasters([-13.7, -6.1, 3.3, 9.4])
    scan, point_map, prior = street.scan(), street.point_map, street.prior(0.5, 0.3, -1.0)
    estimate = Icp().localize(scan, point_map, prior)
    assert estimate.is_localized and estimate.share > 0.99
    assert (estimate.cell, estimate.runner_up) == (None, math.inf)
    assert abs(estimate.pose.heading - sensor.heading) < math.radians(0.02)
    assert (estimate.pose.z, estimate.pose.roll, estimate.pose.pitch) == (1.9, 0.05, -0.04)
    assert street.distance(estimate.pose) < 0.011  # walls along an axis lie up to half a voxel beside their voxels
    level = Icp().localize(scan, point_map, replace(prior, roll=0.0, pitch=0.0))
    assert (level.pose.roll, level.pose.pitch) == (0.0, 0.0)


@pytest.mark.parametrize(("options", "prior", "status"), [
    ({"max_iterations": 1}, {"along": 0.5}, Status.NOT_CONVERGED),
    ({"max_iterations": 1, "step_tolerance": 1.0, "turn_tolerance": 1.0}, {"along": 0.5}, Status.LOCALIZED),
    ({"max_iterations": 1, "step_tolerance": 0.2}, {"turn_deg": 0.5}, Status.NOT_CONVERGED),
    ({"max_iterations": 1, "step_tolerance": 0.2}, {}, Status.LOCALIZED),
])  # fmt: skip
def test_it_has_converged_when_neither_step_nor_turn_is_long(street, street_map, street_scan, options, prior, status):
    estimate = Icp(**options).localize(street_scan, street_map, street.prior(**prior))
    assert estimate.status == status and street.distance(estimate.pose) < 0.5


@pytest.mark.parametrize("kind", list(Residual))
def test_normal_equations_are_those_of_finite_differences(kind):
    generator = np.random.default_rng(3)
    arms = generator.normal(0.0, 8.0, (50, 3))
    partners = arms + generator.normal(0.0, 0.5, (50, 3))
    normals = generator.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)

    def residuals(x, y, heading):
        offsets = turn(arms, heading) + [x, y, 0.0] - partners
        return (normals * offsets).sum(axis=1) if kind is Residual.PLANE else offsets.ravel()

    N, gradient = kind.normal_equations(arms, arms - partners, normals)
    step = 1e-6
    design = np.column_stack([(residuals(*d) - residuals(*-d)) / (2 * step) for d in step * np.eye(3)])
    np.testing.assert_allclose(N, design.T @ design, rtol=1e-6, atol=1e-4)
    np.testing.assert_allclose(gradient, design.T @ residuals(0.0, 0.0, 0.0), rtol=1e-6)
