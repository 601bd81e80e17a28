"""Many starts: where they are, what is made of where they end; options of all baselines."""

import copy
import math
import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from walled_streets import Street, same, skip_without_its_package

from maxcon import Estimate, Pose, Scan, Status
from maxcon.errors import OptionError
from maxcon.lab.baselines import Choice, CountThenGicp, Gicp, Icp, MultiStart

CENTRE = Pose(10.0, 20.0, 1.5, 0.01, 0.02, 0.3)
Many = partial(MultiStart, Icp())


def estimate(x, y, score, status=Status.LOCALIZED, heading=0.3):
    return Estimate(replace(CENTRE, x=x, y=y, heading=heading), score, None, status, np.eye(2))


class Recorded:
    """A method that ends at given estimates, and remembers what it was asked for."""

    def __init__(self, ends, overlaps=None):
        self.ends, self.prepared, self.starts, self.overlaps = list(ends), [], [], overlaps

    def prepare(self, scan, point_map, around, spread=0.0):
        self.prepared.append((scan, point_map, around, spread))
        return self

    def align(self, start):
        self.starts.append(start)
        return self.ends[len(self.starts) - 1]

    def n_near_map(self, pose, distance):
        return self.overlaps[pose.x, distance]


def test_the_papers_grid_is_five_by_five_at_one_metre():
    starts = MultiStart(Icp()).starts(CENTRE)
    assert [(start.x, start.y) for start in starts] == [
        (x, y) for y in (18.0, 19.0, 20.0, 21.0, 22.0) for x in (8.0, 9.0, 10.0, 11.0, 12.0)
    ]
    assert all(replace(start, x=10.0, y=20.0) == CENTRE for start in starts)
    assert starts[12] == CENTRE and MultiStart(Icp(), n_side=1).starts(CENTRE) == [CENTRE]
    starts = MultiStart(Icp(), n_side=2, spacing=0.5, n_headings=3, heading_spacing_deg=4.0).starts(CENTRE)
    corners = [(9.75, 19.75), (10.25, 19.75), (9.75, 20.25), (10.25, 20.25)]
    assert [(start.x, start.y) for start in starts] == 3 * corners
    assert [round(math.degrees(start.heading - CENTRE.heading), 9) for start in starts[::4]] == [-4.0, 0.0, 4.0]


def test_a_scan_is_prepared_once_for_all_starts():
    scan, point_map, ends = Scan(np.empty((0, 3))), object(), [estimate(i, 0.0, 1.0) for i in range(25)]
    method = Recorded(ends)
    assert MultiStart(method).estimates(scan, point_map, CENTRE) == ends
    assert method.starts == MultiStart(method).starts(CENTRE)
    (prepared,) = method.prepared
    assert prepared[:3] == (scan, point_map, CENTRE)
    assert prepared[3] == pytest.approx(math.hypot(2.0, 2.0))


def test_by_overlap_the_end_nearest_to_the_map_wins_and_says_its_own_word():
    ends = [
        estimate(1.0, 0.0, 9.0), estimate(2.0, 0.0, 5.0, Status.NOT_CONVERGED), estimate(3.0, 0.0, 5.0),
        estimate(4.0, 0.0, 7.0),
    ]  # fmt: skip
    overlaps = {(1.0, 0.3): 3, (2.0, 0.3): 8, (3.0, 0.3): 8, (4.0, 0.3): 7}
    many = MultiStart(Recorded(ends, overlaps), n_side=2, choice="overlap")
    found = many.localize(Scan(np.empty((0, 3))), object(), CENTRE)
    assert (found.pose, found.score, found.status) == (ends[1].pose, 8.0, Status.NOT_CONVERGED)
    assert many.choice is Choice.OVERLAP


@pytest.mark.parametrize("method", [Icp(), Gicp()])
def test_points_near_the_map_are_counted_at_a_pose(street, street_map, street_scan, method):
    skip_without_its_package(method)
    aligner = method.prepare(street_scan, street_map, street.sensor)
    n_points = aligner.n_near_map(street.sensor, 50.0)
    assert aligner.n_near_map(street.sensor, 0.5) > 0.95 * n_points > 0
    assert aligner.n_near_map(street.prior(0.0, 2.0), 0.5) < 0.5 * n_points


