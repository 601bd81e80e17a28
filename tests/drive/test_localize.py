"""Localizing a drive: what each epoch is told."""

import math

import numpy as np
import pytest
from court_drive import CELL, FRAME, prior_of, truth

from maxcon import Estimate, SearchSpace, Status, Trajectory
from maxcon.drive.localize import DriveOptions, _clocks_in_words, localize_drive
from maxcon.errors import MapError, OptionError, TrajectoryError
from maxcon.io.scans import ScanFolder
from maxcon.localizer import MaximumConsensus

TIMES = [10.0, 10.1, 10.2, 10.3]
METHOD = MaximumConsensus(SearchSpace(0.9, CELL, 0.5, 0.5))


@pytest.fixture(scope="module")
def scan_folder(scan_paths):
    """Four scans, the last of them empty within the range limits."""
    return ScanFolder([*scan_paths[:3], scan_paths[-1]], np.array(TIMES))


class SaysWhere:
    """A method that answers the prior, and remembers what it was asked."""

    def __init__(self, status=Status.LOCALIZED):
        self.status, self.asked = status, []

    def localize(self, scan, point_map, prior):
        self.asked.append((scan, prior))
        return Estimate(prior, 1.5, (0, 0, 0), self.status, np.eye(2))


def test_a_drive_is_localized_to_the_cell(point_map, scan_folder):
    epochs = list(localize_drive(point_map, scan_folder, prior_of(TIMES), METHOD))
    assert [epoch.status for epoch in epochs] == [Status.LOCALIZED] * 3 + [Status.NO_POINTS]
    for epoch in epochs[:3]:
        wanted = FRAME.pose_to_global(truth(epoch.epoch))
        np.testing.assert_allclose(epoch.pose_global.position, wanted.position, atol=0.07)
        assert epoch.pose_global.heading == pytest.approx(wanted.heading, abs=1e-4)
        assert epoch.milliseconds > 0.0 and len(epoch.scan) == len(epoch.raw.points) > 100
    assert epochs[3].pose_global is None and epochs[3].estimate is None


@pytest.mark.parametrize("n_threads", [2, 8])
def test_several_epochs_at_once_have_the_same_answers_in_the_same_order(point_map, scan_folder, n_threads):
    alone, together = (
        [
            (each.epoch, each.raw.time, each.status, each.pose_global, getattr(each.estimate, "score", None))
            for each in localize_drive(point_map, scan_folder, prior_of(TIMES), METHOD, n_threads=n)
        ]
        for n in (1, n_threads)
    )
    assert together == alone


def test_an_error_in_one_of_several_epochs_is_raised_and_no_thread_refused(point_map, scan_folder):
    class Fails(SaysWhere):
        def localize(self, scan, point_map, prior):
            if scan.time == TIMES[1]:
                raise MapError("a tile cannot be read")
            return super().localize(scan, point_map, prior)

    method = Fails()
    running = localize_drive(point_map, scan_folder, prior_of(TIMES), method, n_threads=2)
    assert next(running).epoch == 0
    assert 0 <= len(method.asked) <= 3  # no more are begun than there are threads, and one
    with pytest.raises(MapError, match="a tile cannot be read"):
        next(running)
    with pytest.raises(OptionError, match=r"`n_threads` >= 1, got 0"):
        localize_drive(point_map, scan_folder, prior_of(TIMES), SaysWhere(), n_threads=0)


def test_epochs_come_one_at_a_time_with_local_priors(point_map, scan_folder):
    method = SaysWhere()
    running = localize_drive(point_map, scan_folder, prior_of(TIMES), method)
    first = next(running)
    assert len(method.asked) == 1  # nothing is read ahead
    assert (first.epoch, first.raw.time, first.scan.time) == (0, 10.0, 10.0)
    _, prior = method.asked[0]
    np.testing.assert_allclose(prior.position, truth(0).position + [0.6, -0.42, 0.0], atol=1e-8)
    np.testing.assert_allclose(first.pose_global.position, prior.position + FRAME.origin, atol=1e-8)
    assert repr(first).startswith("EpochEstimate(0, localized, Pose(x=") and len(repr(first)) < 250
    assert repr(first.raw) == f"RawScan(000000.bin, {len(first.raw.points)} points, time=10.0)"
    light = first.without_points()
    assert (len(light.scan), len(light.raw.points)) == (0, 0) < (len(first.scan), 0)
    assert (light.raw.n_returns, light.pose_global, light.scan.time) == (first.raw.n_returns, first.pose_global, 10.0)


