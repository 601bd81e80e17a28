"""The paper's comparisons: objectives side by side (figure 4), distinctness (figure 5), kurtosis on the map (6)."""

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from maxcon.geometry import Pose, wrap_angle
from maxcon.lab.distinctness import GUARD_RADIUS
from maxcon.lab.report.charts import METHOD_STYLES, Floats, MethodStyle, draw_grid, draw_legend, draw_number_ticks
from maxcon.map import PointMap
from maxcon.plotting import score_panel
from maxcon.plotting.epoch import draw_points, half_width_of, is_off_the_ground
from maxcon.plotting.figure import (
    INK,
    MUTED,
    SERIES,
    SIDE,
    Window,
    draw_map,
    draw_scale_bar,
    map_figure,
    map_patch,
    saved_figure,
)
from maxcon.scan import Scan

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

OUTSIDE = "#d9d9d9"
# Largest half width of the ground around the reference, m.
MOST_HALF_WIDTH = 35.0


class ComparisonRow(NamedTuple):
    """One epoch, scored by at least two objectives, which need not share an accumulator."""

    label: str  # what is special about it: "crossing", "straight street"
    scan: Scan  # sensor frame
    point_map: PointMap
    reference: Pose  # local frame: where the highest score should be
    views: Sequence[score_panel.SearchSpaceView]


def plot_comparison(path: str | os.PathLike[str], rows: Sequence[ComparisonRow], *, title: str) -> None:
    """Draw one row per epoch: the scan in the map from above, and the search space of each objective.

    A search space is drawn at the heading of its best cell, with (0, 0) at the reference. Its colours run from
    0 (the lowest score, if negative) to its own highest, on a root scale: units of scores differ.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import PowerNorm

    n_places = max(len(row.views) for row in rows)
    words = (
        "Each square: all positions at the best heading, scored. Above it: where the best cell lies from the"
        "\nreference, in m and degrees. (0, 0) is right."
    )
    with saved_figure(path, 1.2 + 3.5 * (1 + n_places), 3.7 * len(rows) + 2.1, title, words) as figure:
        panels = figure.subplots(len(rows), 1 + n_places, squeeze=False)
        for (ground, *places), row in zip(panels, rows, strict=True):
            scan = _draw_ground(ground, row)
            for axes, view in zip(places, row.views, strict=True):
                draw_view(axes, view, row.reference)
                axes.set_title(view_words(view, row.reference), loc="left", pad=12, parse_math=False)
                axes.set_xlabel("x from the reference [m]")
            places[0].set_ylabel("y from the reference [m]")
        scale = ScalarMappable(PowerNorm(score_panel.COLOR_POWER, 0.0, 1.0), cmap=score_panel.COLORS)
        words = f"{scale_words(view for row in rows for view in row.views)} (root scale)"
        figure.colorbar(scale, ax=panels[:, -1], ticks=[0.0, 0.1, 0.5, 1.0], format="%g", label=words, shrink=0.9)
        figure.legend(handles=[map_patch(), *scan, *score_panel.cell_marks()], loc="outside lower left", ncols=4)


def _draw_ground(axes: "Axes", row: ComparisonRow) -> list["Artist"]:
    """Draw map and scan, without level ground, around the reference; return what the legend shows of the scan."""
    points = row.reference.apply(row.scan.points[is_off_the_ground(row.scan, row.reference)])
    window = Window.around(row.reference.x, row.reference.y, half_width_of(row.scan, MOST_HALF_WIDTH))
    draw_map(axes, row.point_map, window)
    handles = draw_points(axes, [("scan at the reference", SERIES[2], points, 1.2)])
    mark = score_panel.cell_marks()[1]
    mark.set_markersize(10)
    score_panel.put_mark(axes, mark, row.reference.x, row.reference.y)
    axes.set(xlabel="", ylabel="", xticks=[], yticks=[])
    axes.set_title(row.label, loc="left", pad=12, parse_math=False, fontweight="bold")
    draw_scale_bar(axes, window)
    return handles


def draw_view(axes: "Axes", view: score_panel.SearchSpaceView, reference: Pose) -> None:
    """Draw the best heading with the reference at (0, 0), and mark both."""
    x, y = view.offset(reference)
    ground = score_panel.ground_of(view.space, -x, -y)
    xlim, ylim = (min(ground.west, 0.0), max(ground.east, 0.0)), (min(ground.south, 0.0), max(ground.north, 0.0))
    axes.set(xlim=xlim, ylim=ylim, facecolor=OUTSIDE)
    score_panel.draw_scores(axes, view.scores[view.best[0]], ground, view.norm)
    best_mark, reference_mark = score_panel.cell_marks()
    score_panel.put_mark(axes, reference_mark, 0.0, 0.0)
    if view.has_best:
        score_panel.put_mark(axes, best_mark, *best_from(view, reference)[:2])
    axes.locator_params(nbins=5)


def best_from(view: score_panel.SearchSpaceView, reference: Pose) -> tuple[float, float, float]:
    """Return offset x, y (m) and turn (rad) of the best cell's pose from the reference."""
    pose = view.space.pose(view.best, view.accumulator.prior)
    return pose.x - reference.x, pose.y - reference.y, wrap_angle(pose.heading - reference.heading)


