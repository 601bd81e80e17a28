# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import re

import numpy as np
import pytest

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.evaluation import RiskCoverage
from maxcon.lab.report.plots.risk_coverage_plot import _set_apart, plot_risk_coverage

GENERATOR = np.random.default_rng(6)


def found(n_epochs, n_trusted, n_wrong):
    """So many epochs, the first of them trusted and the very first wrong."""
    place = np.arange(n_epochs)
    return RiskCoverage.of(place >= n_wrong, np.ones(n_epochs), place < n_trusted, GENERATOR.random(n_epochs))


def test_legend_says_how_many_of_the_trusted_are_wrong(tmp_path):
    plot_risk_coverage(tmp_path / "plot.svg", {"maxcon": found(1200, 1100, 0), "gicp-3m": found(1200, 1000, 7)})
    written = re.findall("<!-- (.*?) -->", (tmp_path / "plot.svg").read_text(encoding="utf-8"))
    assert "maxcon: 0 of 1,100" in written
    assert "gicp-3m: 7 of 1,000" in written


def test_bars_that_would_lie_on_each_other_are_set_apart():
    methods = [found(100, 100, 0), found(100, 50, 0), found(100, 100, 0), found(100, 100, 0), found(100, 0, 0)]
    np.testing.assert_allclose(_set_apart(methods, 10.0), [100.0, 50.0, 99.2, 100.8, np.nan])
    assert _set_apart([found(1000, 1000, 0), found(1000, 1000, 500)], 80.0) == [100.0, 100.0]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("n_epochs", "n_trusted", "n_wrong"), [(1, 0, 1), (1, 1, 0), (30, 30, 30), (3001, 2900, 3)])
def test_few_and_many_epochs_are_drawn(tmp_path, png_size, n_epochs, n_trusted, n_wrong):
    plot_risk_coverage(tmp_path / "plot.png", {"$\\frac$": found(n_epochs, n_trusted, n_wrong)})
    assert png_size(tmp_path / "plot.png")[0] == 1104


def test_what_cannot_be_drawn_is_refused(tmp_path):
    with pytest.raises(OptionError, match="1 to 8 methods, got 0"):
        plot_risk_coverage(tmp_path / "plot.png", {})
    with pytest.raises(ArrayError, match="epochs of 'a', got none"):
        plot_risk_coverage(tmp_path / "plot.png", {"a": found(0, 0, 0)})
    assert list(tmp_path.iterdir()) == []
