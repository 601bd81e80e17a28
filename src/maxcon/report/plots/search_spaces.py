# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The search space in colours: one panel per heading, and objectives side by side (the paper's figures 2 and 4)."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from maxcon.accumulator import Accumulator
from maxcon.errors import OptionError
from maxcon.geometry import Pose, wrap_angle
from maxcon.objectives import Objective, Scores
from maxcon.report.canvas.figure import MUTED, draw_titles, saved_figure
from maxcon.report.canvas.objective_names import title_of, unit_of
from maxcon.search_space import Cell, SearchSpace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage
    from matplotlib.lines import Line2D

__all__ = [
    "SearchSpaceView",
    "cell_marks",
    "chosen_headings",
    "draw_color_bar",
    "draw_heading",
    "plot_search_spaces",
    "turn_words",
]

COLORS = "plasma"
"""From cold blue to warm yellow, in steps that are even to every eye, and in grey print."""


@dataclass(frozen=True)
class SearchSpaceView:
    """An accumulator, scored by an objective.

    Parameters
    ----------
    accumulator : Accumulator
        The moments of every cell.
    objective : Objective
        Scores the cells.
    title : str
        Title of its panel; the objective's if empty.
    """

    accumulator: Accumulator
    objective: Objective
    title: str = ""

    @property
    def space(self) -> SearchSpace:
        """The cells."""
        return self.accumulator.space

    @cached_property
    def scores(self) -> Scores:
        """Score of every cell, shape (headings, ny, nx)."""
        return self.accumulator.score(self.objective)

    @cached_property
    def best(self) -> Cell:
        """The cell with the highest score."""
        return self.accumulator.best_cell(self.objective)

    @property
    def has_best(self) -> bool:
        """Whether any cell scores higher than another."""
        return bool(self.scores[self.best] > self.scores.min())

    @cached_property
    def limits(self) -> tuple[float, float]:
        """Scores at the ends of the colour scale: 0 (or the lowest, if negative) and the highest."""
        finite = self.scores[np.isfinite(self.scores)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        low = min(low, 0.0)
        return low, high if high > low else low + 1.0

    def offset(self, pose: Pose) -> tuple[float, float]:
        """Offset (x, y) of a pose from the prior, m."""
        return pose.x - self.accumulator.prior.x, pose.y - self.accumulator.prior.y

    def heading_nearest(self, pose: Pose, among: Sequence[int]) -> int:
        """Return the index, of those `among`, of the heading nearest to that of a pose."""
        turns = self.space.headings
        turn = wrap_angle(pose.heading - self.accumulator.prior.heading)
        return min(among, key=lambda heading: abs(float(turns[heading]) - turn))


def chosen_headings(n_headings: int, best: int, limit: int = 9) -> list[int]:
    """Return indices of at most `limit` headings, evenly and as widely spaced as fits, with the best among them."""
    widest = max(1, (n_headings - 1) // max(1, limit - 1))
    for step in range(widest, 0, -1):
        chosen = range(best % step, n_headings, step)
        if len(chosen) >= limit:
            break
    return sorted(sorted(chosen, key=lambda heading: abs(heading - best))[:limit])


def draw_heading(
    axes: "Axes", view: SearchSpaceView, heading: int, norm: "Normalize", reference: Pose | None
) -> "AxesImage":
    """Draw the cells of one heading, with the best cell if it is here and the reference if given."""
    space = view.space
    offsets, half = space.offsets, 0.5 * space.cell_edge
    low, high = float(offsets[0]) - half, float(offsets[-1]) + half
    image = axes.imshow(
        np.ma.masked_invalid(view.scores[heading]),
        origin="lower",
        extent=(low, high, low, high),
        norm=norm,
        cmap=COLORS,
        interpolation="nearest",
    )
    best_mark, reference_mark = cell_marks()
    if reference is not None and all(low <= value <= high for value in view.offset(reference)):
        _put(axes, reference_mark, *view.offset(reference))
    if view.has_best and heading == view.best[0]:
        _put(axes, best_mark, float(offsets[view.best[2]]), float(offsets[view.best[1]]))
    axes.set_xlim(low, high)
    axes.set_ylim(low, high)
    axes.locator_params(nbins=5)
    return image


def cell_marks() -> tuple["Line2D", "Line2D"]:
    """Return the marks of the best cell and of the reference: for a panel and for the legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patheffects import withStroke

    best = Line2D([], [], ls="", marker="o", ms=14, mfc="none", mec="white", mew=1.6, label="best cell")
    reference = Line2D(
        [], [], ls="", marker="D", ms=16, mfc="none", mec="#7fffd4", mew=1.4, label="reference"
    )
    for mark in (best, reference):
        mark.set_clip_on(False)
        mark.set_zorder(5)
        mark.set_path_effects([withStroke(linewidth=3.2, foreground="black")])
    return best, reference


def draw_color_bar(figure: "Figure", image: "AxesImage", axes: "Axes", orientation: str) -> None:
    """Draw the colour scale of an image into axes of its own."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    figure.colorbar(
        image,
        cax=axes,
        orientation=orientation,
        ticks=MaxNLocator(5),
        format=FuncFormatter(lambda value, _: f"{value:,.6g}".replace("-", "−")),
    )


def _put(axes: "Axes", mark: "Line2D", x: float, y: float) -> None:
    mark.set_data([x], [y])
    axes.add_line(mark)


def turn_words(space: SearchSpace, heading: int) -> str:
    """Return the turn of a heading from the prior's, in degrees."""
    turn_deg = math.degrees(float(space.headings[heading]))
    return f"{turn_deg:+.3g}°".replace("-", "−") if turn_deg else "0°"


def plot_search_spaces(
    path: str | os.PathLike[str],
    views: Sequence[SearchSpaceView],
    *,
    title: str,
    reference: Pose | None = None,
) -> None:
    """Draw several objectives side by side, each at its own best heading: count beside Helmert, say.

    Parameters
    ----------
    path : path
        A .png or .svg to write.
    views : sequence of SearchSpaceView
        At least one; they need not share an accumulator.
    title : str
        What is written above all.
    reference : Pose, optional
        The pose held for true, local frame; marked, and each best cell's distance to it is stated.

    Raises
    ------
    OptionError
        If there is no view, or the name ends in neither .png nor .svg.
    MissingExtraError
        If matplotlib is not installed.
    FileError
        If the file cannot be written.
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
