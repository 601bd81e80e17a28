# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import sys

import matplotlib
import numpy as np
import pytest

import maxcon
from drawn_figures import yard
from maxcon.errors import ArrayError, FileError, MissingExtraError, OptionError
from maxcon.plotting.figure import (
    METHOD_STYLES,
    LegendShape,
    add_axes,
    as_epoch_values,
    check_count,
    draw_number_ticks,
    saved_figure,
)
from maxcon.plotting.from_above import Window, count_voxels, round_length


def draw(path):
    with saved_figure(path, 4.0, 1.0, "T", "words") as figure:
        add_axes(figure, 0.5, 0.3, 3.0, 0.5).imshow([[0.0, 1.0]])


def test_users_own_settings_change_nothing_and_are_left_alone(tmp_path):
    draw(tmp_path / "a.png")
    with matplotlib.rc_context({"font.size": 30.0, "image.cmap": "jet", "axes.grid": True}):
        draw(tmp_path / "b.png")
        assert matplotlib.rcParams["font.size"] == 30.0
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(FileError, match="Check the folder"):
        draw(tmp_path / "missing" / "a.png")


def test_nothing_is_left_behind_when_writing_fails(tmp_path, monkeypatch):
    from matplotlib.figure import Figure

    def half_written(self, path, **options):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", half_written)
    with pytest.raises(FileError, match="No space left on device"):
        draw(tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []


def test_without_matplotlib_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'maxcon\[demo\]'"):
        draw(tmp_path / "a.png")


def test_voxels_over_each_square_are_counted():
    points = np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 1.5], [-1.5, 2.5, 0.5], [40.0, 0.0, 0.0]])
    point_map = maxcon.PointMap.from_points(points, np.zeros_like(points), cell=1.0)
    covered, n_voxels = count_voxels(point_map, Window(-2.0, 2.0, -1.0, 3.0))
    expected = np.zeros((4, 4), int)
    expected[1, 2], expected[3, 0] = 2, 1
    np.testing.assert_array_equal(n_voxels, expected)
    assert covered == (-2.0, 2.0, -1.0, 3.0)


def test_large_windows_have_larger_squares():
    _, n_voxels = count_voxels(yard().point_map, Window.around(0.0, 0.0, 500.0))
    assert max(n_voxels.shape) <= 701
    assert n_voxels.sum() == len(yard().point_map.all_voxels()[0])


@pytest.mark.parametrize(("length", "expected"), [(0.7, 0.5), (1.0, 1.0), (4.9, 2.0), (15.0, 10.0), (350.0, 200.0)])
def test_scale_bars_are_ofround_length(length, expected):
    assert round_length(length) == pytest.approx(expected)


@pytest.mark.parametrize("field", ["color", "line", "marker", "hatch"])
def test_each_mark_alone_tells_the_methods_apart(field):
    assert len({getattr(style, field) for style in METHOD_STYLES}) == 8


def test_one_to_eight_methods_fit_a_picture():
    check_count(8, 8, "methods")
    for n_given in (0, 9):
        with pytest.raises(OptionError, match=f"1 to 8 methods, got {n_given}. Draw several"):
            check_count(n_given, 8, "methods")


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
    with saved_figure(tmp_path / "ticks.png", 4.0, 1.0, "", "") as figure:
        axes = figure.add_subplot()
        axes.set_xscale("log")
        axes.set_xlim(low, high)
        draw_number_ticks(axes.xaxis, low, high, least=0.01)
        assert [label.get_text() for label in axes.get_xticklabels()] == expected
