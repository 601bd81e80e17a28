# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The peak of a search space heading by heading: a section around the best cell (the paper's figure 2)."""

import math
import os
from typing import TYPE_CHECKING

import numpy as np

from maxcon.errors import OptionError
from maxcon.geometry import Pose
from maxcon.plotting.canvas.figure import MUTED, draw_titles, saved_figure
from maxcon.plotting.canvas.from_above import Window
from maxcon.plotting.score_panel import (
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
)
from maxcon.search.accumulator import Accumulator
from maxcon.search.objectives import Objective

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

__all__ = ["plot_headings"]

N_COLUMNS = 3
# Inches: width of all panels together, and the room around them.
PANELS, LEFT, RIGHT, BOTTOM, TOP = 7.7, 0.85, 1.05, 0.65, 1.35
GAP, ROW_GAP, MOST_SIDE = 0.2, 0.4, 4.4
OUTSIDE = "#d9d9d9"


def plot_headings(
    path: str | os.PathLike[str],
    accumulator: Accumulator,
    objective: Objective,
    *,
    title: str,
    reference: Pose | None = None,
    half_width: float = 1.0,
) -> None:
    """Draw a section around the best cell, one panel per heading, in one scale of colours.

    path: a .png or .svg to write.
    accumulator: the moments of every cell.
    objective: scores the cells, for their colours.
    title: what is written above all.
    reference: the pose held for true, local frame; marked in the heading nearest to it, if it lies in the section.
    half_width: from the best cell to the edge of a panel, m.

    At most 9 headings are drawn: the best, and others in even steps. Above each stand its turn from the
    prior's heading and the highest score of the section; what lies outside the search space is grey.
    """
    if not (math.isfinite(half_width) and half_width > 0.0):
        raise OptionError(
            f"Expected the half width of the section to be a positive number, got {half_width}. Take 1 m?"
        )
    view = SearchSpaceView(accumulator, objective)
    headings = chosen_headings(view.space.shape[0], view.best[0])
    side, places, height = _panel_places(len(headings))
    width = LEFT + PANELS + RIGHT
    with saved_figure(path, width, height) as figure:
        from matplotlib.colors import Normalize

        draw_titles(figure, title, _words(view, len(headings), half_width))
        norm = Normalize(*view.limits)
        for number, (heading, (left, bottom)) in enumerate(zip(headings, places, strict=True)):
            axes = figure.add_axes((left / width, bottom / height, side / width, side / height))
            image = _draw_section(axes, view, heading, half_width, norm)
            if reference is not None and heading == view.heading_nearest(reference, headings):
                _draw_reference(axes, view, half_width, reference)
            axes.tick_params(labelleft=number % N_COLUMNS == 0, labelbottom=number + N_COLUMNS >= len(places))
        _draw_around(figure, view, image, places[0][0], reference)


def _panel_places(n_panels: int) -> tuple[float, list[tuple[float, float]], float]:
    """Side of all panels, left and bottom of each, and height of the figure, inches; rows begin at the left."""
    n_columns = min(n_panels, N_COLUMNS)
    n_rows = math.ceil(n_panels / n_columns)
    side = min(MOST_SIDE, (PANELS - GAP * (n_columns - 1)) / n_columns)
    indent = LEFT + 0.5 * (PANELS - n_columns * (side + GAP) + GAP)
    places = []
    for number in range(n_panels):
        row, column = divmod(number, n_columns)
        places.append((indent + column * (side + GAP), BOTTOM + (n_rows - 1 - row) * (side + ROW_GAP)))
    return side, places, BOTTOM + n_rows * (side + ROW_GAP) - ROW_GAP + TOP


def _highest_in_section(view: SearchSpaceView, heading: int, half_width: float) -> float:
    """Return the highest score of a heading among cells at most `half_width` from the best, in x and in y."""
    _, iy, ix = view.best
    n_cells = math.floor(half_width / view.space.cell_edge + 1e-6)
    rows = slice(max(0, iy - n_cells), iy + n_cells + 1)
    columns = slice(max(0, ix - n_cells), ix + n_cells + 1)
    return float(np.max(view.scores[heading, rows, columns]))


def _draw_section(
    axes: "Axes", view: SearchSpaceView, heading: int, half_width: float, norm: "Normalize"
) -> "AxesImage":
    """Draw the cells around the best one, and write turn and highest score above."""
    x, y = view.best_offset
    axes.set(xlim=(-half_width, half_width), ylim=(-half_width, half_width), facecolor=OUTSIDE)
    image = draw_scores(axes, view.scores[heading], ground_of(view.space, -x, -y), norm)
    is_best = view.has_best_at(heading)
    weight = "bold" if is_best else "normal"
    turn = turn_words(view.space, heading) + (" (best)" if is_best else "")
    axes.set_title(turn, loc="left", fontweight=weight, pad=5)
    axes.set_title(score_words(_highest_in_section(view, heading, half_width)), loc="right", fontweight=weight, pad=5)
    draw_frame(axes, is_best=is_best)
    ticks = [-0.5 * half_width, 0.0, 0.5 * half_width]
    axes.set(xticks=ticks, yticks=ticks)
    return image


def _draw_reference(axes: "Axes", view: SearchSpaceView, half_width: float, reference: Pose) -> None:
    """Mark the reference, if it lies in the section."""
    x, y = view.offset(reference)
    best_x, best_y = view.best_offset
    if max(abs(x - best_x), abs(y - best_y)) <= half_width:
        put_mark(axes, cell_marks()[1], x - best_x, y - best_y)


def _draw_around(
    figure: "Figure", view: SearchSpaceView, image: "AxesImage", left: float, reference: Pose | None
) -> None:
    """Draw the axes' labels, the colour scale at the right and the marks above; panels begin at `left`."""
    width, height = figure.get_size_inches()
    middle = BOTTOM + 0.5 * (height - BOTTOM - TOP)
    figure.text((LEFT + 0.5 * PANELS) / width, 0.2 / height, "x from the best cell [m]", ha="center", fontsize=10.5)
    figure.text(
        (left - 0.65) / width, middle / height, "y from the best cell [m]", va="center", rotation=90, fontsize=10.5
    )
    bar = figure.add_axes(
        ((2.0 * LEFT + PANELS - left + 0.2) / width, BOTTOM / height, 0.15 / width, (height - BOTTOM - TOP) / height)
    )
    draw_color_bar(figure, image, bar, "vertical")
    bar.set_title(unit_of(view.objective), fontsize=9, loc="left", color=MUTED, parse_math=False)
    if reference is not None:
        figure.legend(
            handles=cell_marks()[1:], loc="upper right", bbox_to_anchor=(1.0, 1.0 - 0.1 / height), handletextpad=1.0
        )


def _words(view: SearchSpaceView, n_drawn: int, half_width: float) -> str:
    """Return the subtitle, in two lines: what the panels show."""
    n_headings = view.space.shape[0]
    which = "All" if n_drawn == n_headings else f"{n_drawn} of"
    drawn = "The prior's heading" if n_headings == 1 else f"{which} {n_headings} headings"
    section, space = Window.around(*view.best_offset, half_width), ground_of(view.space, 0.0, 0.0)
    is_cut = min(section.west, section.south) < space.west or max(section.east, section.north) > space.east
    outside = " Grey: outside the search space." if is_cut else ""
    return (
        f"{title_of(view.objective)}. {drawn}, ±{half_width:g} m around the best cell.\n"
        f"Above each: turn from the prior's heading, and the highest score shown.{outside}"
    )
