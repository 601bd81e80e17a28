# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How distinct the answers of all epochs are: four measures (the paper's figure 5), kurtosis on the map (figure 6)."""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.charts import METHOD_STYLES, MethodStyle, draw_grid, draw_legend, draw_number_ticks
from maxcon.lab.distinctness import GUARD_RADIUS
from maxcon.map import PointMap
from maxcon.plotting.figure import INK, MUTED, saved_figure
from maxcon.plotting.from_above import SIDE, Window, map_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

Floats = NDArray[np.float64]
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


def bin_percents(values: Floats, edges: Floats) -> Floats:
    """Percentage of all epochs in each bin; those without a value are in no bin, so the sum may be below 100.

    values: shape (n,); one per epoch, NaN where it is not defined; those beyond the edges fall into the outermost bins.
    edges: shape (n_bins + 1,); rising. A bin holds its lower edge; the last one its upper edge too.
    """
    counts, _ = np.histogram(np.clip(values[~np.isnan(values)], edges[0], edges[-1]), edges)
    return np.asarray(100.0 * counts / max(1, len(values)), dtype=np.float64)


def plot_distinctness(
    path: str | os.PathLike[str], by_method: Mapping[str, Mapping[str, Floats]], *, title: str
) -> None:
    """Draw the distributions of peak ratio, kurtosis, divergence and spread, with the median of each method.

    by_method: by the method's name, values of shape (n,) by the names of `MEASURES`, all of the same epochs; NaN where
        one is not defined.
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
    percents = [bin_percents(values, edges) for values in by_method]
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


# Kurtosis on the map (figure 6). Diameters of the circles, points.
LARGE, SMALL = 13.0, 6.5
# Kurtoses that span more than this factor get a logarithmic colour scale.
SKEWED = 5.0


def spaced_epochs(places: Floats, distance: float) -> list[int]:
    """Return indices of epochs at least `distance` (m) apart: the first, and each that is far from all chosen.

    places: shape (n, 2); m, n > 0.
    """
    chosen = [0]
    for epoch in range(1, len(places)):
        if (((places[chosen] - places[epoch]) ** 2).sum(axis=1) >= distance * distance).all():
            chosen.append(epoch)
    return chosen


def plot_kurtosis_map(
    path: str | os.PathLike[str],
    places: Floats,
    small: tuple[str, Floats],
    large: tuple[str, Floats],
    *,
    point_map: PointMap | None,
    title: str,
) -> None:
    """Draw the drive from above, each epoch as a small circle in a large one: the kurtosis by two objectives.

    Both share one colour scale, logarithmic where the values are skewed. Epochs whose circles would cover
    those of an earlier one are left out; the picture says how many are shown.

    places: shape (n, 2), n > 0; reference positions, local frame, m.
    small, large: what the small and the large circles stand for, and the kurtosis along the significant ray, shape
        (n,); NaN where it is not defined.
    point_map: drawn below, in grey.
    """
    window = Window.with_room(places)
    spacing = 1.1 * LARGE / 72.0 / SIDE * max(window.size)
    shown = spaced_epochs(places, spacing)
    labels = [f"large: {large[0]}", f"small: {small[0]}", "white: not defined"]
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
        draw_legend(figure, _legend_circles(), labels)


def _draw_circles(axes: "Axes", places: Floats, small: Floats, large: Floats, shown: list[int]) -> "ScalarMappable":
    """Draw the drive as a line and the circles of the shown epochs; return their colour scale."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm, Normalize

    low, high = color_limits(np.concatenate([small, large]))
    norm = LogNorm(low, high) if high > SKEWED * low else Normalize(low, high)
    colors = ScalarMappable(norm, colormaps["viridis"].with_extremes(bad="white"))
    axes.plot(*places.T, color=MUTED, lw=1.0, zorder=3)
    for kurtosis, diameter, edge, layer in ((large[shown], LARGE, INK, 4), (small[shown], SMALL, "white", 5)):
        axes.scatter(
            places[shown, 0], places[shown, 1], c=colors.to_rgba(np.ma.masked_invalid(kurtosis)), s=diameter**2,
            edgecolors=list(np.where(np.isnan(kurtosis), INK, edge)), linewidths=0.7, zorder=layer,
        )  # fmt: skip
    return colors


def color_limits(values: Floats) -> tuple[float, float]:
    """Return the ends of the colour scale: the least and the largest value, or a range around both if equal."""
    known = values[~np.isnan(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (1.0, 10.0)
    return (low, high) if high > 1.01 * low else (0.8 * low, 1.25 * high)


def _legend_circles() -> "list[Line2D]":
    """Return a large, a small and an empty circle for the legend."""
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], ls="", marker="o", ms=diameter, mfc=face, mec=INK, mew=0.5)
        for diameter, face in ((LARGE, "#b9bec8"), (SMALL, "#b9bec8"), (SMALL, "white"))
    ]
