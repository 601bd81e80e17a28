# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import re

import numpy as np
import pytest

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.report.plots.distinctness_plot import Distinctnesses, bin_shares, plot_distinctness


def made_up(seed, kurtosis, n=301):
    generator = np.random.default_rng(seed)
    values = np.clip(kurtosis * np.exp(generator.normal(0.0, 0.5, n)), 1.8, 60.0)
    values[::50] = np.nan
    return Distinctnesses(
        generator.beta(5, 3, n), values, generator.gamma(3.0, 4.0, n), generator.choice([0.0, 0.06, 0.12, 3.3], n)
    )


COUNT, HELMERT = made_up(1, 2.0), made_up(2, 14.0)


def words(path):
    """What is written in an SVG: each text is named in a comment before its outlines."""
    return re.findall("<!-- (.*?) -->", path.read_text(encoding="utf-8"))


def test_shares_of_bins_are_of_all_epochs():
    values = np.array([0.0, 0.5, 1.0, 1.9, 2.0, 7.0, -3.0, np.nan, np.nan, np.nan])
    # Lower edges belong to their bins, the last edge too; -3 and 7 fall into the outermost; 3 of 10 are undefined.
    np.testing.assert_allclose(bin_shares(values, np.array([0.0, 1.0, 2.0])), [30.0, 40.0])


def test_shares_of_bins_of_nothing():
    np.testing.assert_array_equal(bin_shares(np.full(4, np.nan), np.array([0.0, 1.0, 2.0])), [0.0, 0.0])


def test_medians_and_the_undefined_are_stated(tmp_path):
    odd = Distinctnesses([0.1, 0.25, 0.9], [2.0, np.nan, 40.0], [1.5, 3.25, 9.0], [0.0, 0.06, 6.0])
    none = Distinctnesses(*(np.full(3, np.nan) for _ in range(4)))
    plot_distinctness(tmp_path / "plot.svg", {"Count": odd, "None": none}, guard_radius=0.45, title="T <1>")
    written = words(tmp_path / "plot.svg")
    for expected in (
        "median 0.25",
        "median 21 (not defined in 1)",
        "median 3.25 nat",
        "median 0.06 m",
        "T &lt;1&gt;",
        "Count",
        "Epochs of each method: 3. Upright lines: medians. Peak ratio: rivals more than 0.45 m away.",
    ):
        assert expected in written
    assert written.count("not defined in any epoch") == 4


def test_each_panel_says_what_is_better(tmp_path):
    plot_distinctness(tmp_path / "plot.svg", {"Count": COUNT})
    written = words(tmp_path / "plot.svg")
    assert written.count("← lower is more distinct") == 3
    title = written.index("Kurtosis along the significant ray")
    assert "higher is more distinct →" in written[title - 2 : title + 3]


def test_pictures_are_as_wide_as_a_page(tmp_path, png_size, svg_root):
    by_method = {"Count": COUNT, "Helmert's score": HELMERT, "$\\frac$": COUNT, "third": HELMERT}
    plot_distinctness(tmp_path / "plot.png", by_method)
    assert png_size(tmp_path / "plot.png")[0] == pytest.approx(1106, abs=1)
    plot_distinctness(tmp_path / "plot.svg", by_method)
    svg_root(tmp_path / "plot.svg")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("values", "n"), [((0.0, 1.0, 0.0, 0.0), 7), ((1.0, 60.0, 35.0, 8.5), 1), ((np.nan,) * 4, 7)])
def test_equal_values_are_drawn(tmp_path, png_size, values, n):
    equal = Distinctnesses(*(np.full(n, value) for value in values))
    plot_distinctness(tmp_path / "plot.png", {"Count": equal})
    assert png_size(tmp_path / "plot.png")[1] > 900


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_same_distinctnesses_give_the_same_bytes(tmp_path, suffix):
    for name in "ab":
        plot_distinctness(tmp_path / f"{name}{suffix}", {"Count": COUNT, "Helmert's score": HELMERT})
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("peak_ratio", 1.2, "`peak_ratio` to be from 0 to 1, got 1.2"),
        ("kurtosis", -1.2, "`kurtosis` to be 1 or more, got -1.2"),
        ("divergence", -0.1, "`divergence` to be"),
        ("spread", np.inf, "`spread` to be 0 or more, got inf"),
    ],
)
def test_measures_keep_to_their_limits(name, value, message):
    right = {"peak_ratio": [0.5], "kurtosis": [3.0], "divergence": [0.0], "spread": [0.0]}
    Distinctnesses(**right)
    with pytest.raises(ArrayError, match=message):
        Distinctnesses(**right | {name: [value]})


def test_epochs_and_methods_must_fit(tmp_path):
    with pytest.raises(ArrayError, match=r"`kurtosis` to have shape \(2,\) as `peak_ratio`, got \(1,\)"):
        Distinctnesses([0.1, 0.2], [3.0], [1.0, 1.0], [0.0, 0.0])
    with pytest.raises(ArrayError, match=r"n > 0, got \(0,\)"):
        Distinctnesses([], [], [], [])
    with pytest.raises(ArrayError, match=r"same epochs of every method, got \[7, 301\]"):
        plot_distinctness(tmp_path / "plot.png", {"Count": COUNT, "Helmert": made_up(1, 2.0, 7)})
    with pytest.raises(OptionError, match="1 to 4 methods, got 5"):
        plot_distinctness(tmp_path / "plot.png", dict.fromkeys("abcde", COUNT))
    with pytest.raises(OptionError, match="to end in"):
        plot_distinctness(tmp_path / "plot.pdf", {"Count": COUNT})
    assert list(tmp_path.iterdir()) == []
