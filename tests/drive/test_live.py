"""Scans as they come: the answers of a recorded drive, whatever comes late, twice or never; lost, and found again."""

import math
import time
from unittest.mock import Mock

import numpy as np
import pytest
from court_drive import CELL, COURT, FRAME, N_SCANS, prior_of, seen, truth, walls

import written_maps
from maxcon import LiveLocalizer, LiveOptions, MaximumConsensus, PointMap, Pose, SearchSpace, Status, Trajectory
from maxcon.cli.live import Waiting
from maxcon.drive.localize import track_drive
from maxcon.drive.motion import Motion
from maxcon.drive.tracker import Tracker
from maxcon.errors import ArrayError, MapError, OptionError
from maxcon.io.point_records import CloudPoints, PointTimes
from maxcon.io.raw_scan import DeskewedScans, Scans, scan_within
from towns import Town

TIMES = [10.0 + 0.2 * epoch for epoch in range(N_SCANS)]
METHOD = MaximumConsensus(SearchSpace(1.5, CELL, 1.0, 0.5))
ELSEWHERE = Pose(-3.0, 40.0, 2.0, 0.0, 0.0, 1.2)
HERE, THERE = (-12.0, 12.0, 0.4), (18.0, -9.0, 2.0)


class Court(Scans):
    """Scans of the court whose points have times."""

    def __init__(self):
        self.times = np.array(TIMES)

    def name(self, i):
        return f"{i}"

    def points(self, i):
        return seen(*walls(COURT), truth(i), seed=i)[0], np.linspace(-0.05, 0.04, 4000)

    def read(self, i, min_range=1.0, max_range=120.0):
        points, offsets = self.points(i)
        cloud = CloudPoints(points, PointTimes(offsets, "", ""), None, len(points), 0, 0)
        return scan_within(cloud, TIMES[i], TIMES[i], self.name(i), min_range, max_range)


SCANS = Court()
PRIOR = prior_of(TIMES)
ODOMETRY = Trajectory.from_poses(
    [time + shift for time in TIMES for shift in (0.0, 0.1)],
    [ELSEWHERE @ truth(0).inverse @ truth(epoch + part) for epoch in range(N_SCANS) for part in (0.0, 0.5)],
)


@pytest.fixture
def live(point_map):
    return LiveLocalizer(point_map, METHOD, options=LiveOptions(queue=3))


def give(live, epoch, now, *, has_times=False):
    points, offsets = SCANS.points(epoch)
    live.add_scan(TIMES[epoch], points, offsets if has_times else None, now=now)


def give_odometry(live, epochs):
    for row in [row for epoch in epochs for row in (2 * epoch, 2 * epoch + 1)]:
        live.add_odometry(float(ODOMETRY.times[row]), ODOMETRY.pose(row))


def give_priors(live, epochs):
    for epoch in epochs:
        live.add_prior(TIMES[epoch], PRIOR.pose(epoch))


def assert_same(answers, epochs):
    assert [answer.epoch.status for answer in answers] == [epoch.status for epoch in epochs]
    assert [answer.epoch.reason for answer in answers] == [epoch.reason for epoch in epochs]
    for answer, epoch in zip(answers, epochs, strict=True):
        assert answer.epoch.estimate.pose.values == pytest.approx(epoch.estimate.pose.values, abs=1e-9)
        assert answer.epoch.estimate.covariance == pytest.approx(epoch.estimate.covariance, rel=1e-6)


