"""The coarse filter finds what its definition finds, and the definition what a scene made by hand has."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import PointMap, Pose, Scan
from maxcon.relocalization import coarse_filter
from maxcon.relocalization.coarse_map import Circle, CoarseMap
from maxcon.relocalization.kernels import REGION
from maxcon.relocalization.relocalizer import CELL, MOST_COARSE, SAME_COARSE, SAME_COARSE_DEG
from towns import HEIGHT, Town

FEW = coarse_filter.HEADINGS[::15]
T_GROUND_SENSOR = Pose(0.0, 0.0, HEIGHT, 0.0, 0.0, 0.0)
TOWNS = [((0.0, 0.0), 1), ((130.0, -20.0), 5), ((-251.3, 118.8), 9)]


def coarse_scan(town, truth, seed, n_points, thinning=2.0):
    """Some of the points of a scan, as they are counted."""
    scan = coarse_filter.CoarseScan.of(town.scan(truth, seed).thinned(thinning), T_GROUND_SENSOR)
    kept = np.sort(np.random.default_rng(seed).permutation(len(scan))[:n_points])
    return coarse_filter.CoarseScan(scan.points[kept], scan.normals[kept])


def regions_of(point_map):
    return coarse_filter.Regions(CoarseMap(point_map, CELL))


@pytest.fixture(autouse=True, scope="module")
def few_headings():
    """Every 15th heading only: the definition takes its time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coarse_filter, "HEADINGS", FEW)
        yield


def assert_as_defined(scan, regions, ratio, fewest=1.0, **options):
    """The cells that are found, which are those of the definition."""
    found, wanted = (
        coarse_filter.filter_cells(scan, regions, ratio, fewest, **options),
        coarse_filter.count_all(scan, regions, ratio, fewest),
    )
    assert np.array_equal(found.cells, wanted.cells) and np.array_equal(found.counts, wanted.counts)
    assert found.left_out == wanted.left_out
    return found


@pytest.fixture(scope="module")
def towns():
    made = [Town(seed, cell=0.48, middle=middle) for middle, seed in TOWNS]
    return [(town, regions_of(town.map)) for town in made]


@given(
    number=st.integers(0, len(TOWNS) - 1), seed=st.integers(0, 1000), ratio=st.floats(0.3, 1.0),
    fewest=st.sampled_from([1.0, 10.0, 25.0, 41.0]), n_threads=st.integers(1, 3),
)  # fmt: skip
def test_it_finds_the_cells_and_counts_of_the_definition(towns, number, seed, ratio, fewest, n_threads):
    (town, regions), (middle, _) = towns[number], TOWNS[number]
    rng = np.random.default_rng(seed)
    truth = town.pose(*(np.array(middle) + rng.uniform(-20.0, 20.0, 2)), rng.uniform(-3.1, 3.1))
    found = assert_as_defined(coarse_scan(town, truth, seed, 40), regions, ratio, fewest, n_threads=n_threads)
    assert (found.counts >= fewest).all()


def test_it_does_so_in_a_circle(towns):
    town, regions = towns[1]
    scan = coarse_scan(town, town.pose(125.0, -15.0, 0.5), 5, 60)
    found = assert_as_defined(scan, coarse_filter.Regions(regions.map, Circle(140.0, -10.0, 9.0)), 0.5)
    places = (found.cells[:, [2, 1]] + 0.5) * 0.96
    assert len(found) and (np.hypot(*(places - [140.0, -10.0]).T) <= 9.0).all()


def test_without_room_for_all_it_keeps_the_highest_and_says_how_high_others_come(towns, monkeypatch):
    town, regions = towns[0]
    scan = coarse_scan(town, town.pose(3.0, 4.0, 0.1), 6, 40)
    every = coarse_filter.count_all(scan, regions, 0.3)
    monkeypatch.setattr(coarse_filter, "MOST_KEPT", 50)
    found = coarse_filter.filter_cells(scan, regions, 0.3)
    assert len(every) > len(found) >= 50
    assert np.array_equal(found.counts, every.counts[: len(found)])
    assert found.left_out >= every.counts[len(found)] / every.counts[0]


