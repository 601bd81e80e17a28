# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import numpy as np
import pytest

import maxcon
from maxcon.errors import ArrayError, OptionError
from maxcon.plotting.canvas.figure import saved_figure
from maxcon.plotting.canvas.from_above import Window, _round_length, count_voxels
from maxcon.plotting.canvas.method_style import (
    METHOD_STYLES,
    LegendShape,
    as_epoch_values,
    check_methods,
    draw_number_ticks,
)


def test_voxels_over_each_square_are_counted():
    points = np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 1.5], [-1.5, 2.5, 0.5], [40.0, 0.0, 0.0]])
    point_map = maxcon.PointMap.from_points(points, np.zeros_like(points), cell=1.0)
    covered, n_voxels = count_voxels(point_map, Window(-2.0, 2.0, -1.0, 3.0))
    expected = np.zeros((4, 4), int)
    expected[1, 2], expected[3, 0] = 2, 1
    np.testing.assert_array_equal(n_voxels, expected)
    assert covered == (-2.0, 2.0, -1.0, 3.0)


def test_large_windows_have_larger_squares(epoch):
    _, n_voxels = count_voxels(epoch.point_map, Window.around(0.0, 0.0, 500.0))
    assert max(n_voxels.shape) <= 701
    assert n_voxels.sum() == len(epoch.point_map.all_voxels()[0])


@pytest.mark.parametrize(("length", "expected"), [(0.7, 0.5), (1.0, 1.0), (4.9, 2.0), (15.0, 10.0), (350.0, 200.0)])
def test_scale_bars_are_of_round_length(length, expected):
    assert _round_length(length) == pytest.approx(expected)


@pytest.mark.parametrize("field", ["color", "line", "marker", "hatch"])
def test_each_mark_alone_tells_the_methods_apart(field):
    assert len({getattr(style, field) for style in METHOD_STYLES}) == 8


def test_one_to_eight_methods_fit_a_picture():
    check_methods(dict.fromkeys("abcdefgh"))
    with pytest.raises(OptionError, match="1 to 8 methods, got 9"):
        check_methods(dict.fromkeys("abcdefghi"))
    with pytest.raises(OptionError, match="1 to 4 methods, got 0"):
        check_methods({}, 4)


@pytest.mark.parametrize(
    ("labels", "expected"),
    [(["a"], (1, 1)), (["a"] * 4, (1, 4)), (["a"] * 5, (2, 3)), (["a" * 40] * 3, (2, 2)), (["a" * 80, "b"], (2, 1))],
)
def test_legends_have_as_many_columns_as_fit(labels, expected):
    assert LegendShape.of(labels, 9.2) == expected


def test_values_are_checked():
    values = as_epoch_values([1, np.nan, 3], "x", 1.0, 3.0)
    np.testing.assert_array_equal(values, [1.0, np.nan, 3.0])
    with pytest.raises(ArrayError, match=r"Expected x to be from 1 to 3, got 3.5. Use NaN"):
        as_epoch_values([1.0, 3.5], "x", 1.0, 3.0)
    with pytest.raises(ArrayError, match="Expected x to be 0 or more, got -1"):
        as_epoch_values([-1.0], "x", 0.0)
    with pytest.raises(ArrayError, match="got inf"):
        as_epoch_values([np.inf], "x", 0.0)
    for wrong in ([], [[1.0]], 1.0):
        with pytest.raises(ArrayError, match=r"to have shape \(n,\), n > 0"):
            as_epoch_values(wrong, "x", 0.0)
    assert as_epoch_values([], "x", 0.0, n_epochs=0).shape == (0,)
    with pytest.raises(ArrayError, match=r"Expected x to have shape \(2,\), got \(1,\)\. Give one value per epoch"):
        as_epoch_values([1.0], "x", 0.0, n_epochs=2)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (1.8, 60.0, ["2", "5", "10", "20", "50"]),
        (0.01, 10.0, ["≤ 0.01", "0.02", "0.05", "0.1", "0.2", "0.5", "1", "2", "5", "10"]),
        (0.02, 50.0, ["0.1", "1", "10"]),
    ],
)
def test_ticks_are_round_numbers(tmp_path, low, high, expected):
    with saved_figure(tmp_path / "ticks.png", 4.0, 1.0) as figure:
        axes = figure.add_subplot()
        axes.set_xscale("log")
        axes.set_xlim(low, high)
        draw_number_ticks(axes.xaxis, low, high, least=0.01)
        assert [label.get_text() for label in axes.get_xticklabels()] == expected
