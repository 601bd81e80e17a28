# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import re

import numpy as np
import pytest

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.report.plots.timeline_plot import ErrorRow, plot_timeline

ROW = ErrorRow("along", "cm", [1.0, -2.0, 300.0, np.nan], [1.0, 1.0, 1.0, np.nan], [3.0, 3.0, 3.0, np.nan])
STATUSES = ["localized", "localized", "localized", "no match"]


def words(path):
    return re.findall("<!-- (.*?) -->", path.read_text(encoding="utf-8"), flags=re.S)


def test_statuses_and_wrong_answers_are_counted(tmp_path):
    plot_timeline(tmp_path / "plot.svg", [0, 1, 2, 3], STATUSES, [False, False, True, True], [ROW])
    written = words(tmp_path / "plot.svg")
    assert "localized: 3" in written and "no match: 1" in written and "trusted and wrong: 1" in written
    assert any("4 epochs. Trusted and wrong: 1 (0.3 m and 1°)." in each for each in written)
    assert "±2 predicted sigmas" in written and "protection level" in written


def test_a_method_that_predicts_nothing_has_no_band(tmp_path):
    row = ErrorRow("along", "cm", [1.0, -2.0], [np.nan, np.nan])
    plot_timeline(tmp_path / "plot.svg", [0, 50], ["localized"] * 2, [False, False], [row])
    written = words(tmp_path / "plot.svg")
    assert any("No trusted answer is wrong" in each for each in written)
    assert any("predicts no errors" in each for each in written)
    assert "±2 predicted sigmas" not in written and "protection level" not in written


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("n_epochs", [1, 2, 301])
def test_few_and_many_epochs_are_drawn(tmp_path, png_size, n_epochs):
    values = np.linspace(-1.0, 1.0, n_epochs)
    row = ErrorRow("$x$", "m", values, np.ones(n_epochs), np.full(n_epochs, np.nan))
    plot_timeline(tmp_path / "plot.png", np.arange(n_epochs), ["a word of one's own"] * n_epochs, values > 2, [row])
    assert png_size(tmp_path / "plot.png")[0] == 1380


def test_many_epochs_stay_a_small_file(tmp_path):
    sigmas = np.random.default_rng(1).uniform(1.0, 2.0, 3001)
    row = ErrorRow("along", "cm", sigmas, sigmas, 3.0 * sigmas)
    plot_timeline(tmp_path / "plot.svg", np.arange(3001), ["localized"] * 3001, np.zeros(3001), [row] * 3)
    assert (tmp_path / "plot.svg").stat().st_size < 1_000_000


def test_rows_that_do_not_fit_are_refused(tmp_path):
    with pytest.raises(OptionError, match="1 to 4 rows, got 0"):
        plot_timeline(tmp_path / "plot.png", [0], ["localized"], [False], [])
    with pytest.raises(ArrayError, match=r"each of n > 0 epochs, got \(1,\), 2 and \(1,\)"):
        plot_timeline(tmp_path / "plot.png", [0], ["localized"] * 2, [False], [ROW])
    with pytest.raises(ArrayError, match=r"sigmas and levels along of shape \(1,\), got \(4,\), \(4,\), \(4,\)"):
        plot_timeline(tmp_path / "plot.png", [0], ["localized"], [False], [ROW])
    assert list(tmp_path.iterdir()) == []
