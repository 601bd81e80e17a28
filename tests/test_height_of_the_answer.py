"""MaximumConsensus from priors of wrong height and tilt: on the ground, over heights, or neither."""

import math
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from maxcon import Helmert, MaximumConsensus, PointMap, Pose, Scan, SearchSpace, Status
from maxcon.cell_search import CellSearch
from maxcon.refine import fit_ground
from maxcon.search import branch_and_bound
from upright_walls import joined, on_grid

CELL = 0.06
SPACE = SearchSpace(0.6, CELL, 1.0, 0.5)
TRUTH = Pose(0.0, 0.0, 1.8, 0.0, 0.0, 0.4)


def ground(x, y):
    return 0.05 * x - 0.02 * y


def upright(x, y, heading):
    """The pose of a sensor 1.8 m above the sloping ground, upright on it."""
    c, s = math.cos(heading), math.sin(heading)
    pitch = -math.atan(0.05 * c - 0.02 * s)
    roll = math.atan((-0.05 * s - 0.02 * c) * math.cos(pitch))
    return Pose(x, y, float(ground(x, y)) + 1.8, roll, pitch, heading)


@pytest.fixture(scope="module")
def yard():
    """A sloping yard between three walls with ledges, its map with and without ground, and a scan from a known pose."""
    rng = np.random.default_rng(0)
    walls, normals = [], []
    for start, along, normal in (
        ([-9.0, 8.0], [1.0, 0.0], [0.0, -1.0]),
        ([-9.0, -8.0], [1.0, 0.0], [0.0, 1.0]),
        ([9.0, -8.0], [0.0, 1.0], [-1.0, 0.0]),
    ):
        at, z = (grid.ravel() for grid in np.meshgrid(np.arange(0.0, 17.0, 0.04), np.arange(0.5, 4.0, 0.04)))
        place = np.array(start) + at[:, None] * along
        is_wall = ((at * 0.7).astype(int) + (z / 0.9).astype(int)) % 2 == 0  # with openings: heights differ
        walls.append(np.column_stack([place, z])[is_wall])
        normals.append(np.tile([*normal, 0.0], (is_wall.sum(), 1)))
    walls, normals = np.concatenate(walls), np.concatenate(normals)
    x, y = (grid.ravel() for grid in np.meshgrid(*2 * [np.arange(-20.0, 20.0, 0.1)]))
    floor = np.column_stack([x, y, ground(x, y)])
    truth = upright(0.5, -0.3, 0.4)
    seen, below = rng.permutation(len(walls))[:4000], rng.permutation(len(floor))[:8000]
    points = np.concatenate([walls[seen], floor[below] + rng.normal(0.0, 0.01, (8000, 1)) * [0.0, 0.0, 1.0]])
    facing = np.concatenate([normals[seen], np.zeros((8000, 3))])
    scan = Scan((points - truth.position) @ truth.rotation, facing @ truth.rotation)
    without = PointMap.from_points(walls, normals, CELL)
    return scan, PointMap.from_points(walls, normals, CELL, ground=floor), without, truth


def wrong(truth, height, tilt_deg=0.0):
    tilt = math.radians(tilt_deg)
    return replace(truth, x=truth.x + 0.25, z=truth.z + height, roll=truth.roll + tilt, pitch=truth.pitch - tilt)


@pytest.mark.parametrize("search", ["branch-and-bound", "exhaustive"])
@pytest.mark.parametrize(("height", "tilt_deg"), [(0.0, 0.0), (1.0, 1.0), (-0.9, -0.8)])
def test_on_the_ground_the_answer_has_its_height_and_tilt(yard, search, height, tilt_deg):
    scan, point_map, _, truth = yard
    method = MaximumConsensus(SPACE, search=search)
    estimate = method.localize(scan, point_map, wrong(truth, height, tilt_deg))
    assert estimate.status is Status.LOCALIZED
    np.testing.assert_allclose(estimate.pose.position, truth.position, atol=0.05)
    assert abs(estimate.pose.z - truth.z) < 0.02
    assert abs(estimate.pose.roll - truth.roll) < math.radians(0.2)
    assert abs(estimate.pose.pitch - truth.pitch) < math.radians(0.2)


def test_what_is_accumulated_is_what_is_localized(yard):
    scan, point_map, _, truth = yard
    method = MaximumConsensus(SPACE)
    prior = wrong(truth, 0.7, 0.5)
    accumulator = method.accumulate(scan, point_map, prior)
    concluded, estimate = (method.conclude(accumulator, scan, point_map), method.localize(scan, point_map, prior))
    assert accumulator.best_cell(Helmert()) == estimate.cell == concluded.cell
    assert concluded.pose == estimate.pose