@pytest.mark.parametrize("source", ["odometry", "prior", "deskewed"])
def test_what_comes_in_order_is_answered_as_a_recorded_drive(live, point_map, source):
    odometry = None if source == "prior" else ODOMETRY
    scans = DeskewedScans(SCANS, ODOMETRY) if source == "deskewed" else SCANS
    expected = list(track_drive(point_map, scans, PRIOR, Tracker(METHOD), odometry))
    answers = []
    for epoch in range(N_SCANS):
        give_priors(live, [epoch])
        if odometry is not None:
            give_odometry(live, [epoch])
        give(live, epoch, TIMES[epoch], has_times=source == "deskewed")
        answers += live.answers(TIMES[epoch])
    assert_same(answers, expected)
    assert [answer.epoch.status for answer in answers[2:]] == [Status.LOCALIZED] * (N_SCANS - 2)
    for epoch, answer in enumerate(answers[2:], 2):
        pose = answer.epoch.estimate.pose
        assert answer.epoch.pose_global == FRAME.pose_to_global(pose)
        if odometry is None:
            assert answer.T_map_odom is None
        else:
            corrected = answer.T_map_odom @ ODOMETRY.pose(2 * epoch)
            assert corrected.values == pytest.approx(pose.values, abs=1e-9)


def test_within_the_delay_the_order_of_messages_does_not_matter(live, point_map):
    expected = list(track_drive(point_map, SCANS, PRIOR, Tracker(METHOD), ODOMETRY))
    give_priors(live, range(N_SCANS)[::-1])
    give_odometry(live, [0])
    answers = []
    for first in range(0, N_SCANS, 2):
        now = TIMES[first]
        if first:
            give(live, first + 1, now)
            assert list(live.answers(now + 0.01)) == []  # the odometry is not there
            give_odometry(live, [first + 1, first])
            assert list(live.answers(now + 0.02)) == []  # nor is the scan before
            give(live, first, now + 0.03)
        else:
            give(live, 0, now)
            give_odometry(live, [1])
            give(live, 1, now)
        answers += live.answers(now + 0.03)
    assert_same(answers, expected)
    assert answers[-1].counts == (N_SCANS, 0, 0, 0)


def test_a_rehearsal_localizes_a_scan_of_the_map_and_leaves_no_trace(point_map, monkeypatch):
    tried, localize = [], MaximumConsensus.localize
    monkeypatch.setattr(MaximumConsensus, "localize", lambda *given: tried.append(localize(*given)) or tried[-1])
    live = LiveLocalizer(point_map, METHOD)
    live.rehearse()
    assert any(estimate.is_localized for estimate in tried)
    assert live.answer() is None
    LiveLocalizer(PointMap.from_points(np.empty((0, 3)), np.empty((0, 3)), CELL), METHOD).rehearse()
    assert len(tried) == 2


def test_the_command_waits_as_long_as_the_library():
    waiting = Waiting()
    assert LiveOptions(waiting.delay, waiting.queue, waiting.patience) == LiveOptions()


def test_what_never_comes_is_waited_for_no_longer_than_the_delay(live):
    give_priors(live, range(N_SCANS))
    give_odometry(live, range(5))
    for epoch in (0, 1, 2):
        give(live, epoch, 0.0)
    assert len(list(live.answers(0.0))) == 3
    give(live, 4, 1.0)
    assert list(live.answers(1.02)) == []
    (answer,) = live.answers(1.04)
    assert answer.epoch.status is Status.LOCALIZED
    give(live, 5, 2.0)  # odometry ends 0.1 s before: it goes on as before
    (answer,) = live.answers(2.06)
    assert answer.epoch.status is Status.LOCALIZED
    assert answer.epoch.estimate.pose.values == pytest.approx(truth(5).values, abs=0.05)
    give(live, 7, 3.0)
    (answer,) = live.answers(3.06)
    assert (answer.epoch.status, answer.epoch.reason) == (Status.NO_PRIOR, "the motion up to this scan is not known")


def test_scans_that_come_late_twice_or_too_fast_are_counted(live):
    give_priors(live, range(N_SCANS))
    for epoch in (1, 1, 2):
        give(live, epoch, 0.0)
    assert len(list(live.answers(0.0))) == 2
    give(live, 0, 0.0)
    give(live, 2, 0.0)
    assert list(live.answers(0.1)) == []
    for epoch in (3, 4, 5, 6, 8):
        give(live, epoch, 0.0)
    answers = list(live.answers(0.1))
    assert [answer.epoch.raw.time for answer in answers] == [TIMES[epoch] for epoch in (5, 6, 8)]
    assert answers[-1].counts == (5, 2, 1, 2)


