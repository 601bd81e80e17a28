# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The search space in colours: objectives side by side, each at its best heading (the paper's figures 2 and 4)."""

import math
import os
from collections.abc import Sequence

from maxcon.errors import OptionError
from maxcon.geometry import Pose
from maxcon.plotting.canvas.figure import MUTED, draw_titles, saved_figure
from maxcon.plotting.score_panel import (
    SearchSpaceView,
    cell_marks,
    draw_color_bar,
    draw_heading,
    title_of,
    turn_words,
    unit_of,
)

__all__ = ["plot_search_spaces"]


def plot_search_spaces(
    path: str | os.PathLike[str], views: Sequence[SearchSpaceView], *, title: str, reference: Pose | None = None
) -> None:
    """Draw several objectives side by side, each at its own best heading: count beside Helmert, say.

    path: a .png or .svg to write.
    views: at least one; they need not share an accumulator.
    title: what is written above all.
    reference: the pose held for true, local frame; marked, and each best cell's distance to it is stated.
    """
    if not views:
        raise OptionError("Expected at least one search space to draw, got none. Give a SearchSpaceView.")
    panel, gap, height = 4.3, 1.75, 6.1
    width = len(views) * (panel + gap) + 0.1
    with saved_figure(path, width, height) as figure:
        from matplotlib.colors import Normalize

        draw_titles(figure, title, "Each square: all positions at the best heading; warm cells score high.")
        for number, view in enumerate(views):
            left = (0.85 + number * (panel + gap)) / width
            axes = figure.add_axes((left, 0.58 / height, panel / width, panel / height))
            image = draw_heading(axes, view, view.best[0], Normalize(*view.limits), reference)
            axes.set_title(_view_words(view, reference), loc="left", parse_math=False)
            axes.set_xlabel("x from the prior [m]")
            axes.set_ylabel("y from the prior [m]")
            bar = figure.add_axes((left + (panel + 0.1) / width, 0.58 / height, 0.13 / width, panel / height))
            draw_color_bar(figure, image, bar, "vertical")
            bar.set_title(unit_of(view.objective), fontsize=9, loc="left", color=MUTED, parse_math=False)
        figure.legend(
            handles=cell_marks()[: 1 if reference is None else 2],
            loc="upper right",
            bbox_to_anchor=(1.0, 1.0 - 0.1 / height),
            ncols=2,
            handletextpad=1.0,
        )


def _view_words(view: SearchSpaceView, reference: Pose | None) -> str:
    """Return title, turn and distance to the reference of a panel, in two lines."""
    words = f"{view.title or title_of(view.objective)}\nheading {turn_words(view.space, view.best[0])}"
    if reference is None:
        return words
    pose = view.space.pose(view.best, view.accumulator.prior)
    return f"{words}, {math.hypot(pose.x - reference.x, pose.y - reference.y):.2f} m from the reference"
