# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Objectives side by side at several places, each search space centred on the reference (the paper's figure 4)."""

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from string import ascii_lowercase
from typing import TYPE_CHECKING

from maxcon.errors import OptionError
from maxcon.geometry import Pose, wrap_angle
from maxcon.map import PointMap
from maxcon.plotting.canvas.figure import SERIES, draw_titles, saved_figure
from maxcon.plotting.canvas.from_above import Window, draw_map, draw_scale_bar, map_patch
from maxcon.plotting.scene import half_width_of, is_off_the_ground
from maxcon.plotting.score_panel import (
    COLORS,
    SearchSpaceView,
    cell_marks,
    draw_scores,
    ground_of,
    offset_words,
    put_mark,
    scale_words,
    title_of,
)
from maxcon.scan import Scan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["ComparisonRow", "plot_comparison"]

SCAN_COLOR = SERIES[2]
OUTSIDE = "#d9d9d9"
# Largest half width of the ground that is drawn around the reference, m: enough for a street and its facades.
MOST_HALF_WIDTH = 35.0
# Inches: the panels, and what stands around them.
SIDE, LEFT, RIGHT, BOTTOM, TOP = 2.75, 0.3, 0.2, 0.95, 1.0
FIRST_GAP, GAP, ROW_HEIGHT = 0.85, 0.55, 3.95
# In points: room for half a mark on the border of a panel.
TITLE_PAD = 12


@dataclass(frozen=True)
class ComparisonRow:
    """One epoch, scored by several objectives.

    label: what is special about it: "crossing", "straight street".
    scan: sensor frame.
    point_map: the map.
    reference: the pose held for true, local frame: where the highest score should be.
    views: at least one; they need not share an accumulator. Search around the reference to have it in the middle.
    """

    label: str
    scan: Scan
    point_map: PointMap
    reference: Pose
    views: tuple[SearchSpaceView, ...]

    def __post_init__(self) -> None:
        if not self.views:
            raise OptionError(
                f"Expected at least one search space to compare at {self.label!r}, got none. Give a SearchSpaceView."
            )

    @property
    def window(self) -> Window:
        """The square around the reference that holds nine tenths of the scan, within limits."""
        return Window.around(self.reference.x, self.reference.y, half_width_of(self.scan, MOST_HALF_WIDTH))


def plot_comparison(path: str | os.PathLike[str], rows: Sequence[ComparisonRow], *, title: str) -> None:
    """Draw one row per epoch: the scan in the map from above, and the search space of each objective.

    path: a .png or .svg to write.
    rows: at least one.
    title: what is written above all.

    A search space is drawn at the heading of its best cell, with (0, 0) at the reference. Its colours run from
    0 (the lowest score, if negative) to its own highest: scores of different objectives have different units.
    """
    if not rows:
        raise OptionError("Expected at least one epoch to compare, got none. Give a ComparisonRow.")
    n_places = max(2, *(len(row.views) for row in rows))
    width = LEFT + SIDE + FIRST_GAP + n_places * (SIDE + GAP) - GAP + RIGHT
    height = TOP + len(rows) * ROW_HEIGHT + BOTTOM
    with saved_figure(path, width, height) as figure:
        draw_titles(
            figure,
            title,
            "Each square: all positions at the best heading, scored. Above it: where the best cell lies from the"
            "\nreference, in m and degrees. (0, 0) is right.",
        )
        letters = _letters()
        for number, row in enumerate(rows):
            bottom = BOTTOM + (len(rows) - 1 - number) * ROW_HEIGHT + 0.55
            axes = figure.add_axes((LEFT / width, bottom / height, SIDE / width, SIDE / height))
            _draw_ground(axes, row)
            axes.set_title(
                f"{next(letters)} {row.label}", loc="left", pad=TITLE_PAD, fontweight="bold", parse_math=False
            )
            for column, view in enumerate(row.views):
                left = LEFT + SIDE + FIRST_GAP + column * (SIDE + GAP)
                axes = figure.add_axes((left / width, bottom / height, SIDE / width, SIDE / height))
                _draw_view(axes, view, row.reference)
                axes.set_title(
                    f"{next(letters)} {_view_words(view, row.reference)}", loc="left", pad=TITLE_PAD, parse_math=False
                )
                axes.set_xlabel("x from the reference [m]")
                axes.set_ylabel("y from the reference [m]" if column == 0 else "")
        _draw_legend(figure, scale_words(view for row in rows for view in row.views))


