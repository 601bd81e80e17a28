# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The filter's two equations against plain NumPy: derivatives by differences, and the update by information."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import Pose
from maxcon.drive.tracking import Motion, MotionNoise, UncertainPose

ANGLES = st.floats(-0.03, 0.03)
POSES = st.builds(Pose, *[st.floats(-50.0, 50.0)] * 3, ANGLES, ANGLES, st.floats(-3.1, 3.1))
MOTIONS = st.builds(
    Motion,
    st.builds(Pose, st.floats(-3.0, 3.0), *[st.floats(-0.3, 0.3)] * 2, ANGLES, ANGLES, st.floats(-0.5, 0.5)),
    st.floats(0.1, 5.0),
    st.floats(0.05, 2.0),
    st.floats(0.0, 0.5),
)


def covariance_of(seed, scale=0.05):
    root = scale * np.random.default_rng(seed).standard_normal((6, 6))
    return root @ root.T + 1e-6 * np.eye(6)


def values(pose):
    return np.array([pose.x, pose.y, pose.z, pose.roll, pose.pitch, pose.heading])


def derivative(of, at, step=1e-6):
    """Central differences of a function of six numbers, shape (6, 6)."""
    columns = []
    for axis in np.eye(6):
        change = of(at + step * axis) - of(at - step * axis)
        change[3:] = np.arctan2(np.sin(change[3:]), np.cos(change[3:]))
        columns.append(change / (2.0 * step))
    return np.array(columns).T


@given(pose=POSES, motion=MOTIONS, seed=st.integers(0, 1000))
def test_a_prediction_is_the_moved_pose_and_the_carried_covariance(pose, motion, seed):
    noise = MotionNoise()
    before = covariance_of(seed)
    moved = UncertainPose(pose, before).moved(motion, noise)
    np.testing.assert_allclose(values(moved.pose), values(pose @ motion.pose), atol=1e-12)
    by_state = derivative(lambda v: values(Pose(*v) @ motion.pose), values(pose))
    by_motion = derivative(lambda v: values(pose @ Pose(*v)), values(motion.pose))
    wanted = by_state @ before @ by_state.T + by_motion @ noise.covariance(motion) @ by_motion.T
    # Positions are exact; how tilts turn is to first order in tilts of 2 degrees.
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    assert np.abs((moved.covariance - wanted) / scale).max() < 0.15
    assert np.abs((moved.covariance - wanted) / scale)[:3, :3].max() < 1e-3


@given(pose=POSES, seed=st.integers(0, 1000), n_known=st.integers(1, 6))
def test_an_update_is_the_weighted_mean(pose, seed, n_known):
    rng = np.random.default_rng(seed)
    before, noise = covariance_of(seed), covariance_of(seed + 1)
    known = rng.permutation(6)[:n_known]
    measured = Pose(*(values(pose) + 0.05 * rng.standard_normal(6)).tolist())
    infinite = np.diag(np.full(6, np.inf))
    infinite[np.ix_(known, known)] = noise[np.ix_(known, known)]
    adjusted = UncertainPose(pose, before).adjusted(measured, infinite)
    observed = np.eye(6)[known]
    information = observed.T @ np.linalg.inv(noise[np.ix_(known, known)])
    after = np.linalg.inv(np.linalg.inv(before) + information @ observed)
    innovation = values(measured) - values(pose)
    innovation[3:] = np.arctan2(np.sin(innovation[3:]), np.cos(innovation[3:]))
    wanted = values(pose) + after @ information @ innovation[known]
    np.testing.assert_allclose(adjusted.covariance, after, atol=1e-7)
    change = values(adjusted.pose) - wanted
    change[3:] = np.arctan2(np.sin(change[3:]), np.cos(change[3:]))
    np.testing.assert_allclose(change, 0.0, atol=1e-6)


def test_headings_are_averaged_across_the_seam():
    variances = np.diag(np.full(6, 0.01))
    before = UncertainPose(Pose(0.0, 0.0, 0.0, 0.0, 0.0, math.pi - 0.01), variances)
    after = before.adjusted(Pose(0.0, 0.0, 0.0, 0.0, 0.0, -math.pi + 0.03), variances)
    assert after.pose.heading == pytest.approx(-math.pi + 0.01)


def test_a_heading_in_doubt_leaves_the_place_ahead_in_doubt_across():
    """One degree over 100 m: 1.75 m across the way, nothing along."""
    variances = np.diag([1e-6, 1e-6, 1e-6, 1e-8, 1e-8, math.radians(1.0) ** 2])
    exact = MotionNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    north = UncertainPose(Pose(0.0, 0.0, 0.0, 0.0, 0.0, math.pi / 2.0), variances)
    moved = north.moved(Motion(Pose(100.0, 0.0, 0.0, 0.0, 0.0, 0.0), 100.0, 10.0, 0.0), exact)
    assert math.sqrt(moved.covariance[0, 0]) == pytest.approx(1.745, rel=1e-3)
    assert math.sqrt(moved.covariance[1, 1]) < 0.01
    assert moved.sigma == pytest.approx(1.745, rel=1e-3)
    np.testing.assert_array_equal(moved.planar_covariance, moved.covariance[[0, 1, 5]][:, [0, 1, 5]])
