# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Pictures and pages for people; they need ``pip install 'maxcon[demo]'``."""

from maxcon.lab.report.pages import DemoPage, MethodSummary, Picture, write_demo_page
from maxcon.lab.report.plots.errors_plot import plot_errors
from maxcon.lab.report.plots.prior_error_plot import plot_prior_error
from maxcon.lab.report.plots.search_spaces import plot_search_spaces
from maxcon.plotting.epoch import plot_epoch
from maxcon.plotting.poses import plot_drive, plot_poses
from maxcon.plotting.score_panel import SearchSpaceView

__all__ = [
    "DemoPage",
    "MethodSummary",
    "Picture",
    "SearchSpaceView",
    "plot_drive",
    "plot_epoch",
    "plot_errors",
    "plot_poses",
    "plot_prior_error",
    "plot_search_spaces",
    "write_demo_page",
]
