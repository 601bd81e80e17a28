# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Search spaces in colours: on the map along the drive (the paper's figure 3), objectives side by side (figure 4)."""

import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from maxcon.estimate import Estimate
from maxcon.geometry import Pose, wrap_angle
from maxcon.lab.charts import offset_words, scale_words
from maxcon.map import PointMap
from maxcon.plotting.epoch import Scene, draw_points, half_width_of, is_off_the_ground
from maxcon.plotting.figure import MUTED, SERIES, saved_figure
from maxcon.plotting.from_above import Window, draw_map, draw_scale_bar, map_figure, map_patch
from maxcon.plotting.score_panel import (
    COLOR_POWER,
    COLORS,
    SearchSpaceView,
    cell_marks,
    draw_scores,
    ground_of,
    put_mark,
    title_of,
)  # fmt: skip
from maxcon.scan import Scan
from maxcon.search.accumulator import Accumulator
from maxcon.search.objectives import Objective, Scores

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

# --- one epoch from above, with search spaces along the drive (figure 3) --------------------------------------

# More squares along a search space would be finer than the picture's pixels.
MOST_BLOCKS = 50
# Colour and line width of the frame of a search space: of this epoch, and of others.
FRAMES = (("black", 2.6), (MUTED, 0.8))
# Half width of the picture over the reach of a search space: it shows 75 m for the paper's space of 6 m.
WINDOW_REACHES = 12.5


def plot_overview(
    path: str | os.PathLike[str],
    *,
    point_map: PointMap,
    scan: Scan,
    estimate: Estimate,
    accumulator: Accumulator,
    objective: Objective,
    others: Sequence[tuple[Accumulator, Estimate]] = (),
    title: str,
) -> None:
    """Draw one epoch from above, with its search space and those of other epochs on the ground.

    scan: sensor frame; drawn at the prior, without level ground.
    estimate: the answer; the consensus set is drawn at its pose.
    accumulator: the moments of every cell of this epoch.
    others: other epochs of the drive, in the picture and clear of each other.

    Each search space is drawn at the heading of its best cell, in colours from 0 (the lowest score, if
    negative) to its own highest; they follow the root of the score, which shows rays of a few tenths of the peak.
    Cells too small for the picture are drawn as blocks, each with its highest score: no peak is lost.
    """
    scene = Scene(scan, point_map, accumulator.prior, accumulator.space, estimate)
    window = Window.around(accumulator.prior.x, accumulator.prior.y, WINDOW_REACHES * accumulator.space.reach)
    epochs = [(accumulator, estimate), *others]
    views = [SearchSpaceView(searched, objective) for searched, _ in epochs]
    are_localized = [found.is_localized for _, found in epochs]
    words = overview_words(estimate, objective, accumulator)
    with map_figure(path, window, point_map, (title, words), side=8.2) as (figure, axes):
        handles = [map_patch(), *draw_points(axes, scene.point_sets(with_rest=False))]
        for number, (view, is_localized) in enumerate(zip(views, are_localized, strict=True)):
            draw_space(axes, view, is_localized, is_this=number == 0)
        _draw_overview_legend(figure, axes, handles, views, are_localized)


def draw_space(axes: "Axes", view: SearchSpaceView, is_localized: bool, is_this: bool) -> None:
    """Draw the scores of the best heading on the ground, in a frame, with a mark at the best cell."""
    from matplotlib.patches import Rectangle

    prior, space = view.accumulator.prior, view.space
    west, _, south, _ = ground_of(space, prior.x, prior.y)
    edge = math.ceil(space.shape[2] / MOST_BLOCKS)
    blocks = highest_of_blocks(view.scores[view.best[0]], edge)
    ny, nx = (n * edge * space.cell_edge for n in blocks.shape)
    covered = Window(west, west + nx, south, south + ny)
    draw_scores(axes, blocks, covered, view.norm, zorder=5.0)
    color, line_width = FRAMES[0 if is_this else 1]
    axes.add_patch(Rectangle((west, south), nx, ny, fill=False, ec=color, lw=line_width, zorder=5.5))
    if view.has_best:
        x, y = view.best_offset
        put_mark(axes, _mark(is_localized), prior.x + x, prior.y + y)


def _mark(is_localized: bool) -> "Line2D":
    """Return the mark of a best cell: a ring, or a cross where the answer may not be used."""
    mark = cell_marks()[0]
    mark.set(markersize=8, markeredgewidth=1.3, zorder=6)
    if not is_localized:
        mark.set(marker="x", label="best cell, not localized")
    return mark