def test_a_clock_that_jumps_back_begins_anew(live):
    give_odometry(live, range(6))
    give_priors(live, range(6))
    for epoch in range(3):
        give(live, epoch, 0.0)
    assert list(live.answers(0.0))[-1].T_map_odom is not None
    live.add_scan(TIMES[0] - 3600.0, SCANS.points(0)[0], now=1.0)
    (answer,) = live.answers(1.1)
    assert (answer.epoch.status, answer.T_map_odom) == (Status.NO_PRIOR, None)


def test_a_map_without_ground_is_not_searched_without_a_prior(point_map):
    live = LiveLocalizer(point_map, METHOD, options=LiveOptions(patience=2))
    give(live, 0, 0.0)
    (answer,) = live.answers(0.1)
    assert answer.epoch.status is Status.LOST
    assert answer.epoch.reason.endswith("the map has no ground, to search it without a prior")


def test_a_prior_that_comes_seldom_is_moved_on_by_the_odometry(live):
    give_odometry(live, range(N_SCANS))
    give_priors(live, [0])
    for epoch in range(N_SCANS):
        give(live, epoch, TIMES[epoch])
        (answer,) = live.answers(TIMES[epoch] + 0.1)
    moved = ELSEWHERE @ truth(0).inverse
    expected = FRAME.pose_to_local(PRIOR.pose(0)) @ ((moved @ truth(0)).inverse @ (moved @ truth(N_SCANS - 1)))
    assert answer.epoch.prior.values == pytest.approx(expected.values, abs=1e-9)


def test_where_the_odometry_has_ended_priors_tell_the_motion(live, monkeypatch):
    monkeypatch.setattr("maxcon.drive.live.LONGEST_AGE", 0.5)
    give_odometry(live, [0, 1])
    give_priors(live, range(N_SCANS))
    for epoch in range(N_SCANS):
        give(live, epoch, 0.0)
        (answer,) = live.answers(0.1)
    assert answer.epoch.status is Status.LOCALIZED


def test_a_tile_that_cannot_be_read_is_a_scan_without_an_answer(live, monkeypatch):
    monkeypatch.setattr(Tracker, "localize", Mock(side_effect=MapError("tile 3 is broken")))
    give_priors(live, [0])
    give(live, 0, 0.0)
    (answer,) = live.answers(0.1)
    assert answer.epoch.status is Status.UNREADABLE
    assert answer.epoch.reason.startswith("tile 3 is broken")


def test_messages_that_make_no_sense_are_refused(live):
    with pytest.raises(ArrayError, match=r"a time for each of 3 points or none, got shape \(2,\)"):
        live.add_scan(1.0, np.ones((3, 3)), np.ones(2))
    for what, refused in (
        ("scan", lambda: live.add_scan(math.nan, np.ones((3, 3)))),
        ("scan", lambda: live.add_scan(1.0, np.ones((3, 3)), [0.0, math.nan, 0.0])),
        ("odometry", lambda: live.add_odometry(TIMES[0], Pose(1e154, 0.0, 0.0, 0.0, 0.0, 0.0))),
        ("prior", lambda: live.add_prior(math.nan, truth(0))),
        ("position", lambda: live.add_position(TIMES[0], 0.0, 0.0, math.nan)),
    ):
        with pytest.raises(ArrayError, match=f"Expected (a )?{what} with numbers up to 1e\\+12"):
            refused()
    with pytest.raises(OptionError, match=r"Expected a delay of 0 to 10 s, a queue and a patience of 1 or more"):
        LiveOptions(delay=-1.0)


