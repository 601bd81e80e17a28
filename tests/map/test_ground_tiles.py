# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The ground grid of a map: what a cell keeps, and that it comes back from disk as it was ."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import PointMap
from maxcon.errors import MapError
from maxcon.map import TILE_VOXELS
from maxcon.map.ground import HEADROOM, GroundTile, ground_in_memory, ground_of_points, ground_patch, ground_voxels
from maxcon.map.manifest import read_manifest
from maxcon.map.storage import Folder
from maxcon.map.store import GroundStore
from written_maps import write

SEEDS = st.integers(0, 2**32)
CELL = 0.06
WALL = np.array([[1.0, 2.0, 1.0], [31.0, 2.0, 1.0]])


@pytest.mark.parametrize(
    ("cell", "voxels"), [(0.03, 16), (0.06, 8), (0.1, 4), (0.12, 4), (0.5, 1), (3.0, 1), (1e-4, 512)]
)
def test_cells_of_the_ground_are_of_about_half_a_metre_and_make_up_a_tile(cell, voxels):
    assert ground_voxels(cell) == voxels
    assert TILE_VOXELS % voxels == 0


@given(SEEDS, st.integers(0, 300), st.integers(1, 6), st.integers(1, 3))
def test_a_cell_keeps_the_median_of_each_of_its_levels(seed, n, n_cells, n_levels):
    rng = np.random.default_rng(seed)
    columns = rng.integers(0, n_cells, (n, 2))
    heights = (rng.integers(0, n_levels, n) * 5.0 + rng.normal(0.0, 0.1, n)).astype(np.float32)
    stacked = ground_of_points(columns, heights, n_cells)
    for y in range(n_cells):
        for x in range(n_cells):
            here = np.sort(heights[(columns == [x, y]).all(axis=1)])
            levels = np.split(here, np.flatnonzero(np.diff(here) > HEADROOM) + 1) if len(here) else []
            fullest = max((len(level) for level in levels), default=0)
            wanted = [level[(len(level) - 1) // 2] for level in levels if len(level) >= 0.1 * fullest]
            got = stacked[:, y, x]
            np.testing.assert_array_equal(got[np.isfinite(got)], wanted)
            assert np.isfinite(got[: len(wanted)]).all()


def test_a_stray_point_is_no_level():
    columns, heights = np.zeros((21, 2), int), np.array([*np.full(20, 1.0), -4.0])
    assert ground_of_points(columns, heights, 1).tolist() == [[[1.0]]]


@given(SEEDS, st.floats(-70.0, 70.0), st.floats(-70.0, 70.0), st.floats(0.0, 50.0))
def test_a_patch_is_what_the_tiles_hold(seed, x, y, reach):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-80.0, 80.0, (400, 3)) * [1.0, 1.0, 0.01]
    source = ground_in_memory(points, CELL)
    patch = ground_patch(source, CELL, x, y, reach)
    edge = 8 * CELL
    assert patch.edge == edge
    low, high = np.floor((np.array([x, y]) - reach) / edge), np.floor((np.array([x, y]) + reach) / edge)
    assert patch.first == tuple(low)
    assert patch.heights.shape[:0:-1] == tuple(high - low + 1)
    cells = (np.floor(points[:, :2] / CELL) // 8).astype(int)
    expected = {}
    for cell, height in zip(map(tuple, cells.tolist()), points[:, 2].astype(np.float32), strict=True):
        if (low <= cell).all() and (cell <= high).all():
            expected.setdefault((cell[1] - low[1], cell[0] - low[0]), []).append(height)
    got = patch.heights[0]
    assert np.count_nonzero(np.isfinite(got)) == len(expected)
    for (row, column), heights in expected.items():
        assert got[int(row), int(column)] == sorted(heights)[(len(heights) - 1) // 2]


def test_a_map_of_points_has_ground_only_if_it_is_given():
    normals = np.tile([0.0, 1.0, 0.0], (2, 1))
    without = PointMap.from_points(WALL, normals, CELL)
    assert not without.has_ground
    assert np.isnan(without.ground_around(0.0, 0.0, 5.0).heights).all()
    given_ground = PointMap.from_points(WALL, normals, CELL, ground=[[0.1, 0.1, -1.5], [3.0, 0.1, -1.25]])
    assert given_ground.has_ground
    heights = given_ground.ground_around(0.0, 0.0, 5.0).heights
    assert sorted(heights[np.isfinite(heights)].tolist()) == [-1.5, -1.25]


@given(SEEDS, st.integers(1, 200))
def test_rows_of_a_tile_make_it_again(seed, n):
    rng = np.random.default_rng(seed)
    heights = ground_of_points(rng.integers(0, 64, (n, 2)), rng.uniform(-9.0, 9.0, n), 64)
    tile = GroundTile((3, -2), heights)
    columns, values = tile.rows()
    again = GroundTile.from_rows(tile.key, columns, values, 64)
    np.testing.assert_array_equal(again.heights, heights)
    assert tile.n_heights == len(values)


@pytest.fixture
def on_disk(tmp_path):
    """A map on disk with ground in two tiles, and the same ground in memory."""
    rng = np.random.default_rng(0)
    points = rng.uniform(0.0, 60.0, (3000, 3)) * [1.0, 0.4, 0.01] + [0.0, 0.0, 100.0]
    ground = ground_in_memory(points, CELL)
    voxels = PointMap.from_points(WALL, np.tile([0.0, 1.0, 0.0], (2, 1)), CELL)
    write(tmp_path / "some.map", voxels, ground, origin=(0.0, 0.0, 0.0))
    return tmp_path / "some.map", ground


def test_ground_on_disk_is_that_in_memory(on_disk):
    folder, ground = on_disk
    point_map = PointMap.open(folder)
    assert point_map.has_ground
    store = GroundStore(Folder(folder), read_manifest(folder))
    assert store.keys == ground.keys and len(store.keys) == 2
    for key in ground.keys:
        np.testing.assert_array_equal(store.load(key).heights, ground.load(key).heights)
        assert store.load(key) is store.load(key)
    np.testing.assert_array_equal(
        point_map.ground_around(30.0, 10.0, 20.0).heights, ground_patch(ground, CELL, 30.0, 10.0, 20.0).heights
    )


def test_opening_reads_no_ground_and_damage_is_noticed(on_disk):
    folder, _ = on_disk
    point_map = PointMap.open(folder)
    (file,) = (folder / "ground").glob("*.arrows")
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    with pytest.raises(MapError, match="another checksum"):
        PointMap.open(folder).ground_around(30.0, 10.0, 20.0)
    file.unlink()
    with pytest.raises(MapError, match=r"ground.*\.arrows.*No such file"):
        point_map.ground_around(30.0, 10.0, 20.0)
