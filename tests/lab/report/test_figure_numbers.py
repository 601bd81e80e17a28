# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Numbers that are counted for figures, and written into them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drawn_figures import words
from maxcon.lab.evaluation import RiskCoverage
from maxcon.lab.report.certainty_plots import SigmaPanel, bar_places, plot_risk_coverage, plot_sigmas, plot_stanford
from maxcon.lab.report.errors import (
    count_by_distance,
    percents_within,
    plot_error_distributions,
    plot_success,
    round_width,
)
from maxcon.lab.report.prior_error import plot_prior_error
from maxcon.lab.report.timeline import ErrorRow, plot_timeline
from maxcon.lab.study.prior_trials import TrialSummary


def test_percents_are_of_all_epochs():
    errors = np.array([0.3, np.nan, 0.1, 4.0, 0.1])
    limits = np.array([0.0, 0.0999, 0.1, 0.3, 10.0])
    np.testing.assert_allclose(percents_within(errors, limits), [0.0, 0.0, 40.0, 60.0, 80.0])


@given(st.lists(st.floats(0.0, 20.0) | st.just(np.nan), min_size=1), st.floats(0.0, 20.0))
def test_percents_count_what_they_say(errors, limit):
    expected = 100.0 * sum(error <= limit for error in errors) / len(errors)
    assert percents_within(np.array(errors), np.array([limit]))[0] == pytest.approx(expected)


def test_distributions_state_the_epochs_within_the_limit(tmp_path):
    errors = {"Count": [0.1, 0.5, np.nan, np.nan], "Helmert": [0.1, 0.2, 0.3, 0.36]}
    plot_error_distributions(tmp_path / "plot.svg", errors)
    written = words(tmp_path / "plot.svg")
    assert "Count: 25.0 %, 2 without an answer" in written
    assert "Helmert: 75.0 %" in written
    assert "Epochs: 4, those without an answer too. Dashed: success, 0.3 m. Below: shares within it." in written


def test_epochs_are_counted_by_distance():
    offsets = np.array([0.0, 0.49, 0.5, 0.99, 1.6, 1.5])
    counts = count_by_distance(offsets, np.array([True, False, True, True, False, False]), 0.5, 5)
    np.testing.assert_array_equal(counts, [[2, 2, 0, 2, 0], [1, 2, 0, 0, 0]])


@pytest.mark.parametrize(
    ("farthest", "expected"), [(0.0, 0.5), (9.99, 0.5), (10.0, 1.0), (39.0, 2.0), (99.0, 5.0), (350.0, 20.0)]
)
def test_bins_are_of_round_width(farthest, expected):
    assert round_width(farthest) == expected


def test_success_is_stated_by_bin_and_in_all(tmp_path):
    offsets = {"Count": [0.1, 0.2, 1.2], "Helmert": [0.1, 0.2, 1.2]}
    plot_success(tmp_path / "plot.svg", offsets, {"Helmert": np.ones(3, bool), "Count": np.array([False, True, False])})
    written = words(tmp_path / "plot.svg")
    assert {"Count: 33.3 %", "Helmert: 100.0 %"} <= set(written)
    assert "Success: within 0.3 m and 1° of the reference. Bins of 0.5 m; bars: Wilson's 95 % intervals." in written
    place = written.index("epochs")  # one row for both, as they have the same epochs
    assert written[place - 3 : place] == ["2", "0", "1"]


def risk(n_epochs, n_trusted, n_wrong):
    """So many epochs, the first of them trusted and the very first wrong."""
    place = np.arange(n_epochs)
    return RiskCoverage.of(place >= n_wrong, np.ones(n_epochs), place < n_trusted, place / n_epochs)


def test_risk_says_how_many_of_the_trusted_are_wrong(tmp_path):
    plot_risk_coverage(tmp_path / "plot.svg", {"maxcon": risk(1200, 1100, 0), "gicp-3m": risk(1200, 1000, 7)})
    assert {"maxcon: 0 of 1,100", "gicp-3m: 7 of 1,000"} <= set(words(tmp_path / "plot.svg"))


def test_bars_that_would_lie_on_each_other_are_set_apart():
    methods = [risk(100, 100, 0), risk(100, 50, 0), risk(100, 100, 0), risk(100, 100, 0), risk(100, 0, 0)]
    np.testing.assert_allclose(bar_places(methods, 10.0), [100.0, 50.0, 99.2, 100.8, np.nan])
    assert bar_places([risk(1000, 1000, 0), risk(1000, 1000, 500)], 80.0) == [100.0, 100.0]


