"""Tracking along a street that repeats itself: what is told apart, found again, and never called localized."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from maxcon import MaximumConsensus, PointMap, Pose, Scan, SearchSpace, Status
from maxcon.drive.hypotheses import measured_covariance, window
from maxcon.drive.motion import Motion, MotionNoise, UncertainPose
from maxcon.drive.tracker import Tracker, TrackingOptions
from maxcon.geometry import wrap_angle
from upright_walls import on_grid

PERIOD = 3.0
PORCH = 40.0
"""Where along the street the one thing stands that does not repeat, m."""
SIGHT = 15.0
"""How far along the street the scanner sees, m."""
CELL = 0.06
OFF = (0.9, -0.6, 0.0)
"""The prior is that far off, m."""


def _wall(corner, along, height=3.0):
    """Points every 5 cm on an upright rectangle from a corner (x, y) along a vector (x, y), m."""
    return on_grid(corner, np.add(corner, along), (0.025, height), first=0.025)[0]


def _street(first=-30.0, last=90.0):
    """Points and normals of two facades 12 m apart with a pilaster every 3 m, and of a porch on the left."""
    back, ahead = (-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)
    parts = [(_wall((PORCH + 1.2, 3.5), (0.0, 2.5)), back), (_wall((PORCH + 4.2, 3.5), (0.0, 2.5)), ahead)]
    for side in (-1.0, 1.0):
        parts.append((_wall((first, side * 6.03), (last - first, 0.0)), (0.0, -side, 0.0)))
        for x in np.arange(first, last, PERIOD):
            for offset, normal in ((0.02, back), (0.52, ahead)):
                parts.append((_wall((x + offset, side * 5.63), (0.0, side * 0.4)), normal))
    points, normals = zip(*parts, strict=True)
    return np.concatenate(points), np.repeat(normals, [len(part) for part in points], axis=0)


@dataclass(frozen=True)
class Street:
    """The map of the street, and scans of it."""

    points: np.ndarray
    normals: np.ndarray
    point_map: PointMap

    def scan(self, pose, n_points=2500, seed=0):
        """What is seen from a pose: some points of the map, 1 cm off."""
        rng = np.random.default_rng([seed, round(1e3 * pose.x) + 10**6])
        seen = np.flatnonzero(np.abs(self.points[:, 0] - pose.x) < SIGHT)
        chosen = rng.choice(seen, n_points, replace=False)
        points = self.points[chosen] + 0.01 * rng.standard_normal((n_points, 3))
        return Scan((points - pose.position) @ pose.rotation, self.normals[chosen] @ pose.rotation)

    def clutter(self, seed=0):
        """A scan that shows nothing of the street."""
        rng = np.random.default_rng(seed)
        points = rng.uniform([-5.0, -4.0, -1.0], [5.0, 4.0, 1.0], (2500, 3))
        return Scan(points, np.tile([0.0, 0.0, 1.0], (2500, 1)))


@pytest.fixture(scope="session")
def street():
    points, normals = _street()
    return Street(points, normals, PointMap.from_points(points, normals, cell=CELL))


@pytest.fixture(scope="session")
def method():
    """Looks 3.96 m around a prior: at one period to either side."""
    return MaximumConsensus(SearchSpace(3.96, CELL, 1.0, 0.5))


def where(x):
    """The vehicle's true pose: it sways a little on its way along the street."""
    return Pose(x, 0.3 * math.sin(0.1 * x), 1.5, 0.005, -0.01, 0.03 * math.cos(0.1 * x))


def is_right(pose, x, distance=0.1):
    """Whether a pose lies within a distance (m) and a degree of the true one."""
    true = where(x)
    turn = abs(wrap_angle(pose.heading - true.heading))
    return math.hypot(pose.x - true.x, pose.y - true.y) < distance and turn < math.radians(1.0)


def prior_at(x, off=OFF):
    return where(x).translated(off)


def start_at(pose, sigma=0.1):
    angles = [math.radians(0.3)] * 2 + [math.radians(0.5)]
    return UncertainPose(pose, np.diag(np.square([sigma, sigma, 0.05, *angles])))


@dataclass
class Ride:
    """A tracker on its way: where the vehicle is, and what was answered."""

    tracker: Tracker
    street: object
    x: float | None = None
    scale: float = 1.01

    def to(self, x, scan=None, prior="near", slip=0.0):
        """Drive to x and localize; odometry has 1 % too much, and a slip (m) too little."""
        if self.x is not None:
            step = where(self.x).inverse @ where(x)
            told = replace(step, x=self.scale * step.x - slip)
            self.tracker.move(Motion(told, abs(told.x), 0.2, abs(told.heading)))
        self.x = x
        prior = prior_at(x) if isinstance(prior, str) else prior
        return self.tracker.localize(scan or self.street.scan(where(x)), self.street.point_map, prior)


def answers(ride, places, **options):
    return [(x, ride.to(x, **options)) for x in places]


def wrong(found):
    return [x for x, estimate in found if estimate.is_localized and not is_right(estimate.pose, x)]


