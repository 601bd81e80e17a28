# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Localizing a drive: what each epoch is told, and POSES.csv."""

import csv
import math

import numpy as np
import pytest

from maxcon import Estimate, LocalFrame, PointMap, Pose, Scan, SearchSpace, Status, Trajectory
from maxcon.drive.localize import DriveOptions, EpochEstimate, localize_drive
from maxcon.drive.poses_table import COLUMNS, localized_trajectory, write_poses
from maxcon.errors import FileError, MapError, OptionError, TrajectoryError
from maxcon.io.scans import RawScan, open_scans
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


@pytest.mark.parametrize("n_threads", [2, 3, 8])
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


def test_by_default_points_from_1_to_120_m_are_kept_and_gaps_of_half_a_second_bridged():
    assert DriveOptions() == DriveOptions(min_range=1.0, max_range=120.0, max_gap=0.5)


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


# --- POSES.csv ----------------------------------------------------------------------------------------


def epoch_at(number, pose, status=Status.LOCALIZED, score=12.3456789):
    nothing = np.empty((0, 3))
    raw = RawScan(nothing, 1_700_000_000.123456789 + number, f"{number}.bin", 0, 0, 0)
    estimate = Estimate(truth(0), score, (0, 0, 0), status, np.eye(2)) if score is not None else None
    return EpochEstimate(number, raw, status, 61.234, Scan(nothing), truth(0), estimate, pose)


POSE = Pose(458_888.42171, 5_429_081.54139, 115.0739, 0.001, -0.002, -3.1)


def test_the_table_has_a_row_per_epoch_and_a_pose_where_localized(tmp_path):
    epochs = [epoch_at(0, POSE), epoch_at(1, None, Status.UNDETERMINED, 0.25), epoch_at(2, None, Status.NO_PRIOR, None)]
    write_poses(tmp_path / "poses.csv", epochs)
    with (tmp_path / "poses.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0])[: len(COLUMNS)] == COLUMNS
    assert [row["status"] for row in rows] == ["localized", "undetermined", "no prior"]
    assert float(rows[0]["time"]) == pytest.approx(1_700_000_000.1234567, abs=1e-6)
    got = [float(rows[0][name]) for name in ("x", "y", "z", "roll", "pitch", "heading")]
    np.testing.assert_allclose(got, [POSE.x, POSE.y, POSE.z, 0.001, -0.002, -3.1], rtol=0, atol=6e-5)
    assert (rows[0]["score"], rows[1]["score"], rows[2]["score"]) == ("12.3457", "0.25", "")
    assert rows[0]["ms"] == "61.23"
    for row in rows[1:]:
        assert [row[name] for name in ("x", "y", "z", "roll", "pitch", "heading")] == [""] * 6


def test_the_table_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "poses.csv"
    write_poses(path, [epoch_at(0, POSE)])
    before = path.read_bytes()
    with pytest.raises(AttributeError):
        write_poses(path, [epoch_at(0, POSE), None])
    assert path.read_bytes() == before
    with pytest.raises(FileError, match="able to write"):
        write_poses(tmp_path / "no" / "poses.csv", [])
    assert [name.name for name in tmp_path.iterdir()] == ["poses.csv"]


def test_the_trajectory_of_what_was_localized():
    assert localized_trajectory([]) is None
    assert localized_trajectory([epoch_at(0, None, Status.NO_MATCH)]) is None
    trajectory = localized_trajectory([epoch_at(0, POSE), epoch_at(1, None, Status.AT_RIM), epoch_at(2, POSE)])
    assert len(trajectory) == 2
    assert trajectory.times[1] - trajectory.times[0] == pytest.approx(2.0, abs=1e-6)
    pose = trajectory.pose(1)
    np.testing.assert_allclose(pose.position, POSE.position, atol=1e-9)
    assert math.cos(pose.heading - POSE.heading) == pytest.approx(1.0)
