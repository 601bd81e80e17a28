# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Pictures and pages for people; they need ``pip install 'maxcon[demo]'``."""

from maxcon.report.drive_plot import plot_drive
from maxcon.report.epoch import plot_epoch
from maxcon.report.errors_plot import plot_errors
from maxcon.report.html import Picture
from maxcon.report.page import DemoPage, MethodSummary, write_demo_page
from maxcon.report.poses_plot import plot_poses
from maxcon.report.prior_error_plot import plot_prior_error
from maxcon.report.search_spaces import SearchSpaceView, plot_search_spaces

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
