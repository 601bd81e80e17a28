# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Localizing a drive: what each epoch is told."""

import math

import numpy as np
import pytest

from maxcon import Estimate, LocalFrame, PointMap, Pose, SearchSpace, Status, Trajectory
from maxcon.drive.localize import DriveOptions, localize_drive
from maxcon.errors import MapError, OptionError, TrajectoryError
from maxcon.io.scans import open_scans
from maxcon.localizer import MaximumConsensus

FRAME = LocalFrame((458_800.0, 5_429_000.0, 100.0))
CELL = 0.06
TIMES = [10.0, 10.1, 10.2, 10.3]


def court():
    """Four walls around (15, 15), facing inwards: points and normals, local frame."""
    at, z = np.meshgrid(np.arange(5, 25.1, 0.05), np.arange(0.0, 5.0, 0.05))
    at, z = at.ravel(), z.ravel()
    points, normals = [], []
    for axis, place, towards in ((0, 5.03, 1.0), (0, 25.03, -1.0), (1, 5.03, 1.0), (1, 25.03, -1.0)):
        wall = np.column_stack([at, at, z])
        wall[:, axis] = place
        normal = np.zeros(3)
        normal[axis] = towards
        points.append(wall)
        normals.append(np.tile(normal, (len(wall), 1)))
    return np.concatenate(points), np.concatenate(normals)


@pytest.fixture(scope="module")
def point_map():
    return PointMap.from_points(*court(), CELL, frame=FRAME)


def scan_of_court(pose):
    """What a scanner of 16 rings sees of the court, sensor frame."""
    elevations, azimuths = np.meshgrid(np.radians(np.arange(-7, 9)), np.radians(np.arange(0.0, 360.0, 0.4)))
    level = np.cos(elevations)
    beams = np.stack([level * np.cos(azimuths), level * np.sin(azimuths), np.sin(elevations)], -1).reshape(-1, 3)
    in_map = beams @ pose.rotation.T
    walls = np.where(in_map[:, :2] > 0.0, 25.03, 5.03)
    return beams * ((walls - pose.position[:2]) / in_map[:, :2]).min(axis=1)[:, None]


def truth(epoch):
    return Pose(14.0 + epoch * 0.5, 15.0, 1.5, 0.01, -0.01, 0.2 + 0.1 * epoch)


@pytest.fixture(scope="module")
def scan_folder(tmp_path_factory):
    """Four scans of the court in KITTI's format, the last of them empty within the range limits."""
    folder = tmp_path_factory.mktemp("scans")
    for epoch in range(len(TIMES)):
        sensor = scan_of_court(truth(epoch)) * (0.001 if epoch == 3 else 1.0)
        np.column_stack([sensor, np.zeros(len(sensor))]).astype("<f4").tofile(folder / f"{epoch:06d}.bin")
    (folder / "times.txt").write_text("\n".join(map(str, TIMES)) + "\n")
    return open_scans(folder)


def prior_trajectory(times=TIMES, shift=(0.0, 0.0, 0.0)):
    poses = [truth(epoch) for epoch in range(len(times))]
    moved = [pose.translated(np.array(FRAME.origin) + [0.6, -0.42, 0.0] + shift) for pose in poses]
    return Trajectory.from_poses(times, moved)


class SaysWhere:
    """A method that answers the prior, and remembers what it was asked."""

    def __init__(self, status=Status.LOCALIZED):
        self.status, self.asked = status, []

    def localize(self, scan, point_map, prior):
        self.asked.append((scan, prior))
        return Estimate(prior, 1.5, (0, 0, 0), self.status, np.eye(2))


