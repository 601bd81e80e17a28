# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The picture of one epoch: its search space in colours, beside its scene from above."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose, wrap_angle
from maxcon.map import PointMap
from maxcon.plotting.canvas.figure import draw_titles, saved_figure
from maxcon.plotting.scene import Scene, draw_scene
from maxcon.plotting.score_panel import (
    SearchSpaceView,
    cell_marks,
    chosen_headings,
    draw_color_bar,
    draw_frame,
    draw_heading,
    score_words,
    title_of,
    turn_words,
    unit_of,
)  # fmt: skip
from maxcon.scan import Scan
from maxcon.search.accumulator import Accumulator
from maxcon.search.objectives import Objective, as_objective

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

__all__ = ["plot_epoch"]

WIDTH, HEIGHT = 15.1, 9.35
# Inches: where the panels and the scene lie.
BOTTOM, SIDE = 1.25, 6.5
PANELS_LEFT, SCENE_LEFT = 0.85, 8.25


def plot_epoch(
    path: str | os.PathLike[str],
    *,
    accumulator: Accumulator,
    objective: Objective | str,
    estimate: Estimate,
    scan: Scan,
    point_map: PointMap,
    title: str,
    reference: Pose | None = None,
) -> None:
    """Draw the search space of an epoch, heading by heading, and the scan in the map from above.

    Parameters
    ----------
    path : path
        A .png or .svg to write.
    accumulator : Accumulator
        The moments of every cell, and the prior.
    objective : Objective or {"helmert", "count", "max-eigenvalue"}
        Scores the cells, for their colours.
    estimate : Estimate
        The answer that was found from them.
    scan : Scan
        Sensor frame.
    point_map : PointMap
        The map that was searched.
    title : str
        What is written above all.
    reference : Pose, optional
        The pose held for true, local frame; marked, and the distance to it is stated.

    Notes
    -----
    At most 9 headings are drawn: the best, and others in even steps. The scene ends 45 m from the prior.
    """
    view = SearchSpaceView(accumulator, as_objective(objective))
    scene = Scene(scan, point_map, accumulator.prior, accumulator.space, estimate, reference)
    with saved_figure(path, WIDTH, HEIGHT) as figure:
        draw_titles(figure, title, _answer_words(estimate, accumulator.prior, reference))
        _draw_panels(figure, view, reference)
        axes = figure.add_axes((SCENE_LEFT / WIDTH, BOTTOM / HEIGHT, SIDE / WIDTH, SIDE / HEIGHT))
        handles = draw_scene(axes, scene)
        figure.legend(
            handles=handles,
            loc="lower center",
            bbox_to_anchor=((SCENE_LEFT + 0.5 * SIDE) / WIDTH, 0.04 / HEIGHT),
            ncols=3,
            columnspacing=1.4,
        )


def _draw_panels(figure: Figure, view: SearchSpaceView, reference: Pose | None) -> None:
    """Draw one panel per heading, the best one in a frame, and their common colour scale."""
    from matplotlib.colors import Normalize

    headings = chosen_headings(view.space.shape[0], view.best[0])
    marked = -1 if reference is None else view.heading_nearest(reference, headings)
    norm = Normalize(*view.limits)
    first_of_row: dict[float, float] = {}
    for heading, (left, bottom, side) in zip(headings, _panel_places(len(headings)), strict=True):
        axes = figure.add_axes((left / WIDTH, bottom / HEIGHT, side / WIDTH, side / HEIGHT))
        image = draw_heading(axes, view, heading, norm, reference if heading == marked else None)
        is_best = view.has_best_at(heading)
        axes.set_title(
            turn_words(view.space, heading) + (" (best)" if is_best else ""),
            fontweight="bold" if is_best else "normal",
            pad=5,
        )
        draw_frame(axes, is_best=is_best)
        is_first = first_of_row.setdefault(bottom, left) == left
        axes.tick_params(labelleft=is_first, labelbottom=bottom == BOTTOM)
    _draw_scale(figure, view, image, len(headings), reference)


