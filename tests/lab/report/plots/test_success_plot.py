# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import re

import numpy as np
import pytest

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.report.plots.success_plot import SuccessBins, _checked_width, plot_success

GENERATOR = np.random.default_rng(6)
OFFSETS = np.hypot(*GENERATOR.uniform(-3.0, 3.0, (2, 400)))
METHODS = [f"method {number}" for number in range(8)]
SUCCESS = {name: GENERATOR.random(400) < 1.0 - 0.1 * number for number, name in enumerate(METHODS)}


def words(path):
    """What is written in an SVG: each text is named in a comment before its outlines."""
    return re.findall("<!-- (.*?) -->", path.read_text(encoding="utf-8"))


def test_epochs_are_counted_by_distance():
    offsets = np.array([0.0, 0.49, 0.5, 0.99, 1.6, 1.5])
    bins = SuccessBins.of(offsets, np.array([True, False, True, True, False, False]), 0.5, 5)
    np.testing.assert_array_equal(bins.n_epochs, [2, 2, 0, 2, 0])
    np.testing.assert_array_equal(bins.n_successes, [1, 2, 0, 0, 0])


def test_numbers_and_rates_are_stated(tmp_path):
    offsets = {"Count": [0.1, 0.2, 1.2], "Helmert": [0.1, 0.2, 1.2]}
    success = {"Helmert": [True, True, True], "Count": [False, True, False]}
    plot_success(tmp_path / "plot.svg", offsets, success, criterion="within reach")
    written = words(tmp_path / "plot.svg")
    assert {"Count: 33.3 %", "Helmert: 100.0 %"} <= set(written)
    assert "Success: within reach. Bins of 0.5 m; bars: Wilson's 95 % intervals." in written
    place = written.index("epochs")
    assert written[place - 3 : place] == ["2", "0", "1"]


def test_methods_with_other_epochs_have_rows_of_their_own(tmp_path, png_size):
    shared = {"Count": OFFSETS, "Helmert": OFFSETS}
    apart = {"Count": OFFSETS, "Helmert": OFFSETS[:300]}
    success = {name: np.ones(400, bool) for name in shared}
    plot_success(tmp_path / "shared.png", shared, success)
    plot_success(tmp_path / "apart.png", apart, success | {"Helmert": np.ones(300, bool)})
    assert png_size(tmp_path / "apart.png")[1] > png_size(tmp_path / "shared.png")[1]


@pytest.mark.parametrize(
    ("farthest", "expected"), [(0.0, 0.5), (9.99, 0.5), (10.0, 1.0), (39.0, 2.0), (99.0, 5.0), (350.0, 20.0)]
)
def test_bins_are_of_round_width(farthest, expected):
    assert _checked_width(farthest, None) == expected


@pytest.mark.filterwarnings("error")
def test_eight_methods_and_empty_bins_are_drawn(tmp_path, png_size, svg_root):
    plot_success(tmp_path / "plot.png", dict.fromkeys(METHODS, OFFSETS), SUCCESS)
    assert png_size(tmp_path / "plot.png")[0] == 1104
    plot_success(tmp_path / "gap.svg", {"$\\frac$": [0.1, 3.0]}, {"$\\frac$": [False, False]}, title="<b> & $x$")
    svg_root(tmp_path / "gap.svg")


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_same_successes_give_the_same_bytes(tmp_path, suffix):
    for name in "ab":
        plot_success(tmp_path / f"{name}{suffix}", dict.fromkeys(METHODS, OFFSETS), SUCCESS)
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_wrong_successes_are_refused(tmp_path):
    def draw(offsets, success, **options):
        plot_success(tmp_path / "plot.png", {"a": offsets}, {"a": success}, **options)

    with pytest.raises(ArrayError, match=r"booleans of shape \(1,\), got int64 of shape \(1,\)"):
        draw([1.0], [1])
    with pytest.raises(ArrayError, match=r"booleans of shape \(2,\), got bool of shape \(1,\)"):
        draw([1.0, 2.0], [True])
    with pytest.raises(ArrayError, match="offsets of 'a' to be 0 or more, got -1"):
        draw([-1.0], [True])
    with pytest.raises(ArrayError, match="offsets of 'a' to be finite, got NaN"):
        draw([np.nan], [True])
    with pytest.raises(ArrayError, match="n > 0"):
        draw([], [])
    for width in (0.0, -1.0, np.nan, 0.1):
        with pytest.raises(OptionError, match=r"at most 20 bins up to 4 m, got .*Use 0.5"):
            draw([4.0], [True], bin_width=width)
    with pytest.raises(OptionError, match=r"same methods, got \['a'\] and \['b'\]"):
        plot_success(tmp_path / "plot.png", {"a": [1.0]}, {"b": [True]})
    with pytest.raises(OptionError, match="1 to 8 methods, got 0"):
        plot_success(tmp_path / "plot.png", {}, {})
    assert list(tmp_path.iterdir()) == []