def test_a_drive_is_localized_to_the_cell(point_map, scan_folder):
    method = MaximumConsensus(SearchSpace(0.9, CELL, 0.5, 0.5))
    epochs = list(localize_drive(point_map, scan_folder, prior_trajectory(), method))
    assert [epoch.status for epoch in epochs] == [Status.LOCALIZED] * 3 + [Status.NO_POINTS]
    for epoch in epochs[:3]:
        wanted = FRAME.pose_to_global(truth(epoch.epoch))
        np.testing.assert_allclose(epoch.pose_global.position, wanted.position, atol=0.07)
        assert epoch.pose_global.heading == pytest.approx(wanted.heading, abs=1e-6)
        assert epoch.milliseconds > 0.0
        assert len(epoch.scan) == len(epoch.raw.points) > 100
    assert epochs[3].pose_global is None
    assert epochs[3].estimate is None


@pytest.mark.parametrize("n_threads", [2, 8])
def test_several_epochs_at_once_have_the_same_answers_in_the_same_order(point_map, scan_folder, n_threads):
    method = MaximumConsensus(SearchSpace(0.9, CELL, 0.5, 0.5))
    alone, together = (
        [
            (each.epoch, each.raw.time, each.status, each.pose_global, getattr(each.estimate, "score", None))
            for each in localize_drive(point_map, scan_folder, prior_trajectory(), method, n_threads=n)
        ]
        for n in (1, n_threads)
    )
    assert together == alone


def test_no_more_epochs_are_begun_than_there_are_threads_and_one(point_map, scan_folder):
    method = SaysWhere()
    running = localize_drive(point_map, scan_folder, prior_trajectory(), method, n_threads=2)
    assert next(running).epoch == 0
    running.close()
    assert 1 <= len(method.asked) <= 3


def test_an_error_in_one_of_several_epochs_is_raised(point_map, scan_folder):
    class Fails(SaysWhere):
        def localize(self, scan, point_map, prior):
            if scan.time == TIMES[1]:
                raise MapError("a tile cannot be read")
            return super().localize(scan, point_map, prior)

    running = localize_drive(point_map, scan_folder, prior_trajectory(), Fails(), n_threads=2)
    assert next(running).epoch == 0
    with pytest.raises(MapError, match="a tile cannot be read"):
        next(running)


def test_less_than_one_thread_is_refused(point_map, scan_folder):
    with pytest.raises(OptionError, match=r"`n_threads` >= 1, got 0"):
        localize_drive(point_map, scan_folder, prior_trajectory(), SaysWhere(), n_threads=0)


def test_epochs_come_one_at_a_time_with_local_priors(point_map, scan_folder):
    method = SaysWhere()
    running = localize_drive(point_map, scan_folder, prior_trajectory(), method)
    first = next(running)
    assert len(method.asked) == 1  # nothing is read ahead
    assert (first.epoch, first.raw.time, first.scan.time) == (0, 10.0, 10.0)
    _, prior = method.asked[0]
    np.testing.assert_allclose(prior.position, truth(0).position + [0.6, -0.42, 0.0], atol=1e-8)
    np.testing.assert_allclose(first.pose_global.position, prior.position + FRAME.origin, atol=1e-8)


def test_an_epoch_without_prior_or_outside_the_map_gets_a_status(point_map, scan_folder):
    method = SaysWhere()
    early = Trajectory.from_poses(TIMES[:2], [prior_trajectory().pose(0), prior_trajectory().pose(1)])
    statuses = [epoch.status for epoch in localize_drive(point_map, scan_folder, early, method)]
    assert statuses == [Status.LOCALIZED] * 2 + [Status.NO_PRIOR] * 2
    poses = prior_trajectory().poses()
    poses[1] = poses[1].translated([500.0, 0.0, 0.0])
    leaving = list(localize_drive(point_map, scan_folder, Trajectory.from_poses(TIMES, poses), method))
    assert [epoch.status for epoch in leaving][:3] == [Status.LOCALIZED, Status.OUTSIDE_MAP, Status.LOCALIZED]
    assert leaving[1].prior is not None
    assert leaving[1].pose_global is None


