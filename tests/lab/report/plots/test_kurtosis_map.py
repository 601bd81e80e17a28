# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import re

import numpy as np
import pytest

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.report.plots.kurtosis_map import color_limits, plot_kurtosis_map, spaced_epochs

ALONG = np.linspace(-8.0, 8.0, 300)
POSITIONS = np.column_stack([ALONG, 2.0 * np.sin(ALONG)])
COUNT, HELMERT = 1.8 + 0.1 * np.abs(ALONG), 10.0 + 5.0 * np.abs(ALONG)


def words(path):
    """What is written in an SVG: each text is named in a comment before its outlines."""
    return re.findall("<!-- (.*?) -->", path.read_text(encoding="utf-8"))


def test_epochs_keep_their_distance():
    # It stands at 0, goes to 3, and comes back over its own way.
    x = np.array([0.0, 0.0, 0.0, 0.9, 1.0, 1.9, 2.0, 3.0, 2.5, 1.5, 0.5, -1.0])
    chosen = spaced_epochs(np.column_stack([x, np.zeros(12)]), 1.0)
    np.testing.assert_array_equal(chosen, [0, 4, 6, 7, 11])


@pytest.mark.parametrize(
    ("values", "expected"), [([3.0, np.nan, 7.0], (3.0, 7.0)), ([4.0, 4.0], (3.2, 5.0)), ([np.nan], (1.0, 10.0))]
)
def test_colors_span_the_values(values, expected):
    assert color_limits(np.array(values)) == pytest.approx(expected)


def test_medians_and_thinning_are_stated(tmp_path):
    # 100 m x 50 m of window: 6.6 inches for 100 m, so circles of 13 points need 1.04 * 13 / 72 * 100 / 6.6 m.
    x = np.linspace(0.0, 50.0, 501)
    small = np.where(np.arange(501) == 7, np.nan, 2.5)
    path = tmp_path / "map.svg"
    plot_kurtosis_map(path, np.column_stack([x, 0.0 * x]), small, np.full(501, 25.0), names=("A", "B"))
    written = words(path)
    assert "Medians of all epochs: A 2.5; B 25." in written
    assert "18 of 501 epochs shown, 2.8 m apart or more." in written
    assert {"large: B", "small: A", "kurtosis", "5", "10", "20"} <= set(written)
    assert "white: not defined" not in written


def test_the_undefined_are_explained(tmp_path):
    path = tmp_path / "map.svg"
    plot_kurtosis_map(path, POSITIONS, np.full(300, np.nan), HELMERT)
    written = words(path)
    assert "white: not defined" in written
    assert any("Count not defined" in line for line in written)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("values", "n"), [((3.0, 3.0), 1), ((1.8, 60.0), 300), ((np.nan, np.nan), 300)])
def test_equal_values_are_drawn_on_a_map(tmp_path, epoch, png_size, values, n):
    small, large = (np.full(n, value) for value in values)
    plot_kurtosis_map(tmp_path / "map.png", POSITIONS[:n], small, large, point_map=epoch.point_map)
    assert png_size(tmp_path / "map.png")[0] > 800


def test_kurtosis_maps_keep_their_proportions(tmp_path, png_size, svg_root):
    far = POSITIONS * 50.0
    plot_kurtosis_map(tmp_path / "x.png", np.column_stack([far, ALONG]), COUNT, HELMERT)
    plot_kurtosis_map(tmp_path / "y.png", far[:, ::-1], COUNT, HELMERT)
    (x_width, x_height), (y_width, y_height) = (png_size(tmp_path / f"{name}.png") for name in "xy")
    assert x_width > x_height and y_height > y_width
    plot_kurtosis_map(tmp_path / "map.svg", far, COUNT, HELMERT, names=("$\\frac$", "<&>"), title="$x$ <b>")
    svg_root(tmp_path / "map.svg")


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_same_kurtoses_give_the_same_bytes(tmp_path, epoch, suffix):
    for name in "ab":
        plot_kurtosis_map(tmp_path / f"{name}{suffix}", POSITIONS, COUNT, HELMERT, point_map=epoch.point_map)
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_wrong_kurtoses_are_refused(tmp_path):
    path = tmp_path / "map.png"
    for positions in (np.empty((0, 2)), np.zeros((3, 4)), np.full((3, 2), np.nan), np.zeros(3)):
        with pytest.raises(ArrayError, match="Expected `positions` to have shape"):
            plot_kurtosis_map(path, positions, [3.0] * 3, [3.0] * 3)
    with pytest.raises(ArrayError, match=r"`kurtosis_small` to have shape \(2,\), got \(1,\)"):
        plot_kurtosis_map(path, POSITIONS[:2], [3.0], [3.0, 3.0])
    with pytest.raises(ArrayError, match=r"`kurtosis_large` to be 1 or more, got 0\.5"):
        plot_kurtosis_map(path, POSITIONS[:2], [3.0, 3.0], [3.0, 0.5])
    with pytest.raises(OptionError, match="to end in"):
        plot_kurtosis_map(tmp_path / "map.pdf", POSITIONS, COUNT, HELMERT)
    assert list(tmp_path.iterdir()) == []