def test_an_epoch_without_prior_or_outside_the_map_gets_a_status(point_map, scan_folder):
    method = SaysWhere()
    early = Trajectory.from_poses(TIMES[:2], [prior_of(TIMES).pose(0), prior_of(TIMES).pose(1)])
    statuses = [epoch.status for epoch in localize_drive(point_map, scan_folder, early, method)]
    assert statuses == [Status.LOCALIZED] * 2 + [Status.NO_PRIOR] * 2
    poses = prior_of(TIMES).poses()
    poses[1] = poses[1].translated([500.0, 0.0, 0.0])
    leaving = list(localize_drive(point_map, scan_folder, Trajectory.from_poses(TIMES, poses), method))
    assert [epoch.status for epoch in leaving][:3] == [Status.LOCALIZED, Status.OUTSIDE_MAP, Status.LOCALIZED]
    assert leaving[1].prior is not None and leaving[1].pose_global is None


def test_points_out_of_range_are_left_out(point_map, scan_folder):
    method = SaysWhere()
    options = DriveOptions(min_range=5.0, max_range=12.0)
    epoch = next(localize_drive(point_map, scan_folder, prior_of(TIMES), method, options))
    ranges = np.linalg.norm(method.asked[0][0].points, axis=1)
    assert ranges.min() >= 5.0 and ranges.max() <= 12.0
    assert epoch.raw.n_dropped_range > 0
    for nearest, farthest in ((5.0, 5.0), (6.0, 5.0), (-1.0, 5.0), (math.nan, 5.0)):
        with pytest.raises(OptionError, match="0 <= min_range < max_range"):
            DriveOptions(nearest, farthest)


def test_a_gap_in_the_prior_is_not_bridged_and_another_clock_or_place_is_an_error(point_map, scan_folder):
    poses = prior_of(TIMES).poses()
    sparse = Trajectory.from_poses([9.0, 11.0], [poses[0], poses[3]])
    with pytest.raises(TrajectoryError, match=r"10\.000 to 10\.300 s, but the prior trajectory has none near"):
        list(localize_drive(point_map, scan_folder, sparse, SaysWhere()))
    epochs = list(localize_drive(point_map, scan_folder, sparse, SaysWhere(), DriveOptions(max_gap=3.0)))
    assert epochs[0].status is Status.LOCALIZED
    late = prior_of([time + 1e6 for time in TIMES])
    with pytest.raises(TrajectoryError, match=r"\(1000010\.000 to 1000010\.300 s\)\. Do both use the same clock\?"):
        next(localize_drive(point_map, scan_folder, late, SaysWhere()))
    elsewhere = prior_of(TIMES, off=(0.0, -5_400_000.0, 0.0))
    with pytest.raises(MapError, match=r"the prior inside the map, x 458800 to .*, y 29015.* Are both in the same CRS"):
        next(localize_drive(point_map, scan_folder, elsewhere, SaysWhere()))


def test_a_prior_of_a_senseless_number_is_one_epoch_with_a_status(point_map, scan_folder):
    """The drive goes on, and begun anew with threads it says the same."""
    poses = prior_of(TIMES).poses()
    poses[1] = poses[1].translated([0.0, 0.0, 1e9])
    poses[2] = poses[2].translated([1e300, 0.0, 0.0])
    senseless = Trajectory.from_poses(TIMES, poses)
    for n_threads in (1, 2):
        epochs = list(localize_drive(point_map, scan_folder, senseless, METHOD, n_threads=n_threads))
        wanted = [Status.LOCALIZED, Status.FAILED, Status.OUTSIDE_MAP, Status.NO_POINTS]
        assert [epoch.status for epoch in epochs] == wanted
        assert "Expected points within" in epochs[1].reason and epochs[1].pose_global is None


@pytest.mark.parametrize(("other", "words"), [
    (1e6 + 3600.5, "+3600.500 s apart, about +1 h: a time zone. "),
    (1e6 + 18.0, "+18.000 s apart. "),
    (1e9, "the trajectory's times were in ms"),
    (1e3, "the scans' times were in ms"),
])  # fmt: skip
def test_clocks_that_differ_are_told_how(other, words):
    assert words in _clocks_in_words(1e6, other)