def test_a_street_that_repeats_itself_is_ambiguous_until_something_does_not(street, method):
    ride = Ride(Tracker(method), street)
    before = answers(ride, np.arange(6.0, 20.0, 1.0))
    assert {estimate.status for _, estimate in before} == {Status.AMBIGUOUS}
    assert 2 <= len(ride.tracker.hypotheses) <= 4
    assert "places fit the last scans" in before[-1][1].reason
    after = answers(ride, np.arange(20.0, 46.0, 1.0))
    assert wrong(before) == wrong(after) == []
    first = next(x for x, estimate in after if estimate.is_localized)
    assert first < PORCH and all(estimate.is_localized for x, estimate in after if x >= first)
    assert after[-1][1].runner_up < 0.2


def test_what_was_told_apart_once_stays_so_where_the_street_repeats_again(street, method):
    ride = Ride(Tracker(method), street)
    answers(ride, np.arange(34.0, 58.0, 1.5))
    beyond = answers(ride, np.arange(58.0, 72.0, 1.0))  # the porch is out of sight
    assert wrong(beyond) == [] and all(estimate.is_localized for _, estimate in beyond)


def test_the_filter_is_better_than_single_cells_and_says_how_good(street, method):
    ride = Ride(Tracker(method, start=start_at(where(30.0))), street)
    found = answers(ride, np.arange(30.0, 50.0, 0.8))
    errors = [estimate.pose.position[:2] - where(x).position[:2] for x, estimate in found]
    assert max(np.linalg.norm(error) for error in errors) < 0.06
    normalized = [
        error @ np.linalg.solve(estimate.covariance[:2, :2], error)
        for error, (_, estimate) in zip(errors, found, strict=True)
    ]
    assert np.mean(normalized) < 4.0  # 2 would be exact
    heights = [abs(estimate.pose.z - where(x).z) for x, estimate in found]
    assert max(heights) < 0.05


def test_a_track_needs_no_prior_once_it_has_begun(street, method):
    ride = Ride(Tracker(method), street)
    assert ride.tracker.prediction is None and ride.to(29.0, prior=None) is None
    answers(ride, np.arange(30.0, 36.0, 1.0))
    alone = answers(ride, np.arange(36.0, 54.0, 1.0), prior=None)
    assert wrong(alone) == [] and all(estimate.is_localized for _, estimate in alone)
    assert alone[-1][1].cell is None


@pytest.mark.parametrize("shift", [-PERIOD, PERIOD])
@pytest.mark.parametrize("prior", ["near", None])
def test_a_wrong_place_to_begin_with_is_never_called_localized(street, method, shift, prior):
    start = where(32.0) @ Pose(shift, 0.0, 0.0, 0.0, 0.0, 0.0)
    ride = Ride(Tracker(method, start=start_at(start)), street)
    found = answers(ride, np.arange(32.0, 48.0, 1.0), prior=prior)
    assert wrong(found) == [] and found[-1][1].is_localized


def test_a_track_that_slipped_by_a_period_is_put_right(street, method):
    """Wheels slip by 3 m: everything fits as before, but for the porch."""
    ride = Ride(Tracker(method), street)
    answers(ride, np.arange(28.0, 34.0, 1.0))
    ride.to(34.0, slip=PERIOD)
    found = answers(ride, np.arange(35.0, 50.0, 1.0))
    assert found[-1][1].is_localized and all(x < 42.0 for x in wrong(found))
    assert wrong(found[-5:]) == []


@pytest.mark.parametrize("prior", ["near", None])
def test_after_a_gap_the_track_is_found_again(street, method, prior):
    """35 m in which nothing was scanned; with 3 % of drift two periods are within reach."""
    ride = Ride(Tracker(method, MotionNoise(share=0.03), start=start_at(where(0.0))), street, x=0.0, scale=1.02)
    found = answers(ride, np.arange(35.0, 50.0, 1.0), prior=prior)
    assert not found[0][1].is_localized or is_right(found[0][1].pose, 35.0)
    assert wrong(found) == [] and found[-1][1].is_localized


def test_scans_of_few_points_are_bridged_for_a_while_and_then_it_is_lost(street, method):
    ride = Ride(Tracker(method), street)
    answers(ride, np.arange(30.0, 38.0, 1.0))
    bridged = []
    for x in np.arange(38.0, 48.0, 1.0):
        seen = street.scan(where(x))
        bridged.append(ride.to(x, scan=Scan(seen.points[:40], seen.normals[:40]), prior=None))
    assert bridged[0].is_localized and "for the scan itself" in bridged[0].reason
    assert not bridged[-1].is_localized
    assert bridged[2].covariance[0, 0] > bridged[0].covariance[0, 0]
    again = answers(ride, np.arange(36.0, 48.0, 1.0))
    assert again[-1][1].is_localized and wrong(again) == []


