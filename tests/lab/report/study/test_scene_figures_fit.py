# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Nothing written in a figure is cut off at its edge, and no two parts of it lie on each other."""

from dataclasses import replace

import numpy as np
import pytest

import maxcon
from maxcon.lab.report.plots.comparison_plot import ComparisonRow, plot_comparison
from maxcon.lab.report.plots.headings_plot import plot_headings
from maxcon.lab.report.plots.overview_plot import plot_overview
from maxcon.plotting.score_panel import SearchSpaceView


class BelowZero:
    """An objective with the longest words below its colour scale."""

    def score(self, moments):
        return moments[..., 0] - 3.0


def assert_all_fits(figure):
    renderer = figure.canvas.get_renderer()
    boxes = {text.get_text(): text.get_window_extent(renderer) for text in figure.texts}
    boxes |= {f"legend {n}": legend.get_window_extent(renderer) for n, legend in enumerate(figure.legends)}
    # With ticks, labels and titles.
    boxes |= {f"panel {n}": axes.get_tightbbox(renderer) for n, axes in enumerate(figure.axes)}
    names = list(boxes)
    for number, name in enumerate(names):
        box = boxes[name]
        assert min(box.x0, box.y0) >= 0.0 and box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1, name
        for other in names[:number]:
            assert not box.overlaps(boxes[other]), (name, other)


@pytest.mark.parametrize("n_epochs", [1, 3])
@pytest.mark.parametrize("status", [maxcon.Status.LOCALIZED, maxcon.Status.NOT_CONVERGED])
def test_overview_fits(epoch, space, tmp_path, drawn, n_epochs, status):
    parts = epoch.conclude(space, BelowZero())
    parts["estimate"] = replace(parts["estimate"], status=status)
    moved = [replace(parts["accumulator"], prior=epoch.prior.translated([x, 0.0, 0.0])) for x in (-2.0, 2.0)]
    others = [(accumulator, replace(parts["estimate"], status=maxcon.Status.AT_RIM)) for accumulator in moved]
    plot_overview(
        tmp_path / "overview.png",
        **parts,
        scan=epoch.scan,
        point_map=epoch.point_map,
        prior=epoch.prior,
        others=others[: n_epochs - 1],
        title="Epoch 1234 and its neighbours",
    )
    assert_all_fits(drawn[0])


@pytest.mark.parametrize("n_headings", [1, 3, 5, 7, 9, 61])
@pytest.mark.parametrize("scale", [1.0, 1e6])
def test_headings_fit(epoch, tmp_path, drawn, n_headings, scale):
    space = maxcon.SearchSpace(0.3, 0.06, 0.25 * (n_headings - 1), 0.5)
    accumulator = epoch.accumulate(space)
    accumulator = replace(accumulator, moments=accumulator.moments * scale)
    title = "Epoch 1234: every heading"
    plot_headings(tmp_path / "headings.png", accumulator, maxcon.Count(), title=title, reference=epoch.reference)
    assert_all_fits(drawn[0])


@pytest.mark.parametrize("n_views", [1, 2, 3])
def test_comparison_fits(epoch, space, tmp_path, drawn, n_views):
    accumulator = epoch.accumulate(space)
    views = [
        SearchSpaceView(accumulator, maxcon.Count(), "Count, every map point"),
        SearchSpaceView(accumulator, BelowZero(), "Count less 3, every map point"),
        SearchSpaceView(accumulator, maxcon.MaxEigenvalue()),
    ]
    far = maxcon.Pose(-12.34, 12.34, 0.0, 0.0, 0.0, np.radians(10.0))
    rows = [
        ComparisonRow("straight street, epoch 1234", epoch.scan, epoch.point_map, pose, tuple(views[:n_views]))
        for pose in (epoch.reference, far)
    ]
    plot_comparison(tmp_path / "comparison.png", rows, title="Count beside Helmert's score, from the reference")
    assert_all_fits(drawn[0])