def _panel_places(n_panels: int) -> list[tuple[float, float, float]]:
    """Left, bottom and side of each panel, inches: rows are centred and of nearly equal length."""
    n_rows = math.isqrt(n_panels - 1) + 1
    lengths = [len(range(row, n_panels, n_rows)) for row in range(n_rows)]
    gap = 0.34
    side = (SIDE - gap * (n_rows - 1)) / n_rows
    places = []
    for row, length in enumerate(lengths):
        left = PANELS_LEFT + 0.5 * (SIDE - length * (side + gap) + gap)
        bottom = BOTTOM + (n_rows - 1 - row) * (side + gap)
        places += [(left + column * (side + gap), bottom, side) for column in range(length)]
    return places


def _draw_scale(figure: Figure, view: SearchSpaceView, image: AxesImage, n_drawn: int, reference: Pose | None) -> None:
    """Write what the panels are, with the colour scale below and the marks above."""
    n_headings = view.space.shape[0]
    n_words = f"All {n_headings}" if n_drawn == n_headings else f"{n_drawn} of {n_headings}"
    drawn = "The prior's heading" if n_headings == 1 else f"{n_words} headings about the prior's"
    top = (BOTTOM + SIDE + 0.42) / HEIGHT
    cells = f"cells of {100.0 * view.space.cell_edge:g} cm"
    figure.text(PANELS_LEFT / WIDTH, top, f"{drawn}, {cells}", fontsize=11)
    figure.legend(
        handles=cell_marks()[0 if view.has_best else 1 : 1 if reference is None else 2],
        loc="center right",
        bbox_to_anchor=((PANELS_LEFT + SIDE) / WIDTH, top + 0.07 / HEIGHT),
        ncols=2,
        borderpad=0.0,
        handletextpad=1.0,
        borderaxespad=0.0,
    )
    center = (PANELS_LEFT + 0.5 * SIDE) / WIDTH
    figure.text(center, 0.76 / HEIGHT, "x from the prior [m]", ha="center", fontsize=10.5)
    figure.text(
        0.2 / WIDTH, (BOTTOM + 0.5 * SIDE) / HEIGHT, "y from the prior [m]", va="center", rotation=90, fontsize=10.5
    )
    bar = figure.add_axes((PANELS_LEFT / WIDTH, 0.46 / HEIGHT, 3.7 / WIDTH, 0.15 / HEIGHT))
    draw_color_bar(figure, image, bar, "horizontal")
    figure.text(
        (PANELS_LEFT + 3.85) / WIDTH,
        0.53 / HEIGHT,
        f"{title_of(view.objective)} [{unit_of(view.objective)}]",
        fontsize=10.5,
        va="center",
        parse_math=False,
    )


def _answer_words(estimate: Estimate, prior: Pose, reference: Pose | None) -> str:
    """Return the answer in plain words, in two lines; the reason to doubt it in a third."""
    reason = f"\n{estimate.reason[:1].upper()}{estimate.reason[1:]}" if estimate.reason else ""
    if estimate.status is Status.NO_MATCH:
        return f"NOT LOCALIZED: {estimate.status.value}.\n{estimate.status.explanation}{reason}"
    pose = estimate.pose
    turn = math.degrees(wrap_angle(pose.heading - prior.heading))
    words = (
        f"Answer: {pose.x - prior.x:+.2f} m in x, {pose.y - prior.y:+.2f} m in y, {turn:+.2f}°"
        f" from the prior; score {score_words(estimate.score)}"
    ).replace("-", "−")
    if estimate.cell is None:
        words += ", in smaller cells than are drawn"
    if reference is not None:
        error = math.hypot(pose.x - reference.x, pose.y - reference.y)
        error_deg = math.degrees(abs(wrap_angle(pose.heading - reference.heading)))
        words += f"; {error:.2f} m and {error_deg:.2f}° from the reference"
    headline = "Localized." if estimate.is_localized else f"NOT LOCALIZED: {estimate.status.value}."
    return f"{headline} {estimate.status.explanation}\n{words}{reason}"