def test_a_scan_that_shows_nothing_of_the_place_is_not_localized(street, method):
    """A vehicle that was carried away sees it at once: of its scans hardly a point matches."""
    ride = Ride(Tracker(method), street)
    answers(ride, np.arange(30.0, 38.0, 1.0))
    hidden = answers(ride, np.arange(38.0, 42.0, 1.0), scan=street.clutter(), prior=None)
    assert not any(estimate is not None and estimate.is_localized for _, estimate in hidden)
    assert "speaks against the predicted place" in hidden[0][1].reason
    again = answers(ride, np.arange(36.0, 48.0, 1.0))
    assert again[-1][1].is_localized and wrong(again) == []


@pytest.mark.parametrize("prior", ["near", None])
def test_a_place_alike_that_motion_does_not_lead_to_needs_a_prior_or_a_way_of_scans_that_agree(street, method, prior):
    """After it was carried away, a vehicle sees by a quarter of its points what fits some metres beside the track."""

    def seen(x):
        alike, clutter = street.scan(where(x + 3.6), n_points=700), street.clutter(seed=round(x))
        return Scan(*map(np.concatenate, ([alike.points, clutter.points], [alike.normals, clutter.normals])))

    ride = Ride(Tracker(method), street)
    answers(ride, np.arange(30.0, 38.0, 1.0))
    found = [ride.to(x, scan=seen(x), prior=None) for x in np.arange(38.0, 52.0, 1.0)]
    assert not any(estimate.is_localized for estimate in found)
    assert "without a prior scans have to agree over " in found[-1].reason
    assert is_right(found[-1].pose, 51.0 + 3.6)
    if prior is not None:
        assert ride.to(52.0, scan=seen(52.0), prior=prior_at(55.6)).is_localized
        assert ride.to(53.0, scan=seen(53.0), prior=None).is_localized
        return
    later = [ride.to(x, scan=seen(x), prior=None) for x in np.arange(52.0, 68.0, 1.0)]
    assert not later[0].is_localized and later[-1].is_localized


def test_a_prior_that_stays_elsewhere_makes_a_track_lost_and_takes_it_back(street, method):
    ride = Ride(Tracker(method, options=TrackingOptions(patience=8.0)), street)
    answers(ride, np.arange(30.0, 40.0, 1.0))
    found = [(x, ride.to(x, prior=prior_at(x, (0.0, 9.0, 0.0)))) for x in np.arange(40.0, 54.0, 1.0)]
    assert found[0][1].is_localized  # one prior says little
    assert found[-1][1].status is Status.LOST
    assert "outside of the prior's search space for" in found[-1][1].reason and wrong(found) == []
    again = answers(ride, np.arange(54.0, 60.0, 1.0))
    assert again[-1][1].is_localized and wrong(again) == []
    begun = Ride(Tracker(method), street)  # by a prior that is far off
    assert not any(begun.to(x, prior=prior_at(x, (2.0, 30.0, 0.0))).is_localized for x in np.arange(30.0, 36.0, 1.0))


def test_a_jump_larger_than_the_window_is_searched_widely(street, method):
    """The prediction is 0.4 m off: the best cell lies at the rim of its window, and the second look is wider."""
    ride = Ride(Tracker(method), street)
    answers(ride, np.arange(30.0, 36.0, 1.0))
    estimate = ride.to(36.0, slip=0.2)
    assert is_right(estimate.pose, 36.0, 0.15) and is_right(ride.to(37.0).pose, 37.0)


def test_an_estimate_s_own_covariance_is_used_where_it_has_one(street, method):
    """A method whose heights and tilts are measured pulls those of the track, as far as it says they are good."""

    @dataclass(frozen=True)
    class Refined(type(method)):
        def localize(self, scan, point_map, prior):
            estimate = super().localize(scan, point_map, prior)
            sigmas = np.array([0.01, 0.01, 0.01, 0.001, 0.001, 0.001])
            pose = replace(estimate.pose, z=1.8)
            return replace(estimate, pose=pose, covariance=np.diag(sigmas**2))

    refined = Refined(method.space)
    ride = Ride(Tracker(refined, start=start_at(where(30.0))), street)
    last = answers(ride, np.arange(30.0, 34.0, 1.0), prior=None)[-1][1]
    assert last.pose.z == pytest.approx(1.8, abs=0.03)
    assert street.point_map.sigma == 0.02  # which no number of scans makes less
    assert 0.02 < math.sqrt(last.covariance[0, 0]) < 0.023


def test_an_open_space_is_never_turned_into_cells(street):
    """One of 40 km would have over 2^36 of the map's; and what has no cells has no best cell."""
    wide = MaximumConsensus(SearchSpace(40_000.0))
    tracker = Tracker(wide, start=start_at(where(30.0)))
    estimate = tracker._conclude(street.point_map, prior_at(30.0))
    assert estimate.cell is None and is_right(estimate.pose, 30.0)
    unknown = replace(estimate, covariance=np.diag(np.full(6, np.inf)))
    assert 0.02 < math.sqrt(measured_covariance(unknown, wide.space)[0, 0]) < 0.03
    assert window(tracker.prediction, 3.0, wide.space).half_width < 2.0
