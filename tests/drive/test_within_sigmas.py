"""A drive searched within the standard deviations of its priors: honest ones, too small ones, huge ones, none."""

import math

import numpy as np
import pytest
from court_drive import FRAME, seen, walls

from maxcon import MaximumConsensus, PointMap, Pose, Scan, SearchSpace, Trajectory
from maxcon.drive.hypotheses import WithinSigmas
from maxcon.errors import OptionError, TrajectoryError

# 40 m by 26 m, one of its corners cut off.
YARD = walls([(5.03, 5.03), (45.03, 5.03), (45.03, 24.03), (36.03, 31.03), (5.03, 31.03)], 0.06)
TIMES = [10.0 + 0.5 * epoch for epoch in range(5)]
UNKNOWN = np.full((3, 3), np.nan)


@pytest.fixture(scope="module")
def point_map():
    return PointMap.from_points(*YARD, 0.06, frame=FRAME)


def truth(epoch):
    return Pose(14.0 + epoch, 15.0, 1.5, 0.0, 0.0, 0.2 + 0.1 * epoch)


@pytest.fixture(scope="module")
def scans():
    return [Scan(*seen(*YARD, truth(epoch), seed=epoch), time=time) for epoch, time in enumerate(TIMES)]


def covariance(sigma, sigma_heading_deg):
    return np.diag([sigma**2, sigma**2, math.radians(sigma_heading_deg) ** 2])


def drive(scans, point_map, offsets, covariances, method=None, **options):
    """Estimates of scans whose priors are off by (x, y, degrees), and the half widths first searched."""
    priors = [
        Pose(pose.x + x, pose.y + y, pose.z, 0.0, 0.0, pose.heading + math.radians(turn_deg))
        for pose, (x, y, turn_deg) in zip(map(truth, range(len(scans))), offsets, strict=True)
    ]
    trajectory = Trajectory.from_poses(
        TIMES[: len(scans)], [FRAME.pose_to_global(pose) for pose in priors], np.array(covariances)
    )
    within = WithinSigmas(method or MaximumConsensus(), trajectory, **options)
    estimates = [within.localize(scan, point_map, prior) for scan, prior in zip(scans, priors, strict=True)]
    return estimates, [within.at(scan.time).space for scan in scans]


def assert_right(estimates):
    for epoch, estimate in enumerate(estimates):
        assert estimate.is_localized, (estimate.status, estimate.reason)
        np.testing.assert_allclose(estimate.pose.position[:2], truth(epoch).position[:2], atol=0.02)


def test_honest_sigmas_make_small_windows_and_all_is_localized(scans, point_map):
    rng = np.random.default_rng(3)
    sigmas = np.linspace(0.2, 1.0, len(TIMES))
    offsets = rng.normal(size=(len(TIMES), 3)).clip(-2.5, 2.5) * sigmas[:, None]
    estimates, spaces = drive(scans, point_map, offsets, [covariance(sigma, sigma) for sigma in sigmas])
    assert_right(estimates)
    assert not any(estimate.was_widened for estimate in estimates)
    assert [space.half_width for space in spaces] == pytest.approx(np.maximum(3.0 * sigmas, 1.0))
    assert [space.heading_half_width_deg for space in spaces] == pytest.approx(np.maximum(3.0 * sigmas, 1.0))
    assert np.mean([space.half_width for space in spaces]) < 2.0


def test_sigmas_that_are_too_small_are_found_out_and_said(scans, point_map):
    offsets = [(0.0, 0.0, 0.0), (4.0, 0.0, 5.0), (-9.0, 4.0, -6.0), (0.3, -0.5, 0.2), (0.0, 18.0, 4.0)]
    estimates, spaces = drive(scans, point_map, offsets, [covariance(0.02, 0.1)] * 5)
    assert {(space.half_width, space.heading_half_width_deg) for space in spaces} == {(1.0, 1.0)}
    assert_right(estimates)
    assert [estimate.was_widened for estimate in estimates] == [False, True, True, False, True]
    assert "4.0 m and 5.0 degrees from the prior, searched first were 1.0 m and 1.0 degrees" in estimates[1].reason
    assert "are its sigmas too small?" in estimates[4].reason and estimates[3].reason == ""


def test_what_is_not_found_says_how_far_it_was_searched_for(scans, point_map):
    rng = np.random.default_rng(2)
    clutter = [Scan(rng.uniform(-9.0, 9.0, (2000, 3)), time=time) for time in TIMES[:2]]
    estimates, _ = drive(clutter, point_map, [(0.0, 0.0, 0.0)] * 2, [covariance(0.02, 0.1)] * 2)
    assert not any(estimate.is_localized for estimate in estimates)
    assert all("searched for up to 24 m around" in estimate.reason for estimate in estimates)


def test_huge_sigmas_are_cut_and_said(scans, point_map):
    estimates, spaces = drive(scans, point_map, [(5.0, -3.0, 8.0)] * 5, [covariance(50.0, 4.0)] * 5)
    assert_right(estimates)
    assert {space.half_width for space in spaces} == {24.0}
    for estimate in estimates:
        assert "3 sigma of the prior are 150 m, searched were 24 m" in estimate.reason


def test_priors_without_a_covariance_are_searched_as_the_method_does(scans, point_map):
    method = MaximumConsensus(SearchSpace(3.0, heading_half_width_deg=2.0))
    covariances = [covariance(0.5, 0.5), UNKNOWN, UNKNOWN, UNKNOWN, covariance(0.5, 0.5)]
    estimates, spaces = drive(scans, point_map, [(0.4, 0.0, 0.2)] * 5, covariances, method, max_gap=1.0)
    assert_right(estimates)
    assert [space.half_width for space in spaces] == [1.5, 3.0, 3.0, 3.0, 1.5]


def test_cells_steps_and_heights_are_those_of_the_method_and_what_is_refused():
    method = MaximumConsensus(SearchSpace(3.0, 0.12, 2.0, 0.25, 0.24))
    trajectory = Trajectory.from_poses([0.0], [truth(0)], covariance(0.5, 0.6)[None])
    space = WithinSigmas(method, trajectory, sigmas=2.0).at(0.0).space
    assert (space.half_width, space.heading_half_width_deg) == (pytest.approx(1.08), 1.25)
    assert (space.cell, space.heading_step_deg, space.height_half_width) == (0.12, 0.25, 0.24)
    with pytest.raises(OptionError, match=r"largest half width above 0 m, got 0\.0\. Default: 24 m"):
        WithinSigmas(MaximumConsensus(), trajectory, largest_half_width=0.0)
    with pytest.raises(TrajectoryError, match="within the trajectory"):
        WithinSigmas(MaximumConsensus(), trajectory).at(1.0)
