# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Search spaces in colours: heading by heading (the paper's figure 2), objectives side by side (figure 4)."""

import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from maxcon.geometry import Pose, wrap_angle
from maxcon.lab.charts import offset_words, scale_words
from maxcon.map import PointMap
from maxcon.plotting.epoch import half_width_of, is_off_the_ground
from maxcon.plotting.figure import MUTED, SERIES, add_axes, saved_figure
from maxcon.plotting.from_above import Window, draw_map, draw_scale_bar, map_patch
from maxcon.plotting.score_panel import (
    COLORS,
    SearchSpaceView,
    cell_marks,
    chosen_headings,
    draw_color_bar,
    draw_frame,
    draw_scores,
    ground_of,
    put_mark,
    score_words,
    title_of,
    turn_words,
    unit_of,
)  # fmt: skip
from maxcon.scan import Scan
from maxcon.search.accumulator import Accumulator
from maxcon.search.objectives import Objective

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

OUTSIDE = "#d9d9d9"
# One epoch, heading by heading (figure 2). Inches: a panel, and the room around all of them.
PANEL, GAP, ROW_GAP, LEFT, RIGHT, BOTTOM, TOP = 2.43, 0.2, 0.4, 0.85, 1.05, 0.65, 1.35
N_COLUMNS = 3
# From the best cell to the edge of a panel, m.
SECTION = 1.0


def plot_headings(
    path: str | os.PathLike[str], accumulator: Accumulator, objective: Objective, *, title: str, reference: Pose
) -> None:
    """Draw the square of 2 m around the best cell, one panel per heading, in one scale of colours.

    path: a .png or .svg to write.
    reference: the pose held for true, local frame; marked in the heading nearest to it, if it lies in the square.

    At most 9 headings are drawn: the best, and others in even steps. Above each stand its turn from the
    prior's heading and the highest score in the square; what lies outside the search space is grey.
    """
    view = SearchSpaceView(accumulator, objective)
    headings = chosen_headings(view.space.shape[0], view.best[0])
    n_rows = math.ceil(len(headings) / N_COLUMNS)
    width = LEFT + N_COLUMNS * (PANEL + GAP) + RIGHT
    height = BOTTOM + n_rows * (PANEL + ROW_GAP) - ROW_GAP + TOP
    with saved_figure(path, width, height, title, section_words(view, len(headings))) as figure:
        from matplotlib.colors import Normalize

        norm = Normalize(*view.limits)
        for number, heading in enumerate(headings):
            row, column = divmod(number, N_COLUMNS)
            left, bottom = LEFT + column * (PANEL + GAP), BOTTOM + (n_rows - 1 - row) * (PANEL + ROW_GAP)
            axes = add_axes(figure, left, bottom, PANEL, PANEL)
            image = draw_section(axes, view, heading, norm)
            if heading == view.heading_nearest(reference, headings):
                (x, y), (best_x, best_y) = view.offset(reference), view.best_offset
                if max(abs(x - best_x), abs(y - best_y)) <= SECTION:
                    put_mark(axes, cell_marks()[1], x - best_x, y - best_y)
            axes.tick_params(labelleft=column == 0, labelbottom=number + N_COLUMNS >= len(headings))
        figure.text(0.5, 0.2 / height, "x from the best cell [m]", ha="center", fontsize=10.5)
        middle = (BOTTOM + 0.5 * (height - BOTTOM - TOP)) / height
        figure.text(0.2 / width, middle, "y from the best cell [m]", va="center", rotation=90, fontsize=10.5)
        bar = add_axes(figure, width - RIGHT + 0.05, BOTTOM, 0.15, height - BOTTOM - TOP)
        draw_color_bar(figure, image, bar, "vertical")
        bar.set_title(unit_of(view.objective), fontsize=9, loc="left", color=MUTED, parse_math=False)
        corner = (1.0, 1.0 - 0.1 / height)
        figure.legend(handles=cell_marks()[1:], loc="upper right", bbox_to_anchor=corner, handletextpad=1.0)