def test_a_street_of_equal_houses_is_ambiguous():
    periodic = Street().facades(length=61.0).pilasters(np.arange(-28.5, 29.0, 3.0))
    many = MultiStart(Icp(gate=1.0))
    scan, point_map = periodic.scan(), periodic.point_map
    ends = many.estimates(scan, point_map, periodic.sensor)
    assert sum(periodic.distance(end.pose) < 0.3 for end in ends) < 25
    chosen = many.localize(scan, point_map, periodic.sensor)
    assert chosen.status == Status.AMBIGUOUS and chosen.score == max(end.score for end in ends)


@pytest.mark.parametrize("method", [Icp(), Gicp()])
def test_each_start_ends_where_it_ends_alone(street, street_map, street_scan, method):
    skip_without_its_package(method)
    many = MultiStart(method, n_side=2)
    ends = many.estimates(street_scan, street_map, street.sensor)
    for start, end in zip(many.starts(street.sensor), ends, strict=True):
        alone = method.localize(street_scan, street_map, start)
        assert alone.status == end.status
        assert math.dist(alone.pose.position, end.pose.position) < 1e-6


@pytest.mark.parametrize(("best", "other", "status"), [
    ({}, {"x": 0.29}, Status.LOCALIZED),
    ({}, {"x": 0.22, "y": 0.22}, Status.AMBIGUOUS),
    ({}, {"heading": 0.3 + math.radians(0.9)}, Status.LOCALIZED),
    ({}, {"heading": 0.3 - math.radians(1.1)}, Status.AMBIGUOUS),
    ({}, {"x": 3.0, "status": Status.NO_MATCH}, Status.AMBIGUOUS),
    ({"heading": math.pi - 0.001}, {"heading": -math.pi + 0.001}, Status.LOCALIZED),
    ({"status": Status.UNDETERMINED}, {"x": 5.0}, Status.UNDETERMINED),
    ({"status": Status.NOT_CONVERGED}, {"x": 5.0}, Status.NOT_CONVERGED),
])  # fmt: skip
def test_the_most_correspondences_win_and_ends_elsewhere_make_it_ambiguous(best, other, status):
    first, second = (estimate(**{"x": 0.0, "y": 0.0, "score": 9.0, **values}) for values in (best, best))
    worse = estimate(**{"x": 0.0, "y": 0.0, "score": 3.0, **other})
    chosen = MultiStart(Icp()).choose([worse, first, second])
    assert (chosen.status, chosen.pose, chosen.score) == (status, first.pose, 9.0)


@pytest.mark.parametrize(("kind", "options", "words"), [
    (Icp, {"residual": "planes"}, "'plane' or 'point', got 'planes'"),
    (Icp, {"gate": 0.0}, "`gate` to be finite, and above 0, got 0.0. The default is 1.0."),
    (Icp, {"gate": math.inf}, "`gate` to be finite, and above 0, got inf"),
    (Icp, {"thinning": -0.1}, "`thinning` to be finite, and 0 or more, got -0.1"),
    (Icp, {"max_iterations": 2.5}, "`max_iterations` to be a whole number from 1, got 2.5. The default is 100."),
    (Gicp, {"n_neighbours": 0}, "`n_neighbours` to be a whole number from 1, got 0"),
    (CountThenGicp, {"heading_half_width_deg": -1.0}, "`heading_half_width_deg` to be finite, and 0 or more"),
    (Many, {"choice": "best"}, "`choice` to be 'agreement' or 'overlap', got 'best'"),
])  # fmt: skip
def test_options_out_of_range_are_refused(kind, options, words):
    with pytest.raises(OptionError) as refusal:
        kind(**options)
    assert words in str(refusal.value)


@pytest.mark.parametrize("method", [Icp("point", gate=2.0), Gicp(1.0), Many(n_side=2), CountThenGicp(gicp=Gicp(1.0))])
def test_a_method_travels_without_what_it_keeps_of_maps(street, street_map, street_scan, method):
    skip_without_its_package(method)
    prior = street.prior(0.3)
    wanted = method.localize(street_scan, street_map, prior)
    packed = pickle.dumps(method)
    assert len(packed) < 1500
    for twin in (pickle.loads(packed), copy.deepcopy(method)):
        assert twin == method and hash(twin) == hash(method) and "targets" not in repr(twin)
        assert same(twin.localize(street_scan, street_map, prior), wanted)