@pytest.mark.parametrize(("in_time", "at_first"), [(math.inf, 0), (-1.0, 2)])
def test_a_thread_answers_what_comes_and_at_first_drops_what_is_late(live, monkeypatch, in_time, at_first):
    """Each scan is given when the one before has an answer, or is dropped as one of the first."""
    monkeypatch.setattr("maxcon.drive.live.IN_TIME", in_time)
    monkeypatch.setattr("maxcon.drive.live.LONGEST_WAIT", math.inf)
    monkeypatch.setattr("maxcon.drive.live.MOST_REHEARSALS", at_first)
    told = []
    give_priors(live, range(3))
    with live.working(told.append):
        for epoch in range(3):
            give(live, epoch, None)
            deadline = time.monotonic() + 60.0
            while sum(live._inbox.counts[:2]) <= epoch + (len(told) < epoch + 1 - at_first):
                assert time.monotonic() < deadline
                time.sleep(0.01)
    assert [answer.epoch.raw.time for answer in told] == TIMES[at_first:3]
    assert told[-1].counts[:2] == (3 - at_first, at_first)


def test_what_has_waited_for_long_is_dropped(live):
    for epoch, came in enumerate((0.0, 1.0, 2.0)):
        give(live, epoch, came)
    live._inbox.drop_before(1.5)
    assert [answer.epoch.raw.time for answer in live.answers(9.0)] == TIMES[2:3]
    assert live._inbox.counts[:2] == (1, 2)


def test_the_thread_ends_though_scans_keep_coming(live, monkeypatch):
    monkeypatch.setattr("maxcon.drive.live.LONGEST_WAIT", math.inf)
    monkeypatch.setattr("maxcon.drive.live.IN_TIME", math.inf)

    def tell(answer):
        live.add_scan(answer.epoch.raw.time + 0.1, np.empty((0, 3)), now=-1.0)

    with live.working(tell):
        live.add_scan(0.0, np.empty((0, 3)), now=-1.0)
        while live._inbox.counts.n_answered < 3:
            time.sleep(0.01)


def test_answers_in_a_map_that_was_loaded_ahead_load_no_tile(town, tmp_path):
    written_maps.write(tmp_path / "town.map", town.map, origin=town.map.frame.origin)
    n_tiles = {}
    for is_ahead in (False, True):
        live = LiveLocalizer(PointMap.open(tmp_path / "town.map"), options=LiveOptions(queue=3))
        for number in range(3):
            pose = town.pose(-12.0, 12.0 + 0.3 * number, 0.4)
            live.add_prior(0.1 * number, pose)
            live.add_scan(0.1 * number, town.scan(pose, number).points, now=0.0)
        if is_ahead:
            for place in live._places():
                live._load_around(*place, 150.0)
        answers = list(live.answers(1.0))
        assert answers[-1].epoch.status is Status.LOCALIZED
        assert [answer.effort.half_width > 1.0 for answer in answers] == [True, False, False]
        n_tiles[is_ahead] = [answer.effort.n_tiles for answer in answers]
    assert n_tiles[True] == [0] * 3 and n_tiles[False][0] > 4


# --- lost, and found again ---
@pytest.fixture(scope="module")
def town():
    return Town(11)


class Walk:
    """A walk through the town, 0.3 m and 0.1 s a step, straight on by the odometry wherever it is carried to."""

    def __init__(self, town):
        self.town, self.step = town, 0
        self.live = LiveLocalizer(town.map, options=LiveOptions(patience=3))

    def go(self, start, steps, *, position=None):
        """Answers of scans on the way from a pose (x, y, heading); all that are localized are right.

        position: of a receiver, off by so much, m.
        """
        answers = []
        for k in range(steps):
            at, self.step = 0.1 * self.step, self.step + 1
            pose = self.town.pose(*start) @ Pose(0.3 * k, 0.0, 0.0, 0.0, 0.0, 0.0)
            self.live.add_odometry(at, Pose(0.3 * self.step, 0.0, 0.0, 0.0, 0.0, 0.0))
            if position is not None:
                self.live.add_position(at, pose.x + position[0], pose.y + position[1], 0.5)
            self.live.add_scan(at, self.town.scan(pose, self.step).points, now=0.0)
            answers += self.live.answers(0.0)
            if answers[-1].epoch.pose_global is not None:
                assert answers[-1].epoch.pose_global.values == pytest.approx(pose.values, abs=0.1)
        return [answer.epoch.status is Status.LOCALIZED for answer in answers], answers

    def on(self, town, steps):
        """Where it is so many steps after HERE."""
        pose = town.pose(*HERE) @ Pose(0.3 * steps, 0.0, 0.0, 0.0, 0.0, 0.0)
        return pose.x, pose.y, pose.heading


