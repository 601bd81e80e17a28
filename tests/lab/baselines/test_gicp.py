"""Generalized ICP through small_gicp, on the same streets, and after a coarse count."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from walled_streets import Street

from maxcon import Pose, Status
from maxcon.errors import MissingExtraError
from maxcon.lab.baselines import CountThenGicp, Gicp


@pytest.fixture(autouse=True)
def _small_gicp(request):
    if "without" not in request.node.name:
        pytest.importorskip("small_gicp")


@pytest.fixture(scope="module")
def tilted():
    return Street(sensor=Pose(512.2, -1.4, 1.9, 0.05, -0.04, 0.9)).facades().pilasters([-13.7, -6.1, 3.3, 9.4])


def test_all_six_unknowns_are_found(tilted):
    start = tilted.prior(0.5, 0.3, 1.0)
    start = replace(start, roll=start.roll + 0.01, pitch=start.pitch - 0.005)
    estimate = Gicp(thinning=0.0).localize(tilted.scan(step=0.05), tilted.point_map, start)
    assert estimate.status == Status.LOCALIZED and tilted.distance(estimate.pose) < 0.01
    assert abs(estimate.pose.heading - tilted.sensor.heading) < math.radians(0.1)
    assert abs(estimate.pose.roll - tilted.sensor.roll) < 0.005
    assert abs(estimate.pose.pitch - tilted.sensor.pitch) < 0.005 and estimate.cell is None
    assert estimate.share == estimate.score / len(tilted.scan(step=0.05)) > 0.99


def test_as_if_the_map_were_at_the_origin(tilted):
    """Coordinates are shifted: a map 2,560 km away gives the same answer."""
    near = Street(sensor=Pose(12.2, -1.4, 1.9, 0.0, 0.0, 0.9)).facades().pilasters([-13.7, -6.1, 3.3, 9.4])
    far = replace(near, sensor=replace(near.sensor, x=near.sensor.x + 2.56e6))
    errors = [
        street.error(Gicp().localize(street.scan(), street.point_map, street.prior(0.3, 0.2)).pose)
        for street in (near, far)
    ]
    np.testing.assert_allclose(errors[0], errors[1], atol=1e-3)


@pytest.mark.parametrize("heading", [0.4, 2.0])
def test_the_cofactor_is_in_map_axes_and_in_units_of_one_match(heading):
    corner = Street(0.0, Pose(3.2, -1.4, 1.7, 0.0, 0.0, heading))
    corner.wall((-20.0, 6.0), (20.0, 6.0)).wall((15.0, -2.0), (15.0, 3.0))
    method = Gicp(thinning=0.0)
    estimate = method.localize(corner.scan(step=0.05), corner.point_map, corner.prior(0.1, 0.1))
    assert estimate.is_localized
    n_y, n_x = 800, 100  # points that face along y, and along x
    assert estimate.cofactor[1, 1] == pytest.approx(1.0 / n_y, rel=0.1)
    assert estimate.cofactor[0, 0] == pytest.approx(1.0 / n_x, rel=0.25)


def test_one_step_is_not_rest(street, street_map):
    dense_scan = street.scan(step=0.04)
    estimate = Gicp(max_iterations=1).localize(dense_scan, street_map, street.prior(0.5))
    assert estimate.status == Status.NOT_CONVERGED
    loose = Gicp(max_iterations=2, step_tolerance=9.0, turn_tolerance=9.0)
    assert loose.localize(dense_scan, street_map, street.prior(0.5)).status != Status.NOT_CONVERGED


@pytest.mark.parametrize(("half_width", "heading", "cells", "turns_deg"), [
    (3.0, 2.0, (-4.0, 3.0), 2.0), (2.2, 1.5, (-4.0, 3.0), 2.0), (12.0, 0.0, (-13.0, 12.0), 0.0),
])  # fmt: skip
def test_the_window_holds_either_boundary(half_width, heading, cells, turns_deg):
    space = CountThenGicp(half_width, heading).window
    assert (space.offsets[0], space.offsets[-1]) == cells
    assert math.degrees(space.headings[-1]) == pytest.approx(turns_deg)
    assert math.degrees(space.headings[0]) == pytest.approx(-turns_deg)


@pytest.mark.parametrize(("along", "across", "turn_deg"), [(9.0, -5.0, 8.0), (-11.5, 4.0, -9.0), (0.0, 0.0, 0.0)])
def test_it_ends_at_the_truth_from_where_gicp_alone_does_not(street, street_map, street_scan, along, across, turn_deg):
    prior = street.prior(along, across, turn_deg)
    fine = Gicp(3.0, thinning=0.3, target_edge=0.1, n_neighbours=15)
    found = CountThenGicp(12.0, 10.0, gicp=fine).localize(street_scan, street_map, prior)
    assert street.distance(found.pose) < 0.1
    alone = fine.localize(street_scan, street_map, prior)
    assert (street.distance(alone.pose) < 0.3) == (along == 0.0)


def test_without_small_gicp_the_extra_is_named(street, street_map, street_scan, monkeypatch):
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'maxcon\[baselines\]'"):
        Gicp().localize(street_scan, street_map, street.sensor)