@pytest.mark.parametrize("search", ["branch-and-bound", "exhaustive"])
def test_roofs_of_cars_are_not_the_ground(yard, search):
    """All around the sensor stand cars: what looks like the ground lies 0.9 m above it, and the walls say otherwise."""
    scan, point_map, _, truth = yard
    points = scan.points.copy()
    is_floor = ~scan.normals.any(axis=1)
    points[is_floor] += truth.rotation.T @ [0.0, 0.0, 0.9]
    estimate = MaximumConsensus(SPACE, search=search).localize(Scan(points, scan.normals), point_map, wrong(truth, 0.0))
    assert estimate.status is Status.LOCALIZED
    np.testing.assert_allclose(estimate.pose.position, truth.position, atol=0.05)


def test_a_ground_that_the_adjustment_leaves_is_none(yard, monkeypatch):
    """Searched again from roofs of cars the pose returns to its height, and may score a trifle more."""
    scan, point_map, _, truth = yard
    points, best, found = scan.points.copy(), CellSearch.best, []
    points[~scan.normals.any(axis=1)] += truth.rotation.T @ [0.0, 0.0, 0.9]

    def returned(*arguments):
        highest = max(found, key=lambda each: each.score, default=None)
        found.append(best(*arguments) if len(found) < 2 else replace(highest, score=1.001 * highest.score))
        return found[-1]

    monkeypatch.setattr(CellSearch, "best", returned)
    method, prior = MaximumConsensus(SearchSpace(2.0, heading_half_width_deg=2.0)), wrong(truth, 0.0)
    estimate = method.localize(Scan(points, scan.normals), point_map, prior)
    assert estimate.is_localized and abs(estimate.pose.z - truth.z) < 0.05


def test_a_prior_is_taken_as_it_is_if_asked_for(yard):
    scan, point_map, without, truth = yard
    prior = wrong(truth, 0.3, 0.2)
    for method, its_map in (
        (MaximumConsensus(SPACE, is_levelled=False, refinement=False), point_map),
        (MaximumConsensus(SPACE, refinement=False), without),
    ):
        pose = method.localize(scan, its_map, prior).pose
        assert (pose.z, pose.roll, pose.pitch) == (prior.z, prior.roll, prior.pitch)


@pytest.mark.parametrize("search", ["branch-and-bound", "exhaustive"])
def test_without_ground_the_height_is_searched(yard, search):
    scan, _, without, truth = yard
    method = MaximumConsensus(replace(SPACE, height_half_width=0.6), search=search)
    for height in (-0.48, 0.3):
        estimate = method.localize(scan, without, wrong(truth, height))
        assert estimate.status is Status.LOCALIZED
        np.testing.assert_allclose(estimate.pose.position, truth.position, atol=0.05)
    here = MaximumConsensus(SPACE).localize(scan, without, wrong(truth, 0.3))
    assert here.score < estimate.score


@pytest.mark.parametrize("search", ["branch-and-bound", "exhaustive"])
def test_the_outermost_height_is_the_boundary(yard, search):
    scan, _, without, truth = yard
    method = MaximumConsensus(replace(SPACE, height_half_width=0.3), search=search)
    assert method.localize(scan, without, wrong(truth, 0.42)).status is Status.AT_RIM
    assert method.localize(scan, without, wrong(truth, 0.24)).status is Status.LOCALIZED


def test_a_height_that_the_ground_of_the_answer_confirms_is_not_at_the_boundary(yard, monkeypatch):
    """Around the prior the ground cannot be told, so that heights are searched; at the answer it can."""
    scan, point_map, _, truth = yard
    told = []

    def fit(*arguments):
        told.append(fit_ground(*arguments) if told else None)
        return told[-1]

    monkeypatch.setattr("maxcon.localizer.fit_ground", fit)
    prior = wrong(truth, 0.3)
    estimate = MaximumConsensus(replace(SPACE, height_half_width=0.3)).localize(scan, point_map, prior)
    assert told[0] is None and told[1] is not None
    assert estimate.status is Status.LOCALIZED and abs(estimate.pose.z - truth.z) < 0.02


def test_with_ground_heights_are_not_searched(yard, monkeypatch):
    scan, point_map, without, truth = yard
    search = Mock(wraps=branch_and_bound)
    monkeypatch.setattr("maxcon.cell_search.branch_and_bound", search)
    method = MaximumConsensus(replace(SPACE, height_half_width=0.12))
    method.localize(scan, point_map, wrong(truth, 0.06))
    method.localize(scan, without, wrong(truth, 0.06))
    assert [call.args[3].n_heights for call in search.call_args_list] == [1, 5]


