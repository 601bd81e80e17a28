"""Tracking over a drive from files: what each epoch is told, and where its motion comes from."""

import math

import numpy as np
import pytest
from court_drive import CELL, FRAME, N_SCANS, prior_of, truth

from maxcon import MaximumConsensus, Pose, SearchSpace, Status, Trajectory
from maxcon.drive.localize import DriveOptions, track_drive
from maxcon.drive.motion import MotionNoise
from maxcon.drive.tracker import Tracker
from maxcon.errors import TrajectoryError
from maxcon.io.scans import ScanFolder

TIMES = [10.0 + 0.2 * epoch for epoch in range(N_SCANS)]
METHOD = MaximumConsensus(SearchSpace(1.5, CELL, 1.0, 0.5))


@pytest.fixture(scope="module")
def scans(scan_paths):
    return ScanFolder(scan_paths, np.array(TIMES))


def prior(epochs=range(N_SCANS)):
    return prior_of([TIMES[epoch] for epoch in epochs], epochs, (0.5, -0.4, 0.0))


def odometry(epochs=range(10)):
    """The true motion with 1 % too much of it, seen from a frame of its own."""
    elsewhere = Pose(-3.0, 40.0, 2.0, 0.0, 0.0, 1.2)
    poses = [elsewhere @ truth(0).inverse @ truth(epoch) for epoch in epochs]
    scaled = [Pose(*(1.01 * pose.position).tolist(), pose.roll, pose.pitch, pose.heading) for pose in poses]
    return Trajectory.from_poses([TIMES[epoch] for epoch in epochs], scaled)


def errors(epochs):
    return [
        math.dist(epoch.pose_global.position, FRAME.pose_to_global(truth(epoch.epoch)).position)
        for epoch in epochs
        if epoch.pose_global is not None
    ]


@pytest.mark.parametrize("source", ["odometry", "prior"])
def test_a_drive_is_tracked(point_map, scans, source):
    told = odometry() if source == "odometry" else None
    epochs = list(track_drive(point_map, scans, prior(), Tracker(METHOD), told))
    statuses = [epoch.status for epoch in epochs]
    assert statuses[4] is Status.UNREADABLE and "000004.bin" in epochs[4].reason
    assert statuses[9] is Status.NO_POINTS
    assert [status for number, status in enumerate(statuses[2:9], 2) if number != 4] == [Status.LOCALIZED] * 6
    assert max(errors(epochs)) < 0.06 and all(epoch.milliseconds > 0.0 for epoch in epochs[:4])


def test_a_prior_is_needed_where_the_track_begins_and_not_before_nor_behind(point_map, scans):
    epochs = list(track_drive(point_map, scans, prior(range(3)), Tracker(METHOD), odometry()))
    assert [epoch.status for epoch in epochs[5:9]] == [Status.LOCALIZED] * 4
    assert max(errors(epochs)) < 0.06
    assert epochs[8].prior is not None  # where it was expected
    epochs = list(track_drive(point_map, scans, prior(range(2, 10)), Tracker(METHOD), odometry()))
    assert [epoch.status for epoch in epochs[:2]] == [Status.NO_PRIOR] * 2
    assert epochs[0].reason == "there is neither a track nor a prior to begin one"
    assert epochs[8].status is Status.LOCALIZED


def test_a_gap_in_the_source_of_the_motion_is_one_long_motion(point_map, scans):
    known = [0, 1, 2, 3, 7, 8]
    options = DriveOptions(max_gap=0.25)
    epochs = list(track_drive(point_map, scans, prior(), Tracker(METHOD), odometry(known), options))
    assert [epochs[number].status for number in (5, 6)] == [Status.NO_PRIOR] * 2
    assert epochs[5].reason == "the motion up to this scan is not known"
    assert [epochs[number].status for number in (7, 8)] == [Status.LOCALIZED] * 2
    assert max(errors(epochs)) < 0.06


def test_a_noisy_prior_is_a_poor_source_and_no_worse_than_none(point_map, scans):
    rng = np.random.default_rng(0)
    poses = [FRAME.pose_to_global(truth(epoch)).translated([*rng.uniform(-0.8, 0.8, 2), 0.0]) for epoch in range(10)]
    noisy = Trajectory.from_poses(TIMES, poses)
    epochs = list(track_drive(point_map, scans, noisy, Tracker(METHOD, MotionNoise.of_prior(noisy))))
    assert [epoch.status for epoch in epochs[5:9]] == [Status.LOCALIZED] * 4
    assert max(errors(epochs)) < 0.08


def test_a_place_outside_of_the_map_is_said(point_map, scans):
    far = [pose.translated([500.0, 0.0, 0.0]) for pose in prior().poses()]
    mixed = Trajectory.from_poses(TIMES, [*far[:5], *prior().poses()[5:]])
    epochs = list(track_drive(point_map, scans, mixed, Tracker(METHOD), odometry()))
    assert [epoch.status for epoch in epochs[:4]] == [Status.OUTSIDE_MAP] * 4
    assert epochs[8].status is Status.LOCALIZED


def test_odometry_of_another_clock_is_an_error(point_map, scans):
    late = Trajectory.from_poses(np.array(TIMES) + 1e6, odometry().poses())
    with pytest.raises(TrajectoryError, match=r"Expected poses of the odometry for the scans, 10\.000 to 11\.800 s"):
        track_drive(point_map, scans, prior(), Tracker(METHOD), late)
