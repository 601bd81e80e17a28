# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import re

import numpy as np
import pytest

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.report.plots.certainty_plots import SigmaPanel, plot_sigmas

PANEL = SigmaPanel("along", "cm", [0.5, -1.5, 2.5, 9.0, np.nan], [1.0, 1.0, 1.0, 1.0, 1.0])


def test_shares_stand_above_each_panel(tmp_path):
    plot_sigmas(tmp_path / "plot.svg", [PANEL], title="T")
    written = re.findall("<!-- (.*?) -->", (tmp_path / "plot.svg").read_text(encoding="utf-8"))
    assert "within: 25.0 · 50.0 · 75.0 % of 4" in written
    assert "predicted sigma [cm]" in written


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("errors", [[0.0], [1e9], [0.0, 1e-9, 1e3]])
def test_few_and_odd_errors_are_drawn(tmp_path, errors):
    plot_sigmas(tmp_path / "plot.svg", [SigmaPanel("$x$", "m", errors, np.full(len(errors), 0.01))] * 4)
    assert (tmp_path / "plot.svg").exists()


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_same_errors_give_the_same_bytes(tmp_path, suffix):
    for name in "ab":
        plot_sigmas(tmp_path / f"{name}{suffix}", [PANEL])
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_wrong_sigmas_are_refused(tmp_path):
    def draw(*panels):
        plot_sigmas(tmp_path / "plot.png", panels)

    with pytest.raises(OptionError, match="1 to 4 panels, got 0"):
        draw()
    with pytest.raises(ArrayError, match="error and sigma along, got none"):
        draw(SigmaPanel("along", "m", [1.0], [np.nan]))
    with pytest.raises(ArrayError, match=r"of one shape, got \(1,\) and \(2,\)"):
        draw(SigmaPanel("along", "m", [1.0], [1.0, 1.0]))
    with pytest.raises(ArrayError, match="Expected sigmas along to be"):
        draw(SigmaPanel("along", "m", [1.0], [0.0]))
    assert list(tmp_path.iterdir()) == []
