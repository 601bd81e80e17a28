"""The ground grid of a map: what a cell keeps, and that it comes back from disk as it was."""

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
from maxcon.map.store import stored_ground

SEEDS = st.integers(0, 2**32)
CELL = 0.06


@pytest.mark.parametrize(("cell", "voxels"), [(0.03, 16), (0.06, 8), (0.1, 4), (3.0, 1), (1e-4, 512)])
def test_cells_of_the_ground_are_of_about_half_a_metre_and_make_up_a_tile(cell, voxels):
    assert ground_voxels(cell) == voxels and TILE_VOXELS % voxels == 0


@given(SEEDS, st.integers(0, 300), st.integers(1, 6), st.integers(1, 3))
def test_a_cell_keeps_the_median_of_each_of_its_levels_and_a_tile_all_of_them(seed, n, n_cells, n_levels):
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
    tile = GroundTile((3, -2), stacked)
    rows = tile.rows()
    np.testing.assert_array_equal(GroundTile.from_rows(tile.key, *rows, n_cells).heights, stacked)
    assert tile.n_heights == len(rows[1])
    stray = np.array([*np.full(20, 1.0), -4.0])  # a single point is no level
    assert ground_of_points(np.zeros((21, 2), int), stray, 1).tolist() == [[[1.0]]]


@given(SEEDS, st.floats(-70.0, 70.0), st.floats(-70.0, 70.0), st.floats(0.0, 50.0))
def test_a_patch_is_what_the_tiles_hold(seed, x, y, reach):
    points = np.random.default_rng(seed).uniform(-80.0, 80.0, (150, 3)) * [1.0, 1.0, 0.01]
    patch = ground_patch(ground_in_memory(points, CELL), CELL, x, y, reach)
    edge = 8 * CELL
    low, high = np.floor((np.array([x, y]) - reach) / edge), np.floor((np.array([x, y]) + reach) / edge)
    assert (patch.edge, patch.first) == (edge, tuple(low))
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
    wall, normals = [[1.0, 2.0, 1.0], [31.0, 2.0, 1.0]], np.tile([0.0, 1.0, 0.0], (2, 1))
    without = PointMap.from_points(wall, normals, CELL)
    assert not without.has_ground and np.isnan(without.ground_around(0.0, 0.0, 5.0).heights).all()
    given_ground = PointMap.from_points(wall, normals, CELL, ground=[[0.1, 0.1, -1.5], [3.0, 0.1, -1.25]])
    assert given_ground.has_ground
    heights = given_ground.ground_around(0.0, 0.0, 5.0).heights
    assert sorted(heights[np.isfinite(heights)].tolist()) == [-1.5, -1.25]


def test_ground_on_disk_is_that_in_memory_read_when_asked_for_and_checked(copy, in_memory):
    opened, ground = PointMap.open(copy), in_memory._ground
    store = stored_ground(Folder(copy), read_manifest(copy))
    assert opened.has_ground and store.keys == ground.keys and len(store.keys) > 1
    for key in ground.keys:
        np.testing.assert_array_equal(store.load(key).heights, ground.load(key).heights)
        assert store.load(key) is store.load(key)
    (file,) = (copy / "ground").glob("*.arrows")
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    with pytest.raises(MapError, match="another checksum"):
        PointMap.open(copy).ground_around(0.0, 0.0, 60.0)
    file.unlink()
    with pytest.raises(MapError, match=r"ground.*\.arrows.*No such file"):
        opened.ground_around(30.0, 10.0, 20.0)