def test_sigmas_state_the_errors_within_them(tmp_path):
    panel = SigmaPanel("along", "cm", [0.5, -1.5, 2.5, 9.0, np.nan], [1.0, 1.0, 1.0, 1.0, 1.0])
    plot_sigmas(tmp_path / "plot.svg", [panel], title="T")
    assert {"within: 25.0 · 50.0 · 75.0 % of 4", "predicted sigma [cm]"} <= set(words(tmp_path / "plot.svg"))


def test_stanford_regions_are_counted_and_what_that_proves_is_said(tmp_path):
    errors = [0.05, -0.1, 0.2, -0.5, 0.1, 0.9, 3.0, np.nan]
    levels = [0.10, 0.10, 0.1, 0.10, 0.4, 0.4, np.nan, np.nan]
    plot_stanford(
        tmp_path / "plot.svg", {"along": errors, "none": [0.1]}, {"along": levels, "none": [np.nan]}, title=""
    )
    written = words(tmp_path / "plot.svg")
    at = written.index("nominal")
    assert written[at : at + 8] == ["nominal", "2", "misleading", "1", "hazardous", "1", "unavailable", "4"]
    assert any("Alert limit: 0.29 m." in each for each in written)
    assert "Errors above their level: 2 of 4 used epochs;" in written
    assert "proved with 95 % confidence: a rate of at most 90.2 %." in written
    assert "No epoch has a level within the alert limit: nothing is proved." in written


def error_row(errors, sigmas, levels):
    return ErrorRow("along", "cm", *(np.array(values, float) for values in (errors, sigmas, levels)))


GROSS = error_row([1.0, -2.0, 300.0, np.nan], [1.0, 1.0, 1.0, np.nan], [3.0, 3.0, 3.0, np.nan])


@pytest.mark.parametrize(
    ("row", "limit"),
    [
        (GROSS, 4.0 * 3.0),  # gross errors do not flatten the others
        (error_row([0.5] * 3, [1.0] * 3, [3.0] * 3), 3.0),
        (error_row([-4.0] * 3, [1.0] * 3, [np.nan] * 3), 4.0),
        (error_row([np.nan], [np.nan], [np.nan]), 1.0),
    ],
)
def test_the_range_of_errors_holds_errors_bands_and_levels(row, limit):
    assert row.limit == pytest.approx(1.25 * limit)


def test_statuses_and_wrong_answers_are_counted(tmp_path):
    statuses = ["localized", "localized", "localized", "no match"]
    plot_timeline(tmp_path / "plot.svg", [0, 1, 2, 3], statuses, [False, False, True, True], [GROSS], title="T")
    written = words(tmp_path / "plot.svg")
    assert {"localized: 3", "no match: 1", "trusted and wrong: 1", "±2 predicted sigmas"} <= set(written)
    assert "protection level" in written
    assert any("4 epochs. Trusted and wrong: 1 (0.3 m and 1°)." in each for each in written)


def test_a_method_that_predicts_nothing_has_no_band(tmp_path):
    row = error_row([1.0, -2.0], [np.nan] * 2, [np.nan] * 2)
    plot_timeline(tmp_path / "plot.svg", [0, 50], ["localized"] * 2, [False, False], [row], title="T")
    written = words(tmp_path / "plot.svg")
    assert any("No trusted answer is wrong" in each for each in written)
    assert any("predicts no errors" in each for each in written)
    assert "±2 predicted sigmas" not in written and "protection level" not in written


def test_drives_methods_levels_and_times_are_named(tmp_path):
    names = ("maxcon", "count 1 m, then GICP", "my method")
    found = [
        TrialSummary(offset, offset, name, 10, 10 - number, 10, number, 0.1, 100.0 * number + offset, 0.0)
        for offset in (3.0, 12.0)
        for number, name in enumerate(names)
    ]
    plot_prior_error(tmp_path / "figure.svg", {"one drive": found, "a $second$": found})
    told = " ".join(words(tmp_path / "figure.svg"))
    assert "one drive, 10 epochs" in told and "a $second$, 10 epochs" in told
    for label in ("maxcon: 12 ms", "count 1 m, then GICP: 110 ms", "my method: 210 ms", "12 m", "12°", "median [ms]"):
        assert label in told