def highest_in_section(view: SearchSpaceView, heading: int) -> float:
    """Return the highest score of a heading among cells at most `SECTION` from the best, in x and in y."""
    _, iy, ix = view.best
    n_cells = math.floor(SECTION / view.space.cell_edge + 1e-6)
    rows, columns = (slice(max(0, index - n_cells), index + n_cells + 1) for index in (iy, ix))
    return float(np.max(view.scores[heading, rows, columns]))


def draw_section(axes: "Axes", view: SearchSpaceView, heading: int, norm: "Normalize") -> "AxesImage":
    """Draw the cells around the best one, and write turn and highest score above."""
    x, y = view.best_offset
    axes.set(xlim=(-SECTION, SECTION), ylim=(-SECTION, SECTION), facecolor=OUTSIDE)
    image = draw_scores(axes, view.scores[heading], ground_of(view.space, -x, -y), norm)
    is_best = view.has_best_at(heading)
    weight = "bold" if is_best else "normal"
    turn = turn_words(view.space, heading) + (" (best)" if is_best else "")
    axes.set_title(turn, loc="left", fontweight=weight, pad=5)
    axes.set_title(score_words(highest_in_section(view, heading)), loc="right", fontweight=weight, pad=5)
    draw_frame(axes, is_best=is_best)
    ticks = [-0.5 * SECTION, 0.0, 0.5 * SECTION]
    axes.set(xticks=ticks, yticks=ticks)
    return image


def section_words(view: SearchSpaceView, n_drawn: int) -> str:
    """Return the subtitle, in two lines: what the panels show."""
    n_headings = view.space.shape[0]
    which = "All" if n_drawn == n_headings else f"{n_drawn} of"
    return (
        f"{title_of(view.objective)}. {which} {n_headings} headings, ±{SECTION:g} m around the best cell.\n"
        "Above each: turn from the prior's heading, and the highest score shown. Grey: not searched."
    )


# Several epochs, objectives side by side (figure 4). Largest half width of the ground around the reference, m.
MOST_HALF_WIDTH = 35.0
SCAN_COLOR = SERIES[2]
# Inches: the panels, and what stands around them.
ROW_SIDE, ROW_LEFT, ROW_RIGHT, ROW_BOTTOM, ROW_TOP = 2.75, 0.3, 0.2, 0.95, 1.0
FIRST_GAP, VIEW_GAP, ROW_HEIGHT = 0.85, 0.55, 3.95
VIEWS_LEFT = ROW_LEFT + ROW_SIDE + FIRST_GAP


class ComparisonRow(NamedTuple):
    """One epoch, scored by several objectives.

    label: what is special about it: "crossing", "straight street".
    scan: sensor frame.
    reference: the pose held for true, local frame: where the highest score should be.
    views: at least two; they need not share an accumulator. Search around the reference to have it in the middle.
    """

    label: str
    scan: Scan
    point_map: PointMap
    reference: Pose
    views: Sequence[SearchSpaceView]


def plot_comparison(path: str | os.PathLike[str], rows: Sequence[ComparisonRow], *, title: str) -> None:
    """Draw one row per epoch: the scan in the map from above, and the search space of each objective.

    A search space is drawn at the heading of its best cell, with (0, 0) at the reference. Its colours run from
    0 (the lowest score, if negative) to its own highest: scores of different objectives have different units.
    """
    n_places = max(len(row.views) for row in rows)
    width = VIEWS_LEFT + n_places * (ROW_SIDE + VIEW_GAP) - VIEW_GAP + ROW_RIGHT
    words = (
        "Each square: all positions at the best heading, scored. Above it: where the best cell lies from the"
        "\nreference, in m and degrees. (0, 0) is right."
    )
    with saved_figure(path, width, ROW_TOP + len(rows) * ROW_HEIGHT + ROW_BOTTOM, title, words) as figure:
        for number, row in enumerate(rows):
            bottom = ROW_BOTTOM + (len(rows) - 1 - number) * ROW_HEIGHT + 0.55
            axes = add_axes(figure, ROW_LEFT, bottom, ROW_SIDE, ROW_SIDE)
            _draw_ground(axes, row)
            axes.set_title(row.label, loc="left", pad=12, parse_math=False, fontweight="bold")
            for column, view in enumerate(row.views):
                axes = add_axes(figure, VIEWS_LEFT + column * (ROW_SIDE + VIEW_GAP), bottom, ROW_SIDE, ROW_SIDE)
                draw_view(axes, view, row.reference)
                axes.set_title(view_words(view, row.reference), loc="left", pad=12, parse_math=False)
                axes.set_xlabel("x from the reference [m]")
                axes.set_ylabel("y from the reference [m]" if column == 0 else "")
        _draw_legend(figure, scale_words(view for row in rows for view in row.views))


