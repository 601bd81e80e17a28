# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Nothing in the figures of certainty is cut off, and no words lie on others, for few epochs and for many."""

import numpy as np
import pytest

from maxcon.lab.evaluation import RiskCoverage
from maxcon.lab.report.plots.certainty_plots import SigmaPanel, plot_sigmas, plot_stanford
from maxcon.lab.report.plots.risk_coverage_plot import plot_risk_coverage
from maxcon.lab.report.plots.timeline_plot import ErrorRow, plot_timeline

WORDS = ("localized", "ambiguous", "walls missing", "not confirmed", "at the rim", "unreadable scan")


def assert_fits(figure):
    renderer = figure.canvas.get_renderer()
    words = [text for text in figure.texts + figure.legends if text.get_visible()]
    boxes = [text.get_window_extent(renderer) for text in words]
    panels = [axes.get_tightbbox(renderer) for axes in figure.axes]
    for box in boxes + panels:
        assert min(box.x0, box.y0) >= 0.0 and box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1
    for number, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:number] + panels), words[number]


@pytest.fixture(params=[1, 25, 3001])
def drive(request):
    """Errors, sigmas and statuses of a drive; a tenth is withheld, and a few answers are far off."""
    generator, n = np.random.default_rng(request.param), request.param
    sigmas = np.exp(generator.normal(np.log(0.01), 0.3, (3, n)))
    errors = sigmas * generator.standard_normal((3, n))
    errors[0, :: max(n // 3, 2)] += 3.0
    statuses = generator.choice(WORDS, n, p=[0.9, 0.06, 0.01, 0.01, 0.01, 0.01])
    statuses[0] = "localized"
    sigmas[:, statuses != "localized"] = np.nan
    errors[:, statuses == "unreadable scan"] = np.nan
    return errors, sigmas, list(statuses)


def test_sigmas_fit(drive, tmp_path, drawn):
    errors, sigmas, _ = drive
    panels = [SigmaPanel(f"kind {number}", "cm", errors[number], sigmas[number]) for number in range(3)]
    plot_sigmas(tmp_path / "sigmas.png", panels, title="Error against predicted sigma: a method")
    assert_fits(drawn[0])


def test_stanford_diagram_fits(drive, tmp_path, drawn):
    errors, sigmas, _ = drive
    plot_stanford(
        tmp_path / "stanford.png",
        {"along": errors[0], "across": errors[1]},
        {"along": 3.0 * sigmas[0], "across": 40.0 * sigmas[1]},
    )
    assert_fits(drawn[0])


def test_timeline_fits(drive, tmp_path, drawn):
    errors, sigmas, statuses = drive
    rows = [
        ErrorRow("along", "cm", 100.0 * errors[0], 100.0 * sigmas[0], 300.0 * sigmas[0]),
        ErrorRow("heading", "°", 1e-3 * errors[2], 1e-3 * sigmas[2]),
    ]
    is_wrong = np.abs(errors[0]) > 0.3
    plot_timeline(tmp_path / "timeline.png", np.arange(len(statuses)), statuses, is_wrong, rows, title="A drive")
    assert_fits(drawn[0])


@pytest.mark.parametrize("n_methods", [1, 8])
def test_risk_coverage_fits(drive, tmp_path, drawn, n_methods):
    errors, _, statuses = drive
    trusted = np.array(statuses) == "localized"
    found = RiskCoverage.of(np.abs(errors[0]) < 0.3, ~np.isnan(errors[0]), trusted, np.abs(errors[1]))
    names = [f"a method by a long name {number}" for number in range(n_methods)]
    plot_risk_coverage(tmp_path / "risk.png", dict.fromkeys(names, found))
    assert_fits(drawn[0])
