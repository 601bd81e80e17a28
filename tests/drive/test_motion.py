"""Motions, put together, and how well they are known; the filter's two equations against plain NumPy."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import Pose, Trajectory
from maxcon.drive.motion import Motion, MotionNoise, UncertainPose
from maxcon.drive.tracker import TrackingOptions
from maxcon.errors import OptionError

ANYWHERE = Pose(458_800.0, 5_429_000.0, 100.0, 0.02, -0.03, 2.9)
AHEAD = Pose(2.0, 0.1, 0.01, 0.001, -0.002, 0.05)
ANGLES = st.floats(-0.03, 0.03)
POSES = st.builds(Pose, *[st.floats(-50.0, 50.0)] * 3, ANGLES, ANGLES, st.floats(-3.1, 3.1))
MOTIONS = st.builds(
    Motion, st.builds(Pose, st.floats(-3.0, 3.0), *[st.floats(-0.3, 0.3)] * 2, ANGLES, ANGLES, st.floats(-0.5, 0.5)),
    st.floats(0.1, 5.0), st.floats(0.05, 2.0), st.floats(0.0, 0.5),
)  # fmt: skip


def same(pose, other):
    np.testing.assert_allclose(pose.position, other.position, atol=1e-8)
    np.testing.assert_allclose(pose.rotation, other.rotation, atol=1e-12)


def test_motions_are_those_of_the_vehicle_and_one_after_another_are_one():
    motion = Motion.between(ANYWHERE, ANYWHERE @ AHEAD, 0.5)
    same(motion.pose, AHEAD)
    assert motion.distance == pytest.approx(np.linalg.norm(AHEAD.position), abs=1e-8)
    assert (motion.seconds, motion.turned) == (0.5, pytest.approx(0.05, abs=1e-9))
    turned_frame = Pose(3.0, -7.0, 1.0, 0.4, 0.3, -2.0)
    moved = Motion.between(turned_frame @ ANYWHERE, turned_frame @ (ANYWHERE @ AHEAD), 0.5)
    same(moved.pose, AHEAD)
    both = Motion.between(ANYWHERE, ANYWHERE @ AHEAD, 0.5).then(
        Motion(AHEAD.inverse, float(np.linalg.norm(AHEAD.position)), 0.25, 0.05)
    )
    same(both.pose, Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert both.distance == pytest.approx(2.0 * np.linalg.norm(AHEAD.position))  # the way, not the distance
    assert (both.seconds, both.turned) == (0.75, pytest.approx(0.1))
    same(Motion.none().then(both).pose, both.pose)


def test_errors_that_stay_the_same_add_up_and_others_grow_with_way_time_and_turn():
    """A scale that is off by 2 % is off by 2 m after 100 m, in one motion or in many that are made one."""
    noise = MotionNoise(share=0.02, turn_share=0.0, heading_drift_deg=0.0, heading_walk_deg=0.0, walk=0.0)
    step = Motion(Pose(1.0, 0.0, 0.0, 0.0, 0.0, 0.0), 1.0, 0.1, 0.0)
    whole = Motion.none()
    for _ in range(100):
        whole = whole.then(step)
    assert math.sqrt(noise.covariance(whole)[0, 0]) == pytest.approx(2.0)
    noise = MotionNoise(share=0.01, turn_share=0.1, heading_drift_deg=1.0, heading_walk_deg=2.0, walk=0.3, tilt_deg=0.5)
    motion = Motion(Pose(8.0, 6.0, 0.0, 0.0, 0.0, 0.3), 12.0, 4.0, 0.4)
    heading = math.radians(4.0) ** 2 + 4.0 * math.radians(2.0) ** 2 + 0.04**2
    aside = 0.12**2 + heading * 144.0 / 3.0 + 0.09 * 4.0
    tilt = math.radians(0.5) ** 2
    wanted = np.diag([aside, aside, 0.12**2 + 0.09 * 4.0, tilt, tilt, heading])
    np.testing.assert_allclose(noise.covariance(motion), wanted, rtol=1e-12)
    assert not noise.covariance(Motion.none())[[0, 1, 2, 5], [0, 1, 2, 5]].any()


def drive(n, step, errors):
    """A vehicle at 5 m/s along x that steers a little, with errors of x and y, shape (n, 2), m."""
    times = step * np.arange(n)
    poses = [
        Pose(5.0 * t + dx, dy, 0.0, 0.0, 0.0, 0.1 * math.sin(0.2 * t))
        for t, (dx, dy) in zip(times, errors, strict=True)
    ]
    return Trajectory.from_poses(times, poses)


@pytest.mark.parametrize("step", [0.1, 0.5])
def test_a_prior_is_as_good_a_source_as_it_is_smooth(step):
    rng = np.random.default_rng(0)
    smooth = MotionNoise.of_prior(drive(200, step, np.zeros((200, 2))))
    assert smooth.walk == MotionNoise().walk
    walking = np.cumsum(0.3 * math.sqrt(step) * rng.standard_normal((200, 2)), axis=0)  # 0.3 m per root second
    assert MotionNoise.of_prior(drive(200, step, walking)).walk == pytest.approx(0.3, rel=0.15)
    jumping = MotionNoise.of_prior(drive(200, step, rng.uniform(-2.5, 2.5, (200, 2))))
    increment = Motion(Pose(5.0 * step, 0.0, 0.0, 0.0, 0.0, 0.0), 5.0 * step, step, 0.0)
    of_one_axis = 2.5 / math.sqrt(3.0) * math.sqrt(2.0)  # of a difference of two uniform errors
    assert math.sqrt(jumping.covariance(increment)[0, 0]) >= of_one_axis


def test_odometry_that_jumps_is_trusted_no_farther():
    """Jumps are told from braking and steering, however far apart poses are."""
    rng, share = np.random.default_rng(0), MotionNoise(share=0.005)
    for step in (0.01, 0.1, 1.0):
        braking = np.column_stack([3.0 * np.sin(step * np.arange(200)), np.zeros(200)])  # up to 3 m/s^2
        assert MotionNoise.of_odometry(drive(200, step, braking), 0.005) == share
    jumping = drive(200, 0.1, rng.normal(0.0, 0.3, (200, 2)))
    assert MotionNoise.of_odometry(jumping, 0.005) == replace(MotionNoise.of_prior(jumping), share=0.005)
    assert MotionNoise.of_odometry(jumping).walk > 1.0
    rarely = np.cumsum(2.0 * (rng.uniform(size=(200, 2)) < 0.02), axis=0)
    assert MotionNoise.of_odometry(drive(200, 0.1, rarely)) != MotionNoise()
    assert MotionNoise.of_odometry(drive(1, 0.1, np.zeros((1, 2)))) == MotionNoise()


def test_few_poses_have_the_usual_noise_and_standard_deviations_are_not_negative():
    assert MotionNoise.of_prior(drive(2, 0.1, np.zeros((2, 2)))) == MotionNoise()
    for name, value in (("share", -1.0), ("tilt_deg", math.nan)):
        with pytest.raises(OptionError, match=f"Expected `{name}` >= 0, got {value}"):
            MotionNoise(**{name: value})
    with pytest.raises(OptionError, match=r"Expected `sigmas` above 0, got 0\.0\. The default is 3\.0"):
        TrackingOptions(sigmas=0.0)


# --- the filter: derivatives by differences, and the update by information ---
def covariance_of(seed, scale=0.05):
    root = scale * np.random.default_rng(seed).standard_normal((6, 6))
    return root @ root.T + 1e-6 * np.eye(6)


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
    np.testing.assert_allclose(moved.pose.values, (pose @ motion.pose).values, atol=1e-12)
    np.testing.assert_array_equal(moved.planar_covariance, moved.covariance[[0, 1, 5]][:, [0, 1, 5]])
    assert moved.sigma == pytest.approx(math.sqrt(np.linalg.eigvalsh(moved.covariance[:2, :2])[1]))
    by_state = derivative(lambda v: (Pose(*v) @ motion.pose).values, pose.values)
    by_motion = derivative(lambda v: (pose @ Pose(*v)).values, motion.pose.values)
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
    measured = Pose(*(pose.values + 0.05 * rng.standard_normal(6)).tolist())
    infinite = np.diag(np.full(6, np.inf))
    infinite[np.ix_(known, known)] = noise[np.ix_(known, known)]
    adjusted = UncertainPose(pose, before).adjusted(measured, infinite)
    observed = np.eye(6)[known]
    information = observed.T @ np.linalg.inv(noise[np.ix_(known, known)])
    after = np.linalg.inv(np.linalg.inv(before) + information @ observed)
    innovation = measured.values - pose.values
    innovation[3:] = np.arctan2(np.sin(innovation[3:]), np.cos(innovation[3:]))
    wanted = pose.values + after @ information @ innovation[known]
    np.testing.assert_allclose(adjusted.covariance, after, atol=1e-7)
    change = adjusted.pose.values - wanted
    change[3:] = np.arctan2(np.sin(change[3:]), np.cos(change[3:]))
    np.testing.assert_allclose(change, 0.0, atol=1e-6)


def test_headings_are_averaged_across_the_seam():
    variances = np.diag(np.full(6, 0.01))
    before = UncertainPose(Pose(0.0, 0.0, 0.0, 0.0, 0.0, math.pi - 0.01), variances)
    after = before.adjusted(Pose(0.0, 0.0, 0.0, 0.0, 0.0, -math.pi + 0.03), variances)
    assert after.pose.heading == pytest.approx(-math.pi + 0.01)