def _draw_ground(axes: "Axes", row: ComparisonRow) -> None:
    """Draw the map around the reference, with nine tenths of the scan at the reference, without level ground."""
    points = row.reference.apply(row.scan.points[is_off_the_ground(row.scan, row.reference)])
    window = Window.around(row.reference.x, row.reference.y, half_width_of(row.scan, MOST_HALF_WIDTH))
    draw_map(axes, row.point_map, window)
    axes.plot(*points[:, :2].T, ls="", marker="o", mew=0, ms=1.2, color=SCAN_COLOR, zorder=2, rasterized=True)
    mark = cell_marks()[1]
    mark.set_markersize(10)
    put_mark(axes, mark, row.reference.x, row.reference.y)
    axes.set(xlabel="", ylabel="", xticks=[], yticks=[])
    draw_scale_bar(axes, window)


def draw_view(axes: "Axes", view: SearchSpaceView, reference: Pose) -> None:
    """Draw the best heading with the reference at (0, 0), and mark both."""
    from matplotlib.colors import Normalize

    x, y = view.offset(reference)
    ground = ground_of(view.space, -x, -y)
    xlim, ylim = (min(ground.west, 0.0), max(ground.east, 0.0)), (min(ground.south, 0.0), max(ground.north, 0.0))
    axes.set(xlim=xlim, ylim=ylim, facecolor=OUTSIDE)
    draw_scores(axes, view.scores[view.best[0]], ground, Normalize(*view.limits))
    best_mark, reference_mark = cell_marks()
    put_mark(axes, reference_mark, 0.0, 0.0)
    if view.has_best:
        put_mark(axes, best_mark, *best_from(view, reference)[:2])
    axes.locator_params(nbins=5)


def best_from(view: SearchSpaceView, reference: Pose) -> tuple[float, float, float]:
    """Return offset x, y (m) and turn (rad) of the best cell's pose from the reference."""
    pose = view.space.pose(view.best, view.accumulator.prior)
    return pose.x - reference.x, pose.y - reference.y, wrap_angle(pose.heading - reference.heading)


def view_words(view: SearchSpaceView, reference: Pose) -> str:
    """Return the title of a panel, and in a second line where its best cell lies from the reference."""
    name = view.title or title_of(view.objective)
    if not view.has_best:
        return f"{name}\nall cells score the same"
    x, y, turn = best_from(view, reference)
    return f"{name}\n(x = {offset_words(x)}, y = {offset_words(y)}), turn {offset_words(math.degrees(turn))}°"


def _draw_legend(figure: "Figure", words: str) -> None:
    """Draw the colour scale that all search spaces share, and the marks."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.lines import Line2D

    width, height = figure.get_size_inches()
    bar = add_axes(figure, VIEWS_LEFT, 0.5, ROW_SIDE, 0.15)
    figure.colorbar(ScalarMappable(cmap=COLORS), cax=bar, orientation="horizontal", ticks=[0.0, 0.5, 1.0])
    figure.text(VIEWS_LEFT / width, 0.75 / height, words, fontsize=10)
    dot = Line2D([], [], ls="", marker="o", ms=7, mew=0, color=SCAN_COLOR, label="scan at the reference")
    corner, beside = (ROW_LEFT - 0.1) / width, (VIEWS_LEFT + ROW_SIDE + VIEW_GAP) / width
    figure.legend(handles=[map_patch(), dot], loc="lower left", bbox_to_anchor=(corner, 0.18 / height))
    figure.legend(
        handles=cell_marks(), loc="lower left", bbox_to_anchor=(beside, 0.3 / height), ncols=2, handletextpad=1.0
    )