def test_it_starts_lost_is_carried_away_and_found_again(town):
    walk = Walk(town)
    is_localized, first = walk.go(HERE, 6)
    assert [answer.epoch.reason.startswith("found in the whole map") for answer in first[:2]] == [False, True]
    assert is_localized[-2:] == [True] * 2
    is_localized, away = walk.go(THERE, 7)
    assert is_localized[0] is False and is_localized[-2:] == [True] * 2
    assert any(answer.epoch.reason.startswith("found in the whole map") for answer in away)
    assert math.dist(away[-1].T_map_odom.position, first[-1].T_map_odom.position) > 10.0


def test_around_a_position_it_is_found_and_by_positions_doubted(town):
    walk = Walk(town)
    _, answers = walk.go(HERE, 5, position=(1.0, 1.0))
    assert answers[0].epoch.reason.startswith("found in 2 m around the last position")
    is_localized, answers = walk.go(walk.on(town, 5), 22)
    assert not any(is_localized)
    assert answers[-1].epoch.reason.endswith("to be confirmed by positions over 2 m")
    is_localized, answers = walk.go(walk.on(town, 27), 3, position=(1.0, 1.0))
    assert is_localized == [True] * 3
    is_localized, answers = walk.go(walk.on(town, 30), 3, position=(5.0, 0.0))
    assert is_localized == [True, False, False]
    assert (answers[-1].epoch.status, answers[-1].epoch.pose_global) == (Status.LOST, None)
    assert answers[-1].epoch.reason == "3 positions in a row speak against it"


def test_what_may_be_done_after_an_answer_is_done_then(town):
    walk = Walk(town)
    walk.live._puts_off = walk.live._tracker.puts_off = True
    _, answers = walk.go(HERE, 2)
    assert [answer.epoch.status for answer in answers] == [Status.NO_PRIOR] * 2
    assert "whole map" not in answers[-1].epoch.reason
    walk.live._work_off()
    is_localized, answers = walk.go(walk.on(town, 2), 14)
    assert "found in the whole map" in answers[0].epoch.reason and is_localized[2:] == [True] * 12
    assert walk.live._tracker.put_off is not None
    assert max(answer.effort.half_width for answer in answers[3:]) < 1.0
    walk.live._tracker.move(Motion.none())
    assert walk.live._tracker.put_off is None  # the scan is not of this place any more
    walk.go(walk.on(town, 16), 1)
    walk.live._work_off()
    assert walk.live._tracker.searched > 1.0 and walk.live._tracker.put_off is None


def test_where_a_position_is_off_the_map_it_is_said(town):
    _, (answer,) = Walk(town).go(HERE, 1, position=(900.0, 0.0))
    assert answer.epoch.status is Status.LOST
    assert "Expected ground of the map within 2.5 m" in answer.epoch.reason


def test_without_odometry_each_scan_is_found_by_itself(town):
    live = LiveLocalizer(town.map, options=LiveOptions(patience=2))
    for number in range(2):
        pose = town.pose(-12.0, 12.0 + number, 0.4)
        live.add_scan(0.1 * number, town.scan(pose, number).points, now=0.0)
        (answer,) = live.answers(0.05)
        assert (answer.epoch.status, answer.T_map_odom) == (Status.LOCALIZED, None)
        assert answer.epoch.pose_global.values == pytest.approx(pose.values, abs=0.1)
