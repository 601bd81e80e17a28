# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import numpy as np
import pytest

import maxcon
from maxcon.plotting.canvas.from_above import MapFromAbove, Window, _round_length


def test_voxels_over_each_square_are_counted():
    points = np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 1.5], [-1.5, 2.5, 0.5], [40.0, 0.0, 0.0]])
    point_map = maxcon.PointMap.from_points(points, np.zeros_like(points), cell=1.0)
    seen = MapFromAbove.look(point_map, Window(-2.0, 2.0, -1.0, 3.0))
    expected = np.zeros((4, 4), int)
    expected[1, 2], expected[3, 0] = 2, 1
    np.testing.assert_array_equal(seen.n_voxels, expected)
    assert seen.window == (-2.0, 2.0, -1.0, 3.0)


def test_large_windows_have_larger_squares(epoch):
    seen = MapFromAbove.look(epoch.point_map, Window.around(0.0, 0.0, 500.0))
    assert max(seen.n_voxels.shape) <= 701
    assert seen.n_voxels.sum() == len(epoch.point_map.all_voxels()[0])


@pytest.mark.parametrize(("length", "expected"), [(0.7, 0.5), (1.0, 1.0), (4.9, 2.0), (15.0, 10.0), (350.0, 200.0)])
def test_scale_bars_are_of_round_length(length, expected):
    assert _round_length(length) == pytest.approx(expected)
