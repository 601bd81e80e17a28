# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.report.plots.errors_plot import plot_error_shares, shares_within

GENERATOR = np.random.default_rng(4)
ERRORS = {f"method {number}": GENERATOR.rayleigh(0.03 + 0.02 * number, 301) for number in range(8)}


def words(path):
    """What is written in an SVG: each text is named in a comment before its outlines."""
    return re.findall("<!-- (.*?) -->", path.read_text(encoding="utf-8"))


def test_shares_are_of_all_epochs():
    errors = np.array([0.3, np.nan, 0.1, 4.0, 0.1])
    limits = np.array([0.0, 0.0999, 0.1, 0.3, 10.0])
    np.testing.assert_allclose(shares_within(errors, limits), [0.0, 0.0, 40.0, 60.0, 80.0])


@given(st.lists(st.floats(0.0, 20.0) | st.just(np.nan), min_size=1), st.floats(0.0, 20.0))
def test_shares_count_what_they_say(errors, limit):
    expected = 100.0 * sum(error <= limit for error in errors) / len(errors)
    assert shares_within(np.array(errors), np.array([limit]))[0] == pytest.approx(expected)


def test_legend_states_the_share_within_the_limit(tmp_path):
    errors = {"Count": [0.1, 0.5, np.nan, np.nan], "Helmert": [0.1, 0.2, 0.25, 0.26]}
    plot_error_shares(tmp_path / "plot.svg", errors, success=0.25, title="T")
    written = words(tmp_path / "plot.svg")
    assert "Count: 25.0 %, 2 without an answer" in written
    assert "Helmert: 75.0 %" in written
    assert "Epochs: 4, those without an answer too. Dashed: success, 0.25 m. Below: shares within it." in written


def test_eight_methods_fit(tmp_path, png_size, svg_root):
    plot_error_shares(tmp_path / "plot.png", ERRORS)
    assert png_size(tmp_path / "plot.png")[0] == 1104
    plot_error_shares(tmp_path / "plot.svg", ERRORS | {"method 7": np.zeros(301)}, title="<b> & $x$")
    svg_root(tmp_path / "plot.svg")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("values", [[0.0], [50.0], [np.nan], [0.2] * 9, [0.0, 0.01, 10.0, np.nan, 1e9]])
def test_few_and_equal_errors_are_drawn(tmp_path, png_size, values):
    plot_error_shares(tmp_path / "plot.png", {"$\\frac$": values})
    assert png_size(tmp_path / "plot.png")[0] == 1104


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_same_errors_give_the_same_bytes(tmp_path, suffix):
    for name in "ab":
        plot_error_shares(tmp_path / f"{name}{suffix}", ERRORS)
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_wrong_errors_are_refused(tmp_path):
    with pytest.raises(ArrayError, match="errors of 'Count' to be 0 or more, got -1"):
        plot_error_shares(tmp_path / "plot.png", {"Count": [-1.0]})
    with pytest.raises(ArrayError, match="errors of 'Count' to have shape"):
        plot_error_shares(tmp_path / "plot.png", {"Count": []})
    with pytest.raises(ArrayError, match=r"same epochs of every method, got \[1, 2\]"):
        plot_error_shares(tmp_path / "plot.png", {"Count": [1.0], "Helmert": [1.0, 1.0]})
    with pytest.raises(OptionError, match="1 to 8 methods, got 0"):
        plot_error_shares(tmp_path / "plot.png", {})
    assert list(tmp_path.iterdir()) == []
