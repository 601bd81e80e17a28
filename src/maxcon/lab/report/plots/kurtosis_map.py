# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A drive from above, epochs in the colours of their kurtosis by two objectives (the paper's figure 6)."""

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.map import PointMap
from maxcon.plotting.canvas.figure import INK, MUTED, draw_titles, saved_figure
from maxcon.plotting.canvas.from_above import Window, as_places, draw_map, draw_scale_bar
from maxcon.plotting.canvas.method_style import LegendShape, as_epoch_values, draw_legend, draw_number_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.lines import Line2D

__all__ = ["color_limits", "plot_kurtosis_map", "spaced_epochs"]

COLORS = "viridis"
# Diameters of the circles, points; and the longer side of the window, inches.
LARGE, SMALL = 13.0, 6.5
SIDE = 6.6
LEFT, RIGHT, BELOW, TITLES, LEAST_WIDTH = 0.85, 1.15, 0.62, 1.12, 7.4
# No distribution has a kurtosis below 1; rounding may.
LEAST_KURTOSIS = 1.0 - 1e-9
# Kurtoses that span more than this factor get a logarithmic colour scale.
SKEWED = 5.0


def spaced_epochs(places: NDArray[np.float64], distance: float) -> NDArray[np.intp]:
    """Return indices of epochs that are at least `distance` apart: the first, and each that is far from all chosen.

    places: shape (n, 2); m, n > 0.
    distance: m.
    """
    chosen = [0]
    for epoch in range(1, len(places)):
        if (((places[chosen] - places[epoch]) ** 2).sum(axis=1) >= distance * distance).all():
            chosen.append(epoch)
    return np.array(chosen, dtype=np.intp)


def color_limits(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return the ends of the colour scale: the least and the largest value, or a range around both if equal."""
    known = values[~np.isnan(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (1.0, 10.0)
    return (low, high) if high > 1.01 * low else (0.8 * low, 1.25 * high)


def plot_kurtosis_map(
    path: str | os.PathLike[str],
    positions: ArrayLike,
    kurtosis_small: ArrayLike,
    kurtosis_large: ArrayLike,
    *,
    names: tuple[str, str] = ("Count", "Helmert's score"),
    point_map: PointMap | None = None,
    title: str = "Kurtosis along the significant ray",
) -> None:
    """Draw the drive from above, each epoch as a small circle in a large one: the kurtosis by two objectives.

    Both share one colour scale, logarithmic where the values are skewed. Epochs whose circles would cover
    those of an earlier one are left out; the picture says how many are shown.

    path: a .png or .svg to write.
    positions: shape (n, 2) or (n, 3); reference positions, local frame, m.
    kurtosis_small, kurtosis_large: shape (n,); kurtosis along the significant ray, in the small and in the large
        circles; NaN where it is not defined.
    names: what the small and the large circles stand for.
    point_map: drawn below, in grey.
    title: what is written above.
    """
    places = as_places(positions)
    values = (
        as_epoch_values(kurtosis_small, "`kurtosis_small`", LEAST_KURTOSIS, n_epochs=len(places)),
        as_epoch_values(kurtosis_large, "`kurtosis_large`", LEAST_KURTOSIS, n_epochs=len(places)),
    )
    window = Window.with_room(places)
    scale = SIDE / max(window.size)
    apart = 1.04 * LARGE / 72.0 / scale
    shown = spaced_epochs(places, apart)
    drawn_width, drawn_height = window.size[0] * scale, window.size[1] * scale
    width = max(LEFT + drawn_width + RIGHT, LEAST_WIDTH)
    labels = [f"large: {names[1]}", f"small: {names[0]}"]
    if any(np.isnan(one[shown]).any() for one in values):
        labels.append("white: not defined")
    legend = LegendShape.of(labels, width)
    bottom = BELOW + legend.height
    height = bottom + drawn_height + TITLES
    with saved_figure(path, width, height) as figure:
        draw_titles(
            figure,
            title,
            f"Medians of all epochs: {_median_words(names[0], values[0])}; {_median_words(names[1], values[1])}.\n"
            f"{len(shown)} of {len(places)} epochs shown, {apart:.2g} m apart or more.",
        )
        left = (LEFT + 0.5 * (width - LEFT - drawn_width - RIGHT)) / width
        axes = figure.add_axes((left, bottom / height, drawn_width / width, drawn_height / height))
        draw_map(axes, point_map, window)
        colors = _draw_circles(axes, places, values, shown)
        draw_scale_bar(axes, window)
        bar = figure.add_axes(
            (left + (drawn_width + 0.15) / width, bottom / height, 0.16 / width, drawn_height / height)
        )
        figure.colorbar(colors, cax=bar).set_label("kurtosis")
        low, high = colors.get_clim()
        if high > SKEWED * low:
            draw_number_ticks(bar.yaxis, low, high)
        draw_legend(figure, _legend_circles()[: len(labels)], labels, legend, handle_length=1.6)


def _median_words(name: str, kurtosis: NDArray[np.float64]) -> str:
    """Return the name and the median of all epochs."""
    known = kurtosis[~np.isnan(kurtosis)]
    return f"{name} {np.median(known):.3g}" if known.size else f"{name} not defined"


def _draw_circles(
    axes: "Axes",
    places: NDArray[np.float64],
    values: tuple[NDArray[np.float64], NDArray[np.float64]],
    shown: NDArray[np.intp],
) -> "ScalarMappable":
    """Draw the drive as a line and the circles of the shown epochs; return their colour scale."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm, Normalize

    low, high = color_limits(np.concatenate(values))
    norm = LogNorm(low, high) if high > SKEWED * low else Normalize(low, high)
    colors = ScalarMappable(norm, colormaps[COLORS].with_extremes(bad="white"))
    axes.plot(*places.T, color=MUTED, lw=1.0, zorder=3)
    for kurtosis, diameter, edge, layer in ((values[1], LARGE, INK, 4), (values[0], SMALL, "white", 5)):
        axes.scatter(
            places[shown, 0],
            places[shown, 1],
            c=colors.to_rgba(np.ma.masked_invalid(kurtosis[shown])),
            s=diameter**2,
            edgecolors=list(np.where(np.isnan(kurtosis[shown]), INK, edge)),
            linewidths=0.7,
            zorder=layer,
        )
    return colors


def _legend_circles() -> "list[Line2D]":
    """Return a large, a small and an empty circle for the legend."""
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], ls="", marker="o", ms=diameter, mfc=face, mec=INK, mew=0.5)
        for diameter, face in ((LARGE, "#b9bec8"), (SMALL, "#b9bec8"), (SMALL, "white"))
    ]
