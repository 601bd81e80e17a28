# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The method at a glance: map, scan, consensus set, and search spaces along the drive (the paper's figure 3)."""

import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from maxcon.errors import OptionError
from maxcon.estimate import Estimate
from maxcon.geometry import Pose
from maxcon.lab.report.plots.search_spaces import apart, highest_of_blocks, window_around
from maxcon.map import PointMap
from maxcon.plotting.canvas.figure import MUTED, draw_titles, saved_figure
from maxcon.plotting.canvas.from_above import Window, draw_map, draw_scale_bar, map_patch
from maxcon.plotting.scene import CONSENSUS_COLOR, PRIOR_COLOR, Scene, draw_points
from maxcon.plotting.score_panel import (
    COLORS,
    SearchSpaceView,
    cell_marks,
    draw_scores,
    ground_of,
    put_mark,
    scale_words,
    title_of,
)
from maxcon.scan import Scan
from maxcon.search.accumulator import Accumulator
from maxcon.search.objectives import Objective

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

__all__ = ["plot_overview"]

# More squares along a search space would be finer than the picture's pixels.
MOST_BLOCKS = 50
# Exponent of the colour scale: in squares this small, all but the peak would be dark on a linear one.
COLOR_POWER = 0.5
WIDTH = 9.2
# Inches: the map from above, and what stands around it.
LEFT, RIGHT, BOTTOM, TOP = 0.8, 0.2, 1.95, 1.05


def plot_overview(
    path: str | os.PathLike[str],
    *,
    point_map: PointMap,
    scan: Scan,
    prior: Pose,
    estimate: Estimate,
    accumulator: Accumulator,
    objective: Objective,
    others: Sequence[tuple[Accumulator, Estimate]] = (),
    title: str,
) -> None:
    """Draw one epoch from above, with its search space and those of other epochs on the ground.

    path: a .png or .svg to write.
    point_map: the map, drawn in grey.
    scan: sensor frame; drawn at the prior, without level ground.
    prior: T_map_sensor before localization, local frame.
    estimate: the answer; the consensus set is drawn at its pose.
    accumulator: the moments of every cell of this epoch.
    objective: scores the cells, for their colours.
    others: other epochs of the drive. Those are left out whose search space would overlap or nearly touch that of an
        epoch nearer by, or would not fit into the picture.
    title: what is written above all.

    Each search space is drawn at the heading of its best cell, in colours from 0 (the lowest score, if
    negative) to its own highest; they follow the root of the score, which shows rays of a few tenths of the peak.
    Cells too small for the picture are drawn as blocks, each with its highest score: no peak is lost.
    """
    if prior != accumulator.prior:
        raise OptionError(
            "Expected `prior` to be the one that was searched around,"
            f" x {accumulator.prior.x:.3f}, y {accumulator.prior.y:.3f} m, got x {prior.x:.3f}, y {prior.y:.3f} m."
            " Give the accumulator of this scan."
        )
    scene = Scene(scan, point_map, prior, accumulator.space, estimate)
    rest = [other for other, _ in others]
    window = window_around(accumulator, rest)
    epochs = [(accumulator, estimate), *(others[number] for number in apart(accumulator, rest, window))]
    views = [SearchSpaceView(searched, objective) for searched, _ in epochs]
    are_localized = [found.is_localized for _, found in epochs]
    side = WIDTH - LEFT - RIGHT
    drawn_height = side * window.size[1] / window.size[0]
    height = drawn_height + BOTTOM + TOP
    with saved_figure(path, WIDTH, height) as figure:
        draw_titles(figure, title, _words(estimate, objective, accumulator))
        axes = figure.add_axes((LEFT / WIDTH, BOTTOM / height, side / WIDTH, drawn_height / height))
        draw_map(axes, point_map, window)
        handles = _draw_scan(axes, scene)
        for number, (view, is_localized) in enumerate(zip(views, are_localized, strict=True)):
            _draw_space(axes, view, is_localized, is_this=number == 0)
        draw_scale_bar(axes, window)
        _draw_legend(figure, handles, views, are_localized)