def view_words(view: score_panel.SearchSpaceView, reference: Pose) -> str:
    """Return the title of a panel, and in a second line where its best cell lies from the reference."""
    name = view.title or score_panel.title_of(view.objective)
    if not view.has_best:
        return f"{name}\nall cells score the same"
    x, y, turn = best_from(view, reference)
    # With a minus that is as wide as a digit, and none before 0.
    x_words, y_words, turn_words = (
        f"{round(value, 2) + 0.0:.2f}".replace("-", "−") for value in (x, y, math.degrees(turn))
    )
    return f"{name}\n(x = {x_words}, y = {y_words}), turn {turn_words}°"


def scale_words(views: Iterable[score_panel.SearchSpaceView]) -> str:
    """Return the label of the colour scale that search spaces share, each from 0 to its own highest score."""
    if any(view.limits[0] < 0.0 for view in views):
        return "score, from the lowest (0) to the highest (1) of the square"
    return "score, over the highest of the square"


# Odd, so that where all values are equal they lie in the middle of a bin.
N_BINS = 31
# A logarithmic axis spans at least this factor, or equal values would make a bar as wide as the panel.
LEAST_SPAN = 6.0


class _Measure(NamedTuple):
    """What a panel shows; values up to `least` share the first bin of a logarithmic axis, a linear one has none."""

    title: str
    better: str
    label: str
    unit: str
    least: float | None


_LOWER, _HIGHER = "← lower is more distinct", "higher is more distinct →"
MEASURES = {
    "peak_ratio": _Measure("Peak ratio", _LOWER, "second highest over highest score", "", None),
    "kurtosis": _Measure("Kurtosis along the significant ray", _HIGHER, "kurtosis", "", 1.0),
    "divergence": _Measure("Divergence from a Laplace peak", _LOWER, "KL divergence [nat]", " nat", 0.01),
    "spread": _Measure("Spread at 90 %", _LOWER, "farthest cell with 90 % of the peak score [m]", " m", 0.05),
}
"""The panels by the fields of `maxcon.lab.distinctness.Distinctness`."""


def plot_distinctness(
    path: str | os.PathLike[str], by_method: Mapping[str, Mapping[str, Floats]], *, title: str
) -> None:
    """Draw the distributions of peak ratio, kurtosis, divergence and spread, with the median of each method.

    by_method: by the method's name, values of shape (n,) by the names of `MEASURES`, all of the same epochs; NaN where
        one is not defined: such an epoch is in no bin.
    """
    words = (
        f"Epochs of each method: {len(next(iter(by_method.values()))['spread'])}. Upright lines: medians."
        f" Peak ratio: rivals more than {GUARD_RADIUS:g} m away."
    )
    with saved_figure(path, 9.2, 9.2, title, words) as figure:
        panels = figure.subplots(2, 2)
        for axes, (field, measure) in zip(panels.flat, MEASURES.items(), strict=True):
            handles = _draw_measure(axes, measure, [values[field] for values in by_method.values()])
        for axes in panels[:, 0]:
            axes.set_ylabel("share of all epochs [%]")
        draw_legend(figure, handles, list(by_method))