def best_from(view: SearchSpaceView, reference: Pose) -> tuple[float, float, float]:
    """Return offset x, y (m) and turn (rad) of the best cell's pose from the reference."""
    pose = view.space.pose(view.best, view.accumulator.prior)
    return pose.x - reference.x, pose.y - reference.y, wrap_angle(pose.heading - reference.heading)


def _draw_ground(axes: "Axes", row: ComparisonRow) -> None:
    """Draw the map from above with the scan at the reference, without level ground."""
    points = row.reference.apply(row.scan.points[is_off_the_ground(row.scan, row.reference)])
    draw_map(axes, row.point_map, row.window)
    axes.plot(*points[:, :2].T, ls="", marker="o", mew=0, ms=1.2, color=SCAN_COLOR, zorder=2, rasterized=True)
    mark = cell_marks()[1]
    mark.set_markersize(10)
    put_mark(axes, mark, row.reference.x, row.reference.y)
    axes.set(xlabel="", ylabel="", xticks=[], yticks=[])
    draw_scale_bar(axes, row.window)


def _draw_view(axes: "Axes", view: SearchSpaceView, reference: Pose) -> None:
    """Draw the best heading with the reference at (0, 0), and mark both."""
    from matplotlib.colors import Normalize

    x, y = view.offset(reference)
    ground = ground_of(view.space, -x, -y)
    axes.set(
        xlim=(min(ground.west, 0.0), max(ground.east, 0.0)),
        ylim=(min(ground.south, 0.0), max(ground.north, 0.0)),
        facecolor=OUTSIDE,
    )
    draw_scores(axes, view.scores[view.best[0]], ground, Normalize(*view.limits))
    best_mark, reference_mark = cell_marks()
    put_mark(axes, reference_mark, 0.0, 0.0)
    if view.has_best:
        put_mark(axes, best_mark, *best_from(view, reference)[:2])
    axes.locator_params(nbins=5)


def _view_words(view: SearchSpaceView, reference: Pose) -> str:
    """Return the title of a panel, and in a second line where its best cell lies from the reference."""
    name = view.title or title_of(view.objective)
    if not view.has_best:
        return f"{name}\nall cells score the same"
    x, y, turn = best_from(view, reference)
    return f"{name}\n(x = {offset_words(x)}, y = {offset_words(y)}), turn {offset_words(math.degrees(turn))}°"


def _letters() -> Iterator[str]:
    """Yield (a), (b), ... and after (z) (aa), (bb), ..."""
    for number in count():
        yield f"({ascii_lowercase[number % 26] * (number // 26 + 1)})"


def _draw_legend(figure: "Figure", words: str) -> None:
    """Draw the colour scale that all search spaces share, and the marks."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.lines import Line2D

    width, height = figure.get_size_inches()
    left = LEFT + SIDE + FIRST_GAP
    bar = figure.add_axes((left / width, 0.5 / height, SIDE / width, 0.15 / height))
    figure.colorbar(ScalarMappable(cmap=COLORS), cax=bar, orientation="horizontal", ticks=[0.0, 0.5, 1.0])
    figure.text(left / width, 0.75 / height, words, fontsize=10)
    dot = Line2D([], [], ls="", marker="o", ms=7, mew=0, color=SCAN_COLOR, label="scan at the reference")
    figure.legend(handles=[map_patch(), dot], loc="lower left", bbox_to_anchor=((LEFT - 0.1) / width, 0.18 / height))
    figure.legend(
        handles=cell_marks(),
        loc="lower left",
        bbox_to_anchor=((left + SIDE + GAP) / width, 0.3 / height),
        ncols=2,
        handletextpad=1.0,
    )