def _draw_overview_legend(
    figure: "Figure",
    axes: "Axes",
    handles: list["Artist"],
    views: Sequence[SearchSpaceView],
    are_localized: Sequence[bool],
) -> None:
    """Draw the colour scale of the search spaces, and below it what else there is."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import PowerNorm
    from matplotlib.patches import Patch

    scale = ScalarMappable(PowerNorm(COLOR_POWER, 0.0, 1.0), cmap=COLORS)
    figure.colorbar(
        scale, ax=axes, ticks=[0.0, 0.1, 0.25, 0.5, 1.0], format="%g", shrink=0.6,
        label=f"{scale_words(views)} (root scale)",
    )  # fmt: skip
    names = ["search space of this epoch", "search spaces of other epochs"][: len(views)]
    for name, (color, line_width) in zip(names, FRAMES, strict=False):
        handles.append(Patch(fill=False, ec=color, lw=line_width, label=name))
    marked = {good for view, good in zip(views, are_localized, strict=True) if view.has_best}
    handles += [_mark(is_localized) for is_localized in sorted(marked, reverse=True)]
    figure.legend(handles=handles, loc="outside lower left", ncols=2, columnspacing=1.4)


def overview_words(estimate: Estimate, objective: Objective, accumulator: Accumulator) -> str:
    """Return the subtitle: what the squares are, and whether this epoch is localized."""
    edge = 2.0 * accumulator.space.reach
    headline = "localized" if estimate.is_localized else f"NOT LOCALIZED: {estimate.status.value}"
    return (
        f"Each square on the ground: every position tried for one epoch, {edge:g} m × {edge:g} m, at the best"
        f" heading;\ncolours: {title_of(objective)}. This epoch is {headline}."
        " Its scan is drawn without level ground."
    )


def highest_of_blocks(scores: Scores, edge: int) -> Scores:
    """Return the highest score of each square block of `edge` cells, shape (ceil(ny / edge), ceil(nx / edge))."""
    rows, columns = (np.arange(0, length, edge) for length in scores.shape)
    blocks: Scores = np.maximum.reduceat(np.maximum.reduceat(scores, rows, axis=0), columns, axis=1)
    return blocks


# --- several epochs, objectives side by side (figure 4) ------------------------------------------------------

OUTSIDE = "#d9d9d9"
# Largest half width of the ground around the reference, m.
MOST_HALF_WIDTH = 35.0
SCAN_COLOR = SERIES[2]


class ComparisonRow(NamedTuple):
    """One epoch, scored by several objectives."""

    label: str  # what is special about it: "crossing", "straight street"
    scan: Scan  # sensor frame
    point_map: PointMap
    reference: Pose  # the pose held for true, local frame: where the highest score should be
    # At least two; they need not share an accumulator. Search around the reference to have it in the middle.
    views: Sequence[SearchSpaceView]


def plot_comparison(path: str | os.PathLike[str], rows: Sequence[ComparisonRow], *, title: str) -> None:
    """Draw one row per epoch: the scan in the map from above, and the search space of each objective.

    A search space is drawn at the heading of its best cell, with (0, 0) at the reference. Its colours run from
    0 (the lowest score, if negative) to its own highest, on a root scale: scores of different objectives have
    different units.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import PowerNorm
    from matplotlib.lines import Line2D

    n_places = max(len(row.views) for row in rows)
    words = (
        "Each square: all positions at the best heading, scored. Above it: where the best cell lies from the"
        "\nreference, in m and degrees. (0, 0) is right."
    )
    with saved_figure(path, 1.2 + 3.5 * (1 + n_places), 3.7 * len(rows) + 2.1, title, words) as figure:
        panels = figure.subplots(len(rows), 1 + n_places, squeeze=False)
        for (ground, *places), row in zip(panels, rows, strict=True):
            _draw_ground(ground, row)
            ground.set_title(row.label, loc="left", pad=12, parse_math=False, fontweight="bold")
            for axes, view in zip(places, row.views, strict=True):
                draw_view(axes, view, row.reference)
                axes.set_title(view_words(view, row.reference), loc="left", pad=12, parse_math=False)
                axes.set_xlabel("x from the reference [m]")
            places[0].set_ylabel("y from the reference [m]")
        scale = ScalarMappable(PowerNorm(COLOR_POWER, 0.0, 1.0), cmap=COLORS)
        words = f"{scale_words(view for row in rows for view in row.views)} (root scale)"
        figure.colorbar(scale, ax=panels[:, -1], ticks=[0.0, 0.1, 0.5, 1.0], format="%g", label=words, shrink=0.9)
        dot = Line2D([], [], ls="", marker="o", ms=7, mew=0, color=SCAN_COLOR, label="scan at the reference")
        figure.legend(handles=[map_patch(), dot, *cell_marks()], loc="outside lower left", ncols=4)


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
    x, y = view.offset(reference)
    ground = ground_of(view.space, -x, -y)
    xlim, ylim = (min(ground.west, 0.0), max(ground.east, 0.0)), (min(ground.south, 0.0), max(ground.north, 0.0))
    axes.set(xlim=xlim, ylim=ylim, facecolor=OUTSIDE)
    draw_scores(axes, view.scores[view.best[0]], ground, view.norm)
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
