# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Search spaces of several epochs, and on the ground."""

import math
import os
from collections.abc import Sequence

import numpy as np

from maxcon.errors import OptionError
from maxcon.geometry import Pose
from maxcon.plotting.canvas.figure import MUTED, draw_titles, saved_figure
from maxcon.plotting.canvas.from_above import Window
from maxcon.plotting.score_panel import (
    SearchSpaceView,
    cell_marks,
    draw_color_bar,
    draw_heading,
    ground_of,
    title_of,
    turn_words,
    unit_of,
)
from maxcon.search.accumulator import Accumulator
from maxcon.search.objectives import Scores


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


# Half width of the picture over the reach of a search space: it shows 75 m for the paper's space of 6 m.
WINDOW_REACHES, LEAST_HALF_WIDTH = 12.5, 5.0
# Least height of the picture over its width, for drives that run east or west.
FLATTEST = 0.7
# Least gap between two search spaces, as a part of their edge.
LEAST_GAP = 0.1


def window_around(accumulator: Accumulator, others: Sequence[Accumulator]) -> Window:
    """Return the ground to draw around an epoch: as flat as the drive allows.

    accumulator: of the epoch in the middle.
    others: of the other epochs.
    Returns 12.5 times the reach of the search space to the east and west (37.5 m for 3 m), and 0.7 to 1 times as much
        to the north and south: as far as the search spaces in the picture go.
    """
    prior = accumulator.prior
    half = max(WINDOW_REACHES * accumulator.space.reach, LEAST_HALF_WIDTH)
    square = Window.around(prior.x, prior.y, half)
    farthest = max(
        (abs(other.prior.y - prior.y) + 1.5 * other.space.reach for other in others if _is_inside(other, square)),
        default=0.0,
    )
    flat = min(half, max(FLATTEST * half, farthest))
    return Window(square.west, square.east, prior.y - flat, prior.y + flat)


def apart(accumulator: Accumulator, others: Sequence[Accumulator], window: Window) -> list[int]:
    """Return which of `others` can be drawn beside `accumulator`, and beside each other, in their order.

    accumulator: of the epoch that is drawn in any case.
    others: of the other epochs; the nearest is looked at first.
    window: what is drawn; search spaces that do not lie in it whole are left out.
    Returns indices into `others`, ascending.
    """
    here = accumulator.prior

    def distance(number: int) -> float:
        return float(np.hypot(others[number].prior.x - here.x, others[number].prior.y - here.y))

    kept: list[int] = []
    for number in sorted(range(len(others)), key=distance):
        drawn = [accumulator, *(others[index] for index in kept)]
        other = others[number]
        if _is_inside(other, window) and not any(_are_close(other, one) for one in drawn):
            kept.append(number)
    return sorted(kept)


def _is_inside(accumulator: Accumulator, window: Window) -> bool:
    prior = accumulator.prior
    ground = ground_of(accumulator.space, prior.x, prior.y)
    return (
        window.west <= ground.west
        and ground.east <= window.east
        and window.south <= ground.south
        and ground.north <= window.north
    )


def _are_close(one: Accumulator, other: Accumulator) -> bool:
    between = (1.0 + LEAST_GAP) * (one.space.reach + other.space.reach)
    return abs(one.prior.x - other.prior.x) < between and abs(one.prior.y - other.prior.y) < between


def highest_of_blocks(scores: Scores, edge: int) -> Scores:
    """Return the highest score of each square block of cells.

    scores: shape (ny, nx); of one heading.
    edge: cells along the side of a block.
    Returns shape (ceil(ny / edge), ceil(nx / edge)); blocks at the north and east may hold fewer cells.
    """
    rows, columns = (np.arange(0, length, edge) for length in scores.shape)
    blocks: Scores = np.maximum.reduceat(np.maximum.reduceat(scores, rows, axis=0), columns, axis=1)
    return blocks