def test_a_pose_that_may_not_be_used_is_not_given_out(point_map, scan_folder):
    for status in (Status.UNDETERMINED, Status.AT_RIM, Status.NO_MATCH):
        epoch = next(localize_drive(point_map, scan_folder, prior_trajectory(), SaysWhere(status)))
        assert (epoch.status, epoch.pose_global) == (status, None)
        assert epoch.estimate.status is status


def test_points_out_of_range_are_left_out(point_map, scan_folder):
    method = SaysWhere()
    options = DriveOptions(min_range=5.0, max_range=12.0)
    epoch = next(localize_drive(point_map, scan_folder, prior_trajectory(), method, options))
    ranges = np.linalg.norm(method.asked[0][0].points, axis=1)
    assert ranges.min() >= 5.0
    assert ranges.max() <= 12.0
    assert epoch.raw.n_dropped_range > 0


@pytest.mark.parametrize(("nearest", "farthest"), [(5.0, 5.0), (6.0, 5.0), (-1.0, 5.0), (math.nan, 5.0)])
def test_ranges_that_leave_nothing_are_refused_before_a_drive(nearest, farthest):
    with pytest.raises(OptionError, match="0 <= min_range < max_range"):
        DriveOptions(nearest, farthest)


def test_a_gap_in_the_prior_is_not_bridged_unless_allowed(point_map, scan_folder):
    poses = prior_trajectory().poses()
    sparse = Trajectory.from_poses([9.0, 11.0], [poses[0], poses[3]])
    with pytest.raises(TrajectoryError, match=r"10\.000 to 10\.300 s, but the prior trajectory has none near"):
        list(localize_drive(point_map, scan_folder, sparse, SaysWhere()))
    epochs = list(localize_drive(point_map, scan_folder, sparse, SaysWhere(), DriveOptions(max_gap=3.0)))
    assert epochs[0].status is Status.LOCALIZED


def test_a_prior_of_another_clock_or_place_is_an_error(point_map, scan_folder):
    late = prior_trajectory([time + 1e6 for time in TIMES])
    with pytest.raises(TrajectoryError, match=r"\(1000010\.000 to 1000010\.300 s\)\. Do both use the same clock\?"):
        next(localize_drive(point_map, scan_folder, late, SaysWhere()))
    elsewhere = prior_trajectory(shift=(0.0, -5_400_000.0, 0.0))
    with pytest.raises(MapError, match=r"the prior inside the map, x 458800 to .*, y 29014.* Are both in the same CRS"):
        next(localize_drive(point_map, scan_folder, elsewhere, SaysWhere()))


def test_epochs_without_points_are_light(point_map, scan_folder):
    epoch = next(localize_drive(point_map, scan_folder, prior_trajectory(), SaysWhere()))
    light = epoch.without_points()
    assert (len(light.scan), len(light.raw.points)) == (0, 0)
    assert (light.raw.n_returns, light.pose_global, light.scan.time) == (epoch.raw.n_returns, epoch.pose_global, 10.0)
    assert len(epoch.scan) > 0


def test_a_prior_of_a_senseless_number_is_one_epoch_with_a_status(point_map, scan_folder):
    """The drive goes on, and begun anew with threads it says the same."""
    poses = prior_trajectory().poses()
    poses[1] = poses[1].translated([0.0, 0.0, 1e9])
    poses[2] = poses[2].translated([1e300, 0.0, 0.0])
    senseless = Trajectory.from_poses(TIMES, poses)
    method = MaximumConsensus(SearchSpace(0.9, CELL, 0.5, 0.5))
    for n_threads in (1, 2):
        epochs = list(localize_drive(point_map, scan_folder, senseless, method, n_threads=n_threads))
        wanted = [Status.LOCALIZED, Status.FAILED, Status.OUTSIDE_MAP, Status.NO_POINTS]
        assert [epoch.status for epoch in epochs] == wanted
        assert "Expected points within" in epochs[1].reason and epochs[1].pose_global is None
