# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A level of a map is the map in larger voxels: the same points, their means and mean normals."""

from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import PointMap
from maxcon.errors import OptionError
from maxcon.map import TILE_VOXELS
from maxcon.map.layout import MEAN_STEPS
from maxcon.map.voxelize import CANCELLED_LENGTH


def a_map(seed: int, *, is_signed: bool, n_points: int = 400, reach: float = 40.0) -> PointMap:
    """Points in clumps over a few tiles, some without a normal."""
    rng = np.random.default_rng(seed)
    middles = rng.uniform(-reach, reach, (12, 3)) * [1.0, 1.0, 0.05]
    points = middles[rng.integers(0, 12, n_points)] + rng.normal(0.0, 0.15, (n_points, 3))
    normals = rng.normal(size=(n_points, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[rng.random(n_points) < 0.2] = 0.0
    return PointMap.from_points(points, normals, is_signed=is_signed)


def merged_one_by_one(point_map: PointMap, factor: int) -> dict[tuple[int, int, int], tuple]:
    """The definition: voxel by voxel of the map, in the order of its tiles."""
    n_points, sums, totals = (defaultdict(int), defaultdict(lambda: np.zeros(3)), defaultdict(lambda: np.zeros(3)))
    for key in sorted(point_map.tile_keys):
        tile = point_map.tile(key)
        for voxel, count, normal, mean in zip(tile.voxels, tile.counts, tile.normals, tile.means, strict=True):
            larger = tuple((voxel // factor).tolist())
            normal = normal.astype(np.float64)
            if not point_map.is_signed and sums[larger] @ normal < 0.0:
                normal = -normal
            n_points[larger] += int(count)
            sums[larger] += count * normal
            totals[larger] += count * (voxel % factor + (mean + 0.5) / MEAN_STEPS)
    found = {}
    for voxel, n in n_points.items():
        length = np.linalg.norm(sums[voxel])
        normal = sums[voxel] / length if length > CANCELLED_LENGTH * n else np.zeros(3)
        found[voxel] = (n, normal, totals[voxel] / (n * factor))
    return found


@given(seed=st.integers(0, 10_000), factor=st.sampled_from([2, 4, 8, 32]), is_signed=st.booleans())
def test_a_level_is_what_voxel_by_voxel_gives(seed: int, factor: int, is_signed: bool) -> None:
    point_map = a_map(seed, is_signed=is_signed)
    level, expected = point_map.level(factor), merged_one_by_one(point_map, factor)
    n_found = 0
    for key in level.tile_keys:
        tile = level.tile(key)
        assert tile.is_in_order
        assert tile.edge == TILE_VOXELS // factor
        for voxel, count, normal, mean in zip(tile.voxels, tile.counts, tile.normals, tile.means, strict=True):
            n, expected_normal, expected_mean = expected[tuple(voxel.tolist())]
            assert count == n
            np.testing.assert_allclose(normal, expected_normal, atol=1e-6)
            np.testing.assert_allclose((mean + 0.5) / MEAN_STEPS, expected_mean, atol=0.51 / MEAN_STEPS)
            n_found += 1
    assert n_found == len(expected)


def test_a_level_has_the_edges_of_its_voxels_and_the_ground_of_its_tiles() -> None:
    point_map = a_map(1, is_signed=True)
    level = point_map.level(8)
    assert level.cell == pytest.approx(0.48)
    assert level.tile_keys == point_map.tile_keys
    np.testing.assert_allclose(level.bounds, point_map.bounds)
    assert level is point_map.level(8)
    assert point_map.level(1) is point_map


@pytest.mark.parametrize("factor", [0, -2, 3, 64])
def test_voxels_that_do_not_fill_a_patch_are_refused(factor: int) -> None:
    with pytest.raises(OptionError, match=rf"2, 4, \.\.\. or 32 times as large as the map's, got {factor}\."):
        a_map(1, is_signed=True).level(factor)


def test_tiles_that_are_not_kept_any_more_are_merged_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("maxcon.map.point_map.LEVEL_BYTES", 1)
    level = a_map(2, is_signed=True).level(4)
    first, again = ([level.tile(key) for key in sorted(level.tile_keys)] for _ in range(2))
    assert len(first) > 1
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.voxels, other.voxels)
        np.testing.assert_array_equal(one.normals, other.normals)
