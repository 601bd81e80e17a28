# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The sieve finds what its definition finds, and the definition what a scene made by hand has."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from towns import HEIGHT, Town

from maxcon import PointMap, Pose, Scan
from maxcon.relocalization import reference, sieve
from maxcon.relocalization.coarse_tiles import CoarseTiles
from maxcon.relocalization.reference import counts_of_region
from maxcon.relocalization.reference import sift as sift_by_definition
from maxcon.relocalization.regions import REGION, Area, Regions
from maxcon.relocalization.sieve import sift
from maxcon.relocalization.sieve_scan import SieveScan
from maxcon.relocalization.sifted import HEADINGS
from maxcon.search.coarse_to_fine import Level

LEVEL = Level(0.96, 2.0, 2.0)
FEW = HEADINGS[::15]
UPRIGHT = Pose(0.0, 0.0, HEIGHT, 0.0, 0.0, 0.0)


def sieved(town, truth, seed, n_points, thinning=2.0):
    """Some of the points of a scan, as they are counted."""
    scan = SieveScan.of(town.scan(truth, seed).thinned(thinning), UPRIGHT, 30.0)
    kept = np.sort(np.random.default_rng(seed).permutation(len(scan))[:n_points])
    return SieveScan(scan.points[kept], scan.normals[kept])


