# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import re

import numpy as np
import pytest

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.report.plots.certainty_plots import plot_stanford

ERRORS = [0.05, -0.1, 0.2, -0.5, 0.1, 0.9, 3.0, np.nan]
LEVELS = [0.10, 0.10, 0.1, 0.10, 0.4, 0.4, np.nan, np.nan]


def words(path):
    return re.findall("<!-- (.*?) -->", path.read_text(encoding="utf-8"), flags=re.S)


def test_regions_are_counted_and_what_that_proves_is_said(tmp_path):
    plot_stanford(tmp_path / "plot.svg", {"along": ERRORS}, {"along": LEVELS})
    written = words(tmp_path / "plot.svg")
    at = written.index("nominal")
    assert written[at : at + 8] == ["nominal", "2", "misleading", "1", "hazardous", "1", "unavailable", "4"]
    assert any("Alert limit: 0.29 m." in each for each in written)
    assert "Errors above their level: 2 of 4 used epochs;" in written
    assert "proved with 95 % confidence: a rate of at most 90.2 %." in written


def test_nothing_used_proves_nothing(tmp_path):
    plot_stanford(tmp_path / "plot.svg", {"along": [0.1]}, {"along": [np.nan]}, alert_limit=0.5)
    assert "No epoch has a level within the alert limit: nothing is proved." in words(tmp_path / "plot.svg")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("error", [0.0, 1e-9, 50.0, np.nan])
def test_odd_errors_are_drawn(tmp_path, png_size, error):
    plot_stanford(tmp_path / "plot.png", {"$x$": [error], "y": [0.1]}, {"$x$": [0.01], "y": [np.nan]})
    assert png_size(tmp_path / "plot.png")[0] > 1000


def test_same_errors_give_the_same_bytes(tmp_path):
    for name in "ab":
        plot_stanford(tmp_path / f"{name}.svg", {"along": ERRORS * 100}, {"along": LEVELS * 100})
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_wrong_levels_are_refused(tmp_path):
    with pytest.raises(ArrayError, match=r"errors and levels along of one shape, got \(1,\) and \(2,\)"):
        plot_stanford(tmp_path / "plot.png", {"along": [0.1]}, {"along": [0.1, 0.2]})
    with pytest.raises(OptionError, match="Expected errors and levels of the same directions"):
        plot_stanford(tmp_path / "plot.png", {"along": [0.1]}, {"across": [0.1]})
    with pytest.raises(OptionError, match="`alert_limit` above 0 m, got -1"):
        plot_stanford(tmp_path / "plot.png", {"along": [0.1]}, {"along": [0.1]}, alert_limit=-1.0)
    assert list(tmp_path.iterdir()) == []