def test_where_the_ground_of_the_answer_is_another_it_is_searched_again_from_there():
    """A prior 3 m along a steep ramp: 0.45 m higher than where the scan was taken."""
    rng = np.random.default_rng(0)
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(-25.0, 25.0, 0.1), np.arange(-9.0, 9.0, 0.1)))
    floor = np.column_stack([x, y, 0.15 * x])
    # Posts on either side: a face along the ramp and one across.
    posts, normals = [], []
    for at in rng.uniform(-20.0, 20.0, 40):
        side = rng.choice([-6.0, 6.0])
        z = np.arange(0.0, rng.uniform(0.4, 3.0), 0.05) + 0.15 * at
        across, up = (grid.ravel() for grid in np.meshgrid(np.arange(0.0, 0.6, 0.04), z))
        posts.append(np.column_stack([at + across, np.full(len(up), side), up]))
        normals.append(np.tile([0.0, -np.sign(side), 0.0], (len(up), 1)))
        posts.append(np.column_stack([np.full(len(up), at), side + across * np.sign(side), up]))
        normals.append(np.tile([-1.0 if at > 0.0 else 1.0, 0.0, 0.0], (len(up), 1)))
    posts, normals = np.concatenate(posts), np.concatenate(normals)
    point_map = PointMap.from_points(posts, normals, CELL, ground=floor)
    truth = Pose(0.0, 0.0, 1.8, 0.0, -math.atan(0.15), 0.0)
    points = np.concatenate([posts, floor[rng.permutation(len(floor))[:6000]]])
    facing = np.concatenate([normals, np.zeros((6000, 3))])
    scan = Scan((points - truth.position) @ truth.rotation, facing @ truth.rotation)
    prior = replace(truth, x=truth.x + 3.0)
    estimate = MaximumConsensus(SearchSpace(3.6, CELL, 0.5, 0.5)).localize(scan, point_map, prior)
    np.testing.assert_allclose(estimate.pose.position, truth.position, atol=0.04)
    assert estimate.cell == (1, 60, 10)


@pytest.fixture(scope="module", params=[True, False])
def garage(request):
    """Three storeys of a garage, 2.8 m high, whose pillars differ from storey to storey, or not; and a scan in the
    second."""
    rng, truth = np.random.default_rng(4), Pose(0.4, -0.3, 4.5, 0.0, 0.0, 0.2)
    differs, clouds, floors = request.param, [], []
    places = [rng.uniform(-9.0, 9.0, (14, 2)) for _ in range(3)]
    for storey in range(3):
        x, y = (grid.ravel() for grid in np.meshgrid(*2 * [np.arange(-12.0, 12.0, 0.1)]))
        floors.append(np.column_stack([x, y, np.full(len(x), 2.8 * storey)]))
        ways = [((12.03, -12.0), (12.03, 12.0)), ((-12.0, -12.03), (12.0, -12.03))]
        for x, y in places[storey if differs else 0]:
            ways += [((x, y), (x, y + 0.6)), ((x + 0.6, y), (x, y))]
        clouds.append(joined(*(on_grid(*way, (2.8 * storey + 0.1, 2.8 * storey + 2.6), 0.04) for way in ways)))
    city = PointMap.from_points(*map(np.concatenate, zip(*clouds, strict=True)), CELL, ground=np.concatenate(floors))
    seen, below = rng.permutation(len(clouds[1][0]))[:6000], rng.permutation(len(floors[1]))[:6000]
    points = np.concatenate([clouds[1][0][seen], floors[1][below]])
    normals = np.concatenate([clouds[1][1][seen], np.zeros((6000, 3))])
    return differs, Scan((points - truth.position) @ truth.rotation, normals @ truth.rotation), city, truth


@pytest.mark.parametrize("height", [0.0, -2.6, 2.4])
def test_storeys_are_told_apart_or_the_answer_is_ambiguous(garage, height):
    differs, scan, point_map, truth = garage
    prior = replace(truth, x=truth.x + 0.6, z=truth.z + height)
    estimate = MaximumConsensus(SearchSpace(1.0, heading_half_width_deg=2.0)).localize(scan, point_map, prior)
    if differs:
        assert estimate.is_localized
        np.testing.assert_allclose(estimate.pose.position, truth.position, atol=0.05)
    else:
        assert estimate.status is Status.AMBIGUOUS and "the storey " in estimate.reason


def test_a_prior_without_a_tilt_is_searched_from_the_scans_own(yard):
    scan, point_map, _, truth = yard
    tilted = replace(truth, roll=math.radians(-26.0), pitch=math.radians(25.0))
    held = Scan(truth.apply(scan.points) @ tilted.rotation - tilted.position @ tilted.rotation)
    estimate = MaximumConsensus().localize(held, point_map, replace(truth, x=truth.x + 1.0, roll=0.0, pitch=0.0))
    assert estimate.is_localized, estimate.reason
    np.testing.assert_allclose(estimate.pose.values, tilted.values, atol=0.02)