@pytest.fixture(autouse=True, scope="module")
def few_headings():
    """Every 15th heading only: the definition takes its time."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (sieve, reference):
            patch.setattr(module, "HEADINGS", FEW)
        yield


def assert_same(found, wanted):
    assert np.array_equal(found.cells, wanted.cells)
    assert np.array_equal(found.counts, wanted.counts)
    assert found.left_out == wanted.left_out


@settings(max_examples=6)
@given(
    seed=st.integers(0, 1000),
    middle=st.tuples(st.floats(-260.0, 260.0), st.floats(-260.0, 260.0)),
    share=st.floats(0.3, 1.0),
    n_threads=st.integers(1, 3),
)
def test_it_finds_the_cells_and_counts_of_the_definition(seed, middle, share, n_threads):
    town = Town(seed, cell=0.48, middle=middle)
    rng = np.random.default_rng(seed)
    truth = town.pose(*(np.array(middle) + rng.uniform(-20.0, 20.0, 2)), rng.uniform(-3.1, 3.1))
    scan, regions = sieved(town, truth, seed, 40), Regions(CoarseTiles(town.map, LEVEL))
    assert_same(sift(scan, regions, share, n_threads=n_threads), sift_by_definition(scan, regions, share))


def test_it_does_so_in_a_circle():
    town = Town(5, cell=0.48, middle=(130.0, -20.0))
    scan = sieved(town, town.pose(125.0, -15.0, 0.5), 5, 60)
    regions = Regions(CoarseTiles(town.map, LEVEL)).within(Area(140.0, -10.0, 9.0))
    found = sift(scan, regions, 0.5)
    assert_same(found, sift_by_definition(scan, regions, 0.5))
    places = (found.cells[:, [2, 1]] + 0.5) * 0.96
    assert len(found)
    assert (np.hypot(*(places - [140.0, -10.0]).T) <= 9.0).all()


def test_without_room_for_all_it_keeps_the_highest_and_says_how_high_others_come(monkeypatch):
    town = Town(6, cell=0.48)
    scan, regions = sieved(town, town.pose(3.0, 4.0, 0.1), 6, 40), Regions(CoarseTiles(town.map, LEVEL))
    every = sift_by_definition(scan, regions, 0.3)
    monkeypatch.setattr(sieve, "MOST_KEPT", 50)
    found = sift(scan, regions, 0.3)
    assert len(every) > len(found) >= 50
    assert np.array_equal(found.counts, every.counts[: len(found)])
    assert found.left_out >= every.counts[len(found)] / every.counts[0]


def a_wall(facing):
    """A map with a wall of one voxel column in the middle of cell (10, 0), 3 m high; and ground."""
    up = np.arange(0.1, 3.0, 0.1)
    points = np.column_stack([np.full((len(up), 2), [10.5 * 0.96, 0.5 * 0.96]), up])
    low = np.column_stack(
        [*(grid.ravel() for grid in np.meshgrid(*2 * [np.arange(-15.0, 15.0, 0.4)])), np.zeros(75**2)]
    )
    return PointMap.from_points(points, np.tile(facing, (len(up), 1)), 0.48, ground=low)


@pytest.mark.parametrize(("normal", "counted"), [((-1.0, 0.0, 0.0), 1), ((1.0, 0.0, 0.0), 0), ((0.0, 0.0, 0.0), 1)])
def test_a_point_counts_where_the_voxel_it_falls_in_faces_as_it_does(normal, counted):
    point_map = a_wall((-1.0, 0.0, 0.0))
    scan = SieveScan(np.array([[10.0 * 0.96, 0.0, 1.5]]), np.array([normal]))
    regions = Regions(CoarseTiles(point_map, LEVEL))
    counts = counts_of_region(scan, regions.load((0, 0)), regions.tiles.cell)
    ahead = len(FEW) // 2
    assert counts[ahead, 0, 0] == counted
    assert counts[ahead, 0, 1] == 0  # a cell farther on the point falls beyond the wall
    assert counts[ahead, 0, REGION - 1] == -1  # no ground there


def test_a_scanner_that_is_turned_sees_the_wall_elsewhere():
    regions = Regions(CoarseTiles(a_wall((0.0, -1.0, 0.0)), LEVEL))
    # 10 cells to the left of the scanner; it stands below the wall, and looks along x.
    scan = SieveScan(np.array([[0.0, 10.0 * 0.96, 1.5]]), np.array([[0.0, -1.0, 0.0]]))
    found = sift_by_definition(scan, regions, 1.0)
    assert [len(FEW) // 2, -10, 10] in found.cells.tolist()
    assert [0, 10, 10] not in found.cells.tolist()  # turned about, its facing is another
    assert found.counts.tolist() == [1] * len(found)


def test_nothing_above_the_ground_matches_nothing():
    regions = Regions(CoarseTiles(a_wall((-1.0, 0.0, 0.0)), LEVEL))
    scan = SieveScan(np.array([[3.0, 0.0, 25.0]]), np.array([[1.0, 0.0, 0.0]]))
    for found in (sift(scan, regions, 0.6), sift_by_definition(scan, regions, 0.6)):
        assert len(found) == 0


def test_the_best_cell_is_where_the_scan_was_taken():
    town = Town(7)
    truth = town.pose(8.3, -4.1, math.radians(121.0))
    found = sift(sieved(town, truth, 7, 1000), Regions(CoarseTiles(town.map, LEVEL)), 0.6)
    heading, y, x = found.cells[0]
    assert math.hypot((x + 0.5) * 0.96 - truth.x, (y + 0.5) * 0.96 - truth.y) < 1.4
    assert math.cos(FEW[heading] - truth.heading) > math.cos(math.radians(2.5))


def test_heights_are_those_above_the_ground():
    level, sloping = Town(8), Town(8, slope=(0.06, -0.04))
    truth = level.pose(5.0, 6.0, 0.0)
    scan = sieved(level, truth, 8, 500)
    on_slope = sift(scan, Regions(CoarseTiles(sloping.map, LEVEL)), 0.8)
    on_level = sift(scan, Regions(CoarseTiles(level.map, LEVEL)), 0.8)
    assert on_slope.cells[0].tolist() == on_level.cells[0].tolist()
    assert on_slope.counts[0] > 0.8 * on_level.counts[0]


def test_a_scan_of_points_that_do_not_take_part_is_empty():
    points = np.array([[5.0, 0.0, -1.7], [100.0, 0.0, 1.0], [5.0, 0.0, 40.0], [5.0, 0.0, 1.0]])
    scan = SieveScan.of(Scan(points, np.zeros((4, 3))), UPRIGHT, 30.0)
    assert scan.points.tolist() == [[5.0, 0.0, 1.0 + HEIGHT]]
