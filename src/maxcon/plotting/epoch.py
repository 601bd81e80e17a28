"""The picture of one epoch: its search space in colours, beside its scene from above."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maxcon.estimate import Estimate, Status
from maxcon.geometry import Pose, wrap_angle
from maxcon.map import PointMap
from maxcon.plotting import score_panel
from maxcon.plotting.figure import INK, MUTED, Window, draw_map, draw_scale_bar, map_patch, saved_figure
from maxcon.scan import Scan
from maxcon.search import consensus_set
from maxcon.search.accumulator import Accumulator
from maxcon.search.objectives import Objective, as_objective
from maxcon.search.space import SearchSpace

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.image import AxesImage


def plot_epoch(
    path: str | os.PathLike[str] | None, *, accumulator: Accumulator, objective: Objective | str, estimate: Estimate,
    scan: Scan, point_map: PointMap, title: str, reference: Pose | None = None,
) -> Figure:  # fmt: skip
    """Draw the search space of an epoch, heading by heading, and the scan in the map from above.

    - path: a .png or .svg to write; None: only the figure is returned, as notebooks show it.
    - accumulator: the moments of every cell, and the prior.
    - objective: scores the cells, for their colours: one of yours, "helmert", "count" or "max-eigenvalue".
    - estimate: the answer that was found from them.
    - scan: sensor frame.
    - point_map: the map that was searched.
    - title: written above all.
    - reference: the pose held for true, local frame; marked, and the distance to it is stated.

    At most 9 headings are drawn: the best, and others in even steps. The scene ends 45 m from the prior. With a panel
    for each it fills a figure, and takes no axes: those of the panels and of the scene are in `figure.subfigs`.
    """
    view = score_panel.SearchSpaceView(accumulator, as_objective(objective))
    scene = Scene(scan, point_map, accumulator.prior, accumulator.space, estimate, reference)
    words = answer_words(estimate, accumulator.prior, reference)
    with saved_figure(path, 15.1, 9.35, title, words) as figure:
        left, right = figure.subfigures(1, 2, squeeze=False)[0]
        _draw_panels(left, view, reference)
        handles = draw_scene(right.subplots(), scene)
        right.legend(handles=handles, loc="outside lower center", ncols=3, columnspacing=1.4)
    return figure


def _draw_panels(figure: SubFigure, view: score_panel.SearchSpaceView, reference: Pose | None) -> None:
    """Draw one panel per heading, the best one in a frame, their common colour scale, and what they are."""
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    n_headings = view.space.shape[0]
    headings = score_panel.chosen_headings(n_headings, view.best[0])
    marked = None if reference is None else view.heading_nearest(reference, headings)
    n_columns = math.isqrt(len(headings) - 1) + 1
    panels = figure.subplots(-(-len(headings) // n_columns), n_columns, squeeze=False, sharex=True, sharey=True)
    for axes in panels.flat[len(headings) :]:
        axes.set_visible(False)
    for heading, axes in zip(headings, panels.flat, strict=False):
        image = _draw_heading(axes, view, heading, reference if heading == marked else None)
    n_words = f"All {n_headings}" if len(headings) == n_headings else f"{len(headings)} of {n_headings}"
    drawn = "The prior's heading" if n_headings == 1 else f"{n_words} headings about the prior's"
    figure.suptitle(f"{drawn}, cells of {100.0 * view.space.cell_edge:g} cm", fontsize=11)
    for axes in panels[-1]:
        axes.set_xlabel("x from the prior [m]")
    for axes in panels[:, 0]:
        axes.set_ylabel("y from the prior [m]")
    digits = FuncFormatter(lambda value, _: f"{value:,.6g}".replace("-", "−"))
    bar = figure.colorbar(
        image, ax=panels, orientation="horizontal", shrink=0.6, aspect=30, ticks=MaxNLocator(5), format=digits
    )
    bar.set_label(
        f"{score_panel.title_of(view.objective)} [{score_panel.unit_of(view.objective)}] (root scale)", parse_math=False
    )
    marks = score_panel.cell_marks()[0 if view.has_best else 1 : 1 if reference is None else 2]
    figure.legend(handles=marks, loc="outside lower center", ncols=2, handletextpad=1.0)


def _draw_heading(axes: Axes, view: score_panel.SearchSpaceView, heading: int, reference: Pose | None) -> AxesImage:
    """Draw all cells of one heading, in a strong frame if it has the best cell, and the reference if it is here."""
    ground = score_panel.ground_of(view.space, 0.0, 0.0)
    axes.set(xlim=(ground.west, ground.east), ylim=(ground.south, ground.north))
    image = score_panel.draw_scores(axes, view.scores[heading], ground, view.norm)
    best_mark, reference_mark = score_panel.cell_marks()
    if reference is not None and all(ground.west <= value <= ground.east for value in view.offset(reference)):
        score_panel.put_mark(axes, reference_mark, *view.offset(reference))
    is_best = view.has_best and heading == view.best[0]
    if is_best:
        score_panel.put_mark(axes, best_mark, *view.best_offset)
    words = score_panel.turn_words(view.space, heading) + (" (best)" if is_best else "")
    axes.set_title(words, fontweight="bold" if is_best else "normal", pad=5)
    for spine in axes.spines.values():
        spine.set(color=INK if is_best else MUTED, linewidth=3.0 if is_best else 0.8)
    axes.locator_params(nbins=5)
    return image


def answer_words(estimate: Estimate, prior: Pose, reference: Pose | None) -> str:
    """Return the answer in plain words, in two lines; the reason to doubt it in a third."""
    reason = f"\n{estimate.reason[:1].upper()}{estimate.reason[1:]}" if estimate.reason else ""
    if estimate.status is Status.NO_MATCH:
        return f"NOT LOCALIZED: {estimate.status.value}.\n{estimate.status.explanation}{reason}"
    pose = estimate.pose
    turn = math.degrees(wrap_angle(pose.heading - prior.heading))
    words = (
        f"Answer: {pose.x - prior.x:+.2f} m in x, {pose.y - prior.y:+.2f} m in y, {turn:+.2f}°"
        f" from the prior; score {score_panel.score_words(estimate.score)}"
    ).replace("-", "−")
    if estimate.cell is None:
        words += ", in smaller cells than are drawn"
    if reference is not None:
        error = math.hypot(pose.x - reference.x, pose.y - reference.y)
        error_deg = math.degrees(abs(wrap_angle(pose.heading - reference.heading)))
        words += f"; {error:.2f} m and {error_deg:.2f}° from the reference"
    headline = "Localized." if estimate.is_localized else f"NOT LOCALIZED: {estimate.status.value}."
    return f"{headline} {estimate.status.explanation}\n{words}{reason}"


# The scene from above: the map, the scan at the prior and at the answer, and which points agree.

PRIOR_COLOR, SCAN_COLOR, CONSENSUS_COLOR = "#d55e00", "#56b4e9", "#00468b"
# Horizontal part of a normal above which a surface is no ground: it is inclined by 30 degrees.
STANDING_NORMAL = 0.5
# Points without a normal are drawn from this height above ground on, m: kerbs and the crown of the road are lower.
ABOVE_GROUND = 0.4
# Farther points are few, and would make the street too small to see the search space in it.
MOST_HALF_WIDTH, LEAST_HALF_WIDTH = 45.0, 5.0
ONE_CELL = SearchSpace(half_width=0.0, heading_half_width_deg=0.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything that is drawn of one epoch; poses and points in the local frame, the scan in the sensor frame."""

    scan: Scan
    point_map: PointMap
    prior: Pose
    space: SearchSpace
    estimate: Estimate
    reference: Pose | None = None

    @property
    def has_answer(self) -> bool:
        """Whether anything matched at all."""
        return self.estimate.status is not Status.NO_MATCH

    @property
    def is_matched(self) -> NDArray[np.bool_]:
        """Whether each scan point falls in a voxel of the map at the best cell, or else at the answer, shape (n,)."""
        if not self.has_answer:
            return np.zeros(len(self.scan), bool)
        if self.estimate.cell is not None:
            return consensus_set(self.scan, self.point_map, self.prior, self.space, self.estimate.cell)
        return consensus_set(self.scan, self.point_map, self.estimate.pose, ONE_CELL, (0, 0, 0))

    @property
    def is_drawn(self) -> NDArray[np.bool_]:
        """Whether each scan point is drawn, shape (n,): not those on level ground."""
        return is_off_the_ground(self.scan, self.prior)

    def point_sets(self, *, with_rest: bool = True) -> list[tuple[str, str, NDArray[np.float64], float]]:
        """The scan at the prior and, if anything matched, at the answer, for `draw_points`; `with_rest`: all of it."""
        is_drawn = self.is_drawn
        sets = [("scan at the prior", PRIOR_COLOR, self.prior.apply(self.scan.points[is_drawn]), 1.3)]
        if self.has_answer:
            points, is_matched = self.estimate.pose.apply(self.scan.points), self.is_matched
            if with_rest:
                sets.append(("scan at the answer", SCAN_COLOR, points[~is_matched & is_drawn], 1.3))
            sets.append((f"consensus set ({is_matched.sum():,} points)", CONSENSUS_COLOR, points[is_matched], 2.0))
        return sets


