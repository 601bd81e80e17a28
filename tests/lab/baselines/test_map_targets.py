"""The part of a map that a scan can meet, thinned, and the cache of it: shared, bounded, gone with the map."""

import gc
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import count
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from walled_streets import same, skip_without_its_package

from maxcon import PointMap, Pose, Scan, Status
from maxcon.geometry import LocalFrame
from maxcon.lab.baselines import CountThenGicp, Gicp, Icp, MapTargets, MultiStart
from maxcon.lab.baselines.map_targets import N_TARGETS, Place, merge_planes, thin


@pytest.fixture(scope="module")
def plain():
    """Points strewn over 300 m x 300 m: 100 tiles."""
    points = np.random.default_rng(0).uniform(-150.0, 150.0, (20_000, 3)) * [1.0, 1.0, 0.02]
    return PointMap.from_points(points, np.tile([0.0, 0.6, 0.8], (len(points), 1)), 0.06)


def test_no_tile_is_loaded_beyond_the_reach_and_none_twice(plain):
    load, targets = Mock(wraps=plain.tile), MapTargets()
    point_map = PointMap(LocalFrame(), plain.cell, True, SimpleNamespace(keys=plain.tile_keys, load=load))
    targets.planes(point_map, Place(0, 0, 20.0), 0.25)
    assert sorted(call.args[0] for call in load.call_args_list) == [(kx, ky) for kx in (-1, 0, 1) for ky in (-1, 0, 1)]
    targets.planes(point_map, Place(1, 0, 20.0), 0.25)
    assert load.call_count == 9
    targets.planes(point_map, Place(0, 0, 20.0), 0.5)
    assert load.call_count == 18


def test_what_was_used_longest_ago_goes_first(plain):
    targets, make = MapTargets(), count(1).__next__
    other = PointMap.from_points([[0, 0, 0.0]], [[0, 0, 1.0]])
    assert [targets.get(a_map, 0, make) for a_map in (plain, other, plain, other)] == [1, 2, 1, 2]
    for key in range(N_TARGETS):
        targets.get(plain, key, make)
    assert targets.get(plain, 0, make) == 1 and targets.get(plain, "new", make) == N_TARGETS + 2
    assert targets.get(plain, 0, make) == 1 and targets.get(plain, 1, make) == N_TARGETS + 3


def test_a_map_that_is_gone_takes_its_targets_along(street_scan, street):
    targets = MapTargets()
    point_map = PointMap.from_points([[0, 0, 0.0]], [[0, 0, 1.0]])
    Icp(targets=targets).localize(street_scan, point_map, street.sensor)
    assert len(targets._kept) == 1
    del point_map
    gc.collect()
    assert len(targets._kept) == 0


METHODS = [
    lambda **shared: Icp("plane", 1.0, **shared), lambda **shared: Icp("point", 1.0, **shared),
    lambda **shared: Icp("plane", 3.0, target_edge=0.5, **shared), lambda **shared: Gicp(3.0, **shared),
    lambda **shared: Gicp(3.0, n_neighbours=20, **shared),
    lambda **shared: MultiStart(Icp("plane", 1.0, **shared), n_side=2),
    lambda **shared: CountThenGicp(gicp=Gicp(3.0, **shared)),
]  # fmt: skip


def test_methods_that_share_answer_as_alone_whatever_was_localized_before(street, street_map, street_scan):
    pytest.importorskip("small_gicp")
    targets, prior = MapTargets(), street.prior(0.4, 0.2)
    flat = PointMap.from_points([[0, 0, 0.0]], [[0, 0, 1.0]])
    for x in (-70.0, -30.0, 50.0, 90.0):
        METHODS[0](targets=targets).localize(street_scan, street_map, replace(prior, x=x))
        METHODS[3](targets=targets).localize(street_scan, street_map, replace(prior, x=x))
        METHODS[0](targets=targets).localize(street_scan, flat, prior)
    shared = [make(targets=targets) for make in METHODS]
    wanted = [make().localize(street_scan, street_map, prior) for make in METHODS]
    with ThreadPoolExecutor(3) as pool:
        found = list(pool.map(lambda method: method.localize(street_scan, street_map, prior), 2 * shared))
    assert all(same(one, alone) for one, alone in zip(found, 2 * wanted, strict=True))


@pytest.mark.parametrize("make", METHODS)
def test_where_nothing_matches_the_prior_is_the_answer(street, street_map, street_scan, make):
    method, nothing = make(), Scan(np.empty((0, 3)))
    skip_without_its_package(method)
    above, far = replace(street.sensor, z=street.sensor.z + 10.0), replace(street.sensor, x=1e5)
    for scan, prior in ((street_scan, above), (street_scan, far), (nothing, street.sensor)):
        found = method.localize(scan, street_map, prior)
        assert (found.status, found.score, found.share) == (Status.NO_MATCH, 0.0, 0.0)
        assert found.pose == prior or isinstance(method, MultiStart)
        assert np.isinf(np.diag(found.cofactor)).all()


# --- places and thinning ---
def at(x, y):
    return Pose(x, y, 1.7, 0.0, 0.0, 0.0)


def test_a_place_is_a_square_and_a_reach():
    points = np.array([[30.0, 0.0, 40.0], [1.0, 2.0, 3.0]])  # 50 m, and 5 m of drift
    assert Place.of_scan(points, at(39.9, -0.1), gate=1.0, spread=0.0) == Place(1, -1, 60.0)
    assert Place.of_scan(points, at(40.0, 0.0), gate=3.0, spread=2.5) == Place(2, 0, 80.0)
    assert Place(1, -1, 60.0).middle == (30.0, -10.0) and Place(1, -1, 60.0).half_width == 70.0
    assert Place.of_scan(np.empty((0, 3)), at(0.0, 0.0), 1.0, 0.0) == Place(0, 0, 20.0)


def test_means_of_cubes_and_of_normals_that_agree():
    points = np.array([[0.9, 0.1, 0.0], [-0.1, 0.1, 0.0], [0.1, 0.3, 0.0], [0.1, 0.1, 1.5], [0.3, 0.1, 0.2]])
    assert thin(points, 0.0) is points and thin(points[:0], 0.5).shape == (0, 3)
    np.testing.assert_allclose(
        thin(points, 1.0), [[-0.1, 0.1, 0.0], [(0.9 + 0.1 + 0.3) / 3, 0.5 / 3, 0.2 / 3], [0.1, 0.1, 1.5]]
    )
    points = np.array([[0.1, 0, 0], [0.3, 0, 0], [1.1, 0, 0], [1.2, 0, 0], [2.1, 0, 0], [2.2, 0, 0.0]])
    tilted = [np.sin(0.2), np.cos(0.2), 0.0]
    normals = np.array([[0, 1, 0], tilted, [0, 1, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0.0]])
    merged, found = merge_planes(points, normals, 1.0, is_signed=True)
    np.testing.assert_allclose(merged[:, 0], [0.2, 1.15, 2.15])
    np.testing.assert_allclose(found, [[np.sin(0.1), np.cos(0.1), 0.0], [0, 0, 0], [0, 0, 0]], atol=1e-15)