def _draw_measure(axes: "Axes", measure: _Measure, by_method: list[Floats]) -> list[tuple["Patch", "Line2D"]]:
    """Draw one panel: a histogram and a median for each method; return what stands for them in a legend."""
    from matplotlib.ticker import MaxNLocator

    edges = _edges(measure.least, np.concatenate(by_method))
    percents = [
        100.0 * np.histogram(np.clip(values[~np.isnan(values)], edges[0], edges[-1]), edges)[0] / max(1, len(values))
        for values in by_method
    ]
    highest = max(float(percent.max()) for percent in percents) or 1.0
    handles = []
    for style, values, percent in zip(METHOD_STYLES, by_method, percents, strict=False):
        handles.append(_draw_histogram(axes, style, edges, percent))
        if not np.isnan(values).all():
            place = float(np.clip(np.nanmedian(values), edges[0], edges[-1]))
            axes.plot([place, place], [0.0, highest], color=style.color, lw=1.8, ls=style.line, clip_on=False)
            axes.plot(place, highest, style.marker, color=style.color, ms=7, mec="white", mew=0.8, clip_on=False)
    words = [_median_words(values, measure.unit) for values in by_method]
    axes.legend(
        [mark for _, mark in handles], words, loc="upper left", borderaxespad=0.3, labelspacing=0.25, fontsize=9.5,
        handlelength=1.2,
    )  # fmt: skip
    # No ticks above the highest bin, where the medians are written.
    ticks = np.asarray(MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(0.0, highest))
    free = 0.09 + 0.07 * len(by_method)
    axes.set(yticks=ticks[ticks <= 1.001 * highest], ylim=(0.0, highest / (1.0 - free)))
    if measure.least is not None:
        axes.set_xscale("log")
        draw_number_ticks(axes.xaxis, edges[0], edges[-1], least=measure.least)
    axes.set(xlim=(edges[0], edges[-1]), xlabel=measure.label)
    axes.set_title(measure.title, loc="left", pad=21, fontweight="bold")
    axes.annotate(measure.better, (0.0, 1.0), (0, 6), xycoords="axes fraction", textcoords="offset points", color=MUTED)
    draw_grid(axes, axis="y")
    return handles


def _edges(least: float | None, values: Floats) -> Floats:
    """Edges of the bins that all methods of a panel share."""
    if least is None:
        return np.linspace(0.0, 1.0, N_BINS + 1)
    known = np.maximum(values[~np.isnan(values)], least)
    low, high = (float(known.min()), float(known.max())) if known.size else (least, least)
    missing = max(1.0, LEAST_SPAN * low / high)
    low = max(least, low / np.sqrt(missing))
    return np.geomspace(low, max(high * np.sqrt(missing), LEAST_SPAN * low), N_BINS + 1)


def _draw_histogram(axes: "Axes", style: MethodStyle, edges: Floats, percents: Floats) -> tuple["Patch", "Line2D"]:
    """Draw the histogram of one method; return what stands for it in the legend."""
    from matplotlib.colors import to_rgba
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    face, pale = to_rgba(style.color, 0.22), to_rgba(style.color, 0.5)
    axes.stairs(percents, edges, fill=True, facecolor=face, edgecolor=pale, hatch=style.hatch, lw=0.0)
    axes.stairs(percents, edges, color=style.color, lw=1.5)
    mark = Line2D([], [], ls="", marker=style.marker, color=style.color, ms=7, mec="white", mew=0.8)
    return Patch(facecolor=face, edgecolor=pale, hatch=style.hatch, lw=0.0), mark