def _draw_scan(axes: "Axes", scene: Scene) -> list["Artist"]:
    """Draw the scan at the prior and, if anything matched, the consensus set at the answer."""
    is_matched = scene.is_matched
    points = scene.prior.apply(scene.scan.points[scene.is_drawn])
    sets = [("scan at the prior", PRIOR_COLOR, points, 1.3)]
    if scene.has_answer:
        points = scene.estimate.pose.apply(scene.scan.points[is_matched])
        sets.append((f"consensus set ({is_matched.sum():,} points)", CONSENSUS_COLOR, points, 2.0))
    return [map_patch(), *draw_points(axes, sets)]


def _draw_space(axes: "Axes", view: SearchSpaceView, is_localized: bool, is_this: bool) -> None:
    """Draw the scores of the best heading on the ground, in a frame, with a mark at the best cell."""
    from matplotlib.colors import PowerNorm
    from matplotlib.patches import Rectangle

    prior, space = view.accumulator.prior, view.space
    ground = ground_of(space, prior.x, prior.y)
    edge = math.ceil(space.shape[2] / MOST_BLOCKS)
    blocks = highest_of_blocks(view.scores[view.best[0]], edge)
    ny, nx = blocks.shape
    covered = Window(
        ground.west, ground.west + nx * edge * space.cell_edge, ground.south, ground.south + ny * edge * space.cell_edge
    )
    draw_scores(axes, blocks, covered, PowerNorm(COLOR_POWER, *view.limits), zorder=5.0)
    color, line_width = _frame(is_this)
    axes.add_patch(
        Rectangle((covered.west, covered.south), *covered.size, fill=False, ec=color, lw=line_width, zorder=5.5)
    )
    if view.has_best:
        x, y = view.best_offset
        put_mark(axes, _mark(is_localized), prior.x + x, prior.y + y)


def _frame(is_this: bool) -> tuple[str, float]:
    """Colour and width of the frame around a search space."""
    return ("black", 2.6) if is_this else (MUTED, 0.8)


def _mark(is_localized: bool) -> "Line2D":
    """Return the mark of a best cell: a ring, or a cross where the answer may not be used."""
    mark = cell_marks()[0]
    mark.set(markersize=8, markeredgewidth=1.3, zorder=6)
    if not is_localized:
        mark.set(marker="x", label="best cell, not localized")
    return mark


def _draw_legend(
    figure: "Figure", handles: list["Artist"], views: Sequence[SearchSpaceView], are_localized: Sequence[bool]
) -> None:
    """Draw the colour scale of the search spaces, and below it what else there is."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import PowerNorm
    from matplotlib.patches import Patch

    width, height = figure.get_size_inches()
    bar = figure.add_axes((LEFT / width, 1.2 / height, 2.6 / width, 0.15 / height))
    scale = ScalarMappable(PowerNorm(COLOR_POWER, 0.0, 1.0), cmap=COLORS)
    figure.colorbar(scale, cax=bar, orientation="horizontal", ticks=[0.0, 0.1, 0.25, 0.5, 1.0], format="%g")
    words = f"{scale_words(views)} (root scale)"
    figure.text((LEFT + 2.75) / width, 1.27 / height, words, fontsize=10, va="center")
    names = ["search space of this epoch", "search spaces of other epochs"]
    for number, name in enumerate(names[: len(views)]):
        color, line_width = _frame(number == 0)
        handles.append(Patch(fill=False, ec=color, lw=line_width, label=name))
    marked = {good for view, good in zip(views, are_localized, strict=True) if view.has_best}
    handles += [_mark(is_localized) for is_localized in sorted(marked, reverse=True)]
    figure.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=((LEFT - 0.1) / width, 0.93 / height),
        ncols=3,
        columnspacing=1.4,
    )


def _words(estimate: Estimate, objective: Objective, accumulator: Accumulator) -> str:
    """Return the subtitle: what the squares are, and whether this epoch is localized."""
    edge = 2.0 * accumulator.space.reach
    headline = "localized" if estimate.is_localized else f"NOT LOCALIZED: {estimate.status.value}"
    return (
        f"Each square on the ground: every position tried for one epoch, {edge:g} m × {edge:g} m, at the best"
        f" heading;\ncolours: {title_of(objective)}. This epoch is {headline}."
        " Its scan is drawn without level ground."
    )