def half_width_of(scan: Scan, most: float) -> float:
    """Half width, m, of the square around the sensor that holds 92 of 100 points of a scan: from 5 m to `most`."""
    ranges = np.abs(scan.points[:, :2]).max(axis=1, initial=0.0)
    half_width = float(np.percentile(ranges, 92)) if len(ranges) else 0.0
    return min(max(half_width, LEAST_HALF_WIDTH), most)


def is_off_the_ground(scan: Scan, pose: Pose) -> NDArray[np.bool_]:
    """Whether each scan point is drawn from above, shape (n,): not those that lie, or may lie, on level ground.

    Points without a normal are drawn if they are higher than the level surfaces below the sensor; all are, if no point
    lies on such a surface.
    """
    normals, heights = scan.normals @ pose.rotation.T, scan.points @ pose.rotation[2]
    has_normal = normals.any(axis=1)
    is_standing = np.hypot(normals[:, 0], normals[:, 1]) > STANDING_NORMAL
    is_ground = has_normal & ~is_standing & (heights < 0.0)
    ground = float(np.median(heights[is_ground])) if is_ground.any() else -np.inf
    return np.asarray(is_standing | (~has_normal & (heights > ground + ABOVE_GROUND)))


def draw_scene(axes: Axes, scene: Scene) -> list[Artist]:
    """Draw the scene from above; return what its legend shows, in order."""
    from matplotlib.patches import Rectangle

    prior, pose, half = scene.prior, scene.estimate.pose, scene.space.reach
    window = Window.around(prior.x, prior.y, max(half_width_of(scene.scan, MOST_HALF_WIDTH), 1.25 * half))
    draw_map(axes, scene.point_map, window)
    handles = [map_patch(), *draw_points(axes, scene.point_sets())]
    square = Rectangle(
        (prior.x - half, prior.y - half), 2.0 * half, 2.0 * half, fill=False, ec="black", lw=1.3, label="search space",
        zorder=6,
    )  # fmt: skip
    axes.add_patch(square)

    def mark(at: Pose, label: str, **style: Any) -> None:
        handles.extend(axes.plot(at.x, at.y, ls="", label=label, zorder=8, **style))

    handles.append(square)
    if scene.has_answer:
        arrow = 0.16 * window.size[0]
        tip = (pose.x + arrow * math.cos(pose.heading), pose.y + arrow * math.sin(pose.heading))
        line = {"arrowstyle": "-|>", "color": INK, "lw": 2.0, "shrinkA": 0.0}
        axes.annotate("", tip, (pose.x, pose.y), arrowprops=line, zorder=7)
        mark(pose, "sensor and heading", marker="o", ms=8, mfc="#f0e442", mec="black", mew=1.0)
    mark(prior, "prior", marker="X", ms=9, mfc=PRIOR_COLOR, mec="white", mew=1.0)  # last: the sensor would hide it
    if scene.reference is not None:
        mark(scene.reference, "reference", marker="+", ms=15, mec="black", mew=1.4)
    draw_scale_bar(axes, window)
    axes.set_title("From above (scan without level ground)", loc="left")
    return handles


def draw_points(axes: Axes, sets: Sequence[tuple[str, str, NDArray[np.float64], float]]) -> list[Artist]:
    """Draw sets of points from above, one over the other; return what the legend shows of them."""
    # A set: label, colour, points (n, 3) in the local frame, m, and the diameter of a dot, points.
    from matplotlib.lines import Line2D

    handles: list[Artist] = []
    for number, (label, color, points, size) in enumerate(sets):
        style: dict[str, Any] = {"ls": "", "marker": "o", "mew": 0, "color": color}
        axes.plot(*points[:, :2].T, ms=size, zorder=2 + number, rasterized=True, **style)
        handles.append(Line2D([], [], ms=7, label=label, **style))
    return handles