def _median_words(values: Floats, unit: str) -> str:
    """Return the median, and in how many epochs there is no value."""
    n_missing = int(np.isnan(values).sum())
    if n_missing == len(values):
        return "not defined in any epoch"
    return f"median {np.nanmedian(values):.3g}{unit}" + (f" (not defined in {n_missing})" if n_missing else "")


# Diameters of the circles, points.
LARGE, SMALL = 13.0, 6.5
# Kurtoses that span more than this factor get a logarithmic colour scale.
SKEWED = 5.0


def spaced_epochs(places: Floats, distance: float) -> list[int]:
    """Return indices of places (n, 2), n > 0, `distance` (m) apart or more: the first, and each far from all chosen."""
    chosen = [0]
    for epoch in range(1, len(places)):
        if (((places[chosen] - places[epoch]) ** 2).sum(axis=1) >= distance * distance).all():
            chosen.append(epoch)
    return chosen


def plot_kurtosis_map(
    path: str | os.PathLike[str], places: Floats, small: tuple[str, Floats], large: tuple[str, Floats], *,
    point_map: PointMap | None, title: str,
) -> None:  # fmt: skip
    """Draw the drive from above, each epoch as a small circle in a large one: the kurtosis by two objectives.

    `places` (n, 2), n > 0: local frame, m; `small`, `large`: label and kurtosis, (n,), NaN where not defined. Epochs
    whose circles would cover those of an earlier one are left out.
    """
    from matplotlib.lines import Line2D

    window = Window.with_room(places)
    spacing = 1.1 * LARGE / 72.0 / SIDE * max(window.size)
    shown = spaced_epochs(places, spacing)
    medians = "; ".join(
        f"{name} {_median_words(values, '').removeprefix('median ')}" for name, values in (small, large)
    )
    words = (
        f"Medians of all epochs: {medians}.\n{len(shown)} of {len(places)} epochs shown, {spacing:.2g} m apart or more."
    )
    with map_figure(path, window, point_map, (title, words)) as (figure, axes):
        colors = _draw_circles(axes, places, small[1], large[1], shown)
        bar = figure.colorbar(colors, ax=axes, label="kurtosis").ax
        limits = colors.get_clim()
        if limits[1] > SKEWED * limits[0]:
            draw_number_ticks(bar.yaxis, *limits)
        labels = [f"large: {large[0]}", f"small: {small[0]}", "white: not defined"]
        looks = ((LARGE, "#b9bec8"), (SMALL, "#b9bec8"), (SMALL, "white"))
        marks = [Line2D([], [], ls="", marker="o", ms=size, mfc=face, mec=INK, mew=0.5) for size, face in looks]
        draw_legend(figure, marks, labels)


def _draw_circles(axes: "Axes", places: Floats, small: Floats, large: Floats, shown: list[int]) -> "ScalarMappable":
    """Draw the drive as a line and the circles of the shown epochs; return their colour scale."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm, Normalize

    values = np.concatenate([small, large])
    known = values[~np.isnan(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (1.0, 10.0)
    low, high = (low, high) if high > 1.01 * low else (0.8 * low, 1.25 * high)
    norm = LogNorm(low, high) if high > SKEWED * low else Normalize(low, high)
    colors = ScalarMappable(norm, colormaps["viridis"].with_extremes(bad="white"))
    axes.plot(*places.T, color=MUTED, lw=1.0, zorder=3)
    for kurtosis, diameter, edge, layer in ((large[shown], LARGE, INK, 4), (small[shown], SMALL, "white", 5)):
        axes.scatter(
            places[shown, 0], places[shown, 1], c=colors.to_rgba(np.ma.masked_invalid(kurtosis)), s=diameter**2,
            edgecolors=list(np.where(np.isnan(kurtosis), INK, edge)), linewidths=0.7, zorder=layer,
        )  # fmt: skip
    return colors