def test_room_for_more_cells_than_the_places_that_are_followed_can_have():
    away, turns = int(SAME_COARSE / CELL), int(SAME_COARSE_DEG / coarse_filter.STEP_DEG)
    steps = np.arange(-away, away + 1)
    n_near = (np.hypot(*np.meshgrid(steps, steps)) * CELL <= SAME_COARSE).sum() * (2 * turns + 1)
    assert (MOST_COARSE + 1) * n_near < coarse_filter.MOST_KEPT  # so that it changes no answer


def a_wall(normal):
    """A map with a wall of one voxel column in the middle of cell (10, 0), 3 m high; and ground."""
    up = np.arange(0.1, 3.0, 0.1)
    points = np.column_stack([np.full((len(up), 2), [10.5 * 0.96, 0.5 * 0.96]), up])
    x, y = (grid.ravel() for grid in np.meshgrid(*2 * [np.arange(-15.0, 15.0, 0.4)]))
    low = np.column_stack([x, y, np.zeros(len(x))])
    return PointMap.from_points(points, np.tile(normal, (len(up), 1)), 0.48, ground=low)


@pytest.mark.parametrize(("normal", "counted"), [((-1.0, 0.0, 0.0), 1), ((1.0, 0.0, 0.0), 0), ((0.0, 0.0, 0.0), 1)])
def test_a_point_counts_where_the_voxel_it_falls_in_has_its_orientation(normal, counted):
    scan = coarse_filter.CoarseScan(np.array([[10.0 * 0.96, 0.0, 1.5]]), np.array([normal]))
    regions = regions_of(a_wall((-1.0, 0.0, 0.0)))
    counts = coarse_filter.counts_of_region(scan, regions, (0, 0))
    ahead = len(FEW) // 2
    assert counts[ahead, 0, 0] == counted
    assert counts[ahead, 0, 1] == 0  # a cell farther on the point falls beyond the wall
    assert counts[ahead, 0, REGION - 1] == -1  # no ground there


def test_a_scanner_that_is_turned_sees_the_wall_elsewhere():
    # 10 cells to the left of the scanner; it stands below the wall, and looks along x.
    scan = coarse_filter.CoarseScan(np.array([[0.0, 10.0 * 0.96, 1.5]]), np.array([[0.0, -1.0, 0.0]]))
    found = coarse_filter.count_all(scan, regions_of(a_wall((0.0, -1.0, 0.0))), 1.0)
    assert [len(FEW) // 2, -10, 10] in found.cells.tolist()
    assert [0, 10, 10] not in found.cells.tolist()  # turned about, its orientation is another
    assert found.counts.tolist() == [1] * len(found)


def test_heights_are_those_above_the_ground():
    level, sloping = Town(8, cell=0.24), Town(8, slope=(0.06, -0.04), cell=0.24)
    scan = coarse_scan(level, level.pose(5.0, 6.0, 0.0), 8, 500)
    on_level, on_slope = (coarse_filter.filter_cells(scan, regions_of(town.map), 0.8) for town in (level, sloping))
    assert on_slope.cells[0].tolist() == on_level.cells[0].tolist()
    assert on_slope.counts[0] > 0.8 * on_level.counts[0]


def test_points_far_off_on_the_ground_or_high_up_do_not_take_part_and_nothing_matches_nothing():
    high = coarse_filter.CoarseScan(np.array([[3.0, 0.0, 25.0]]), np.array([[1.0, 0.0, 0.0]]))
    assert len(assert_as_defined(high, regions_of(a_wall((-1.0, 0.0, 0.0))), 0.6)) == 0
    points = np.array([[5.0, 0.0, -1.7], [100.0, 0.0, 1.0], [5.0, 0.0, 40.0], [5.0, 0.0, 1.0]])
    scan = coarse_filter.CoarseScan.of(Scan(points, np.zeros((4, 3))), T_GROUND_SENSOR)
    assert scan.points.tolist() == [[5.0, 0.0, 1.0 + HEIGHT]]
