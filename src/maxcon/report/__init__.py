# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Pictures and pages for people; they need ``pip install 'maxcon[demo]'``."""

from maxcon.report.canvas.html import Picture
from maxcon.report.demo_page import DemoPage, MethodSummary, write_demo_page
from maxcon.report.plots.drive_plot import plot_drive
from maxcon.report.plots.epoch import plot_epoch
from maxcon.report.plots.errors_plot import plot_errors
from maxcon.report.plots.poses_plot import plot_poses
from maxcon.report.plots.prior_error_plot import plot_prior_error
from maxcon.report.plots.search_space_view import SearchSpaceView
from maxcon.report.plots.search_spaces import plot_search_spaces

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
