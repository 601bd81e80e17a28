# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How distinct the solutions of all epochs are, as distributions side by side (the paper's figure 5)."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import ArrayError
from maxcon.plotting.canvas.figure import MUTED, draw_titles, saved_figure
from maxcon.plotting.canvas.method_style import (
    METHOD_STYLES,
    LegendShape,
    MethodStyle,
    as_epoch_values,
    check_methods,
    draw_legend,
    draw_number_ticks,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

__all__ = ["Distinctnesses", "bin_shares", "plot_distinctness"]

MOST_METHODS = 4
# Odd, so that where all values are equal they lie in the middle of a bin.
N_BINS = 31
# A logarithmic axis spans at least this factor, or equal values would make a bar as wide as the panel.
LEAST_SPAN = 6.0
# Rounding may bring a divergence of nothing this far below zero, and a kurtosis this far below one.
ROUNDING = 1e-9

# Inches: the panels, and what is kept free around them.
PANEL_WIDTH, PANEL_HEIGHT = 3.72, 2.75
LEFT, ACROSS, BELOW, ABOVE, TITLES = 0.78, 0.82, 0.6, 0.56, 0.8
LEGEND_ROW = 0.2


class _Measure(NamedTuple):
    """What a panel shows, and on which scale.

    Values up to `least` share the first bin of a logarithmic axis; a linear one goes from 0 to 1.
    """

    field: str
    title: str
    better: str
    label: str
    unit: str
    is_logarithmic: bool
    least: float


_LOWER, _HIGHER = "← lower is more distinct", "higher is more distinct →"
_MEASURES = (
    _Measure("peak_ratio", "Peak ratio", _LOWER, "second highest over highest score", "", False, 0.0),
    _Measure("kurtosis", "Kurtosis along the significant ray", _HIGHER, "kurtosis", "", True, 1.0),
    _Measure("divergence", "Divergence from a Laplace peak", _LOWER, "KL divergence [nat]", " nat", True, 0.01),
    _Measure("spread", "Spread at 90 %", _LOWER, "farthest cell with 90 % of the peak score [m]", " m", True, 0.05),
)


@dataclass(frozen=True, eq=False)
class Distinctnesses:
    """How distinct the solution of each epoch is, by four measures (design, section 4); NaN where one is not defined.

    peak_ratio: shape (n,); score of the second highest place over the highest, 0 to 1: 0 without a rival, 1 where two
        are equal.
    kurtosis: shape (n,); fourth standardized moment of the scores along the significant ray, 1 or more; 3 is a
        normal's.
    divergence: shape (n,); Kullback-Leibler divergence of these scores from a Laplace distribution with sigma = 1 cell,
        nat.
    spread: shape (n,); largest distance from the peak to a cell with at least 90 % of its score, m.
    """

    peak_ratio: NDArray[np.float64]
    kurtosis: NDArray[np.float64]
    divergence: NDArray[np.float64]
    spread: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name, low, high in (
            ("peak_ratio", 0.0, 1.0),
            ("kurtosis", 1.0 - ROUNDING, np.inf),
            ("divergence", -ROUNDING, np.inf),
            ("spread", 0.0, np.inf),
        ):
            values = as_epoch_values(getattr(self, name), f"`{name}`", low, high)
            object.__setattr__(self, name, values)
            if len(values) != self.n_epochs:
                raise ArrayError(
                    f"Expected `{name}` to have shape ({self.n_epochs},) as `peak_ratio`, got {values.shape}."
                    " Give one value per epoch, NaN where it is not defined."
                )

    @property
    def n_epochs(self) -> int:
        """Number of all epochs, those without a value too."""
        return len(self.peak_ratio)


def bin_shares(values: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of all epochs in each bin, percent; those without a value are in no bin, so the sum may be below 100.

    values: shape (n,); one per epoch, NaN where it is not defined; those beyond the edges fall into the outermost bins.
    edges: shape (n_bins + 1,); rising. A bin holds its lower edge; the last one its upper edge too.
    """
    defined = np.clip(values[~np.isnan(values)], edges[0], edges[-1])
    counts, _ = np.histogram(defined, edges)
    return np.asarray(100.0 * counts / max(1, len(values)), dtype=np.float64)


def plot_distinctness(
    path: str | os.PathLike[str],
    by_method: Mapping[str, Distinctnesses],
    *,
    guard_radius: float = 0.3,
    title: str = "How distinct the solutions are",
) -> None:
    """Draw the distributions of peak ratio, kurtosis, divergence and spread, with the median of each method.

    path: a .png or .svg to write.
    by_method: by the method's name, at most 4, all of the same epochs.
    guard_radius: cells nearer to the peak than this were no rivals in the peak ratio, m; stated in the picture.
    title: what is written above.
    """
    check_methods(by_method, MOST_METHODS)
    n_epochs = {values.n_epochs for values in by_method.values()}
    if len(n_epochs) > 1:
        raise ArrayError(
            f"Expected the same epochs of every method, got {sorted(n_epochs)} of them."
            " Use NaN where a method has no value."
        )
    row_height = ABOVE + PANEL_HEIGHT + BELOW
    names = list(by_method)
    width = 2 * (LEFT + PANEL_WIDTH) + 0.22
    legend = LegendShape.of(names, width)
    height = TITLES + 2 * row_height + legend.height
    with saved_figure(path, width, height) as figure:
        draw_titles(
            figure,
            title,
            f"Epochs of each method: {n_epochs.pop()}. Upright lines: medians."
            f" Peak ratio: rivals more than {guard_radius:g} m away.",
        )
        for number, measure in enumerate(_MEASURES):
            row, column = divmod(number, 2)
            left = LEFT + column * (PANEL_WIDTH + ACROSS)
            bottom = height - TITLES - row * row_height - ABOVE - PANEL_HEIGHT
            axes = figure.add_axes((left / width, bottom / height, PANEL_WIDTH / width, PANEL_HEIGHT / height))
            handles = _draw_measure(axes, measure, [getattr(values, measure.field) for values in by_method.values()])
            if column == 0:
                axes.set_ylabel("share of all epochs [%]")
        draw_legend(figure, handles, names, legend, handle_length=2.6)


def _draw_measure(
    axes: "Axes", measure: _Measure, by_method: list[NDArray[np.float64]]
) -> list[tuple["Patch", "Line2D"]]:
    """Draw one panel: a histogram and a median for each method; return what stands for them in a legend."""
    edges = _edges(measure, np.concatenate(by_method))
    shares = [bin_shares(values, edges) for values in by_method]
    highest = max(float(share.max()) for share in shares) or 1.0
    handles = []
    for style, values, share in zip(METHOD_STYLES, by_method, shares, strict=False):
        handles.append(_draw_shares(axes, style, edges, share))
        if not np.isnan(values).all():
            place = float(np.clip(np.nanmedian(values), edges[0], edges[-1]))
            axes.plot([place, place], [0.0, highest], color=style.color, lw=1.8, ls=style.line, clip_on=False)
            axes.plot(place, highest, style.marker, color=style.color, ms=7, mec="white", mew=0.8, clip_on=False)
    free = (0.24 + LEGEND_ROW * len(by_method)) / PANEL_HEIGHT
    axes.set_ylim(0.0, highest / (1.0 - free))
    axes.legend(
        [mark for _, mark in handles],
        [_median_words(values, measure.unit) for values in by_method],
        loc="upper left",
        borderaxespad=0.3,
        labelspacing=0.25,
        fontsize=9.5,
        handlelength=1.2,
    )
    _finish_measure(axes, measure, edges, highest)
    return handles


def _edges(measure: _Measure, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Edges of the bins that all methods of a panel share."""
    if not measure.is_logarithmic:
        return np.linspace(0.0, 1.0, N_BINS + 1)
    known = np.maximum(values[~np.isnan(values)], measure.least)
    low, high = (float(known.min()), float(known.max())) if known.size else (measure.least, measure.least)
    missing = max(1.0, LEAST_SPAN * low / high)
    low = max(measure.least, low / np.sqrt(missing))
    return np.geomspace(low, max(high * np.sqrt(missing), LEAST_SPAN * low), N_BINS + 1)


def _draw_shares(
    axes: "Axes", style: MethodStyle, edges: NDArray[np.float64], shares: NDArray[np.float64]
) -> tuple["Patch", "Line2D"]:
    """Draw the histogram of one method; return what stands for it in the legend."""
    from matplotlib.colors import to_rgba
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    face = to_rgba(style.color, 0.22)
    pale = to_rgba(style.color, 0.5)
    axes.stairs(shares, edges, fill=True, facecolor=face, edgecolor=pale, hatch=style.hatch, lw=0.0)
    axes.stairs(shares, edges, color=style.color, lw=1.5)
    mark = Line2D([], [], ls="", marker=style.marker, color=style.color, ms=7, mec="white", mew=0.8)
    return Patch(facecolor=face, edgecolor=pale, hatch=style.hatch, lw=0.0), mark


def _median_words(values: NDArray[np.float64], unit: str) -> str:
    """Return the median, and in how many epochs there is no value."""
    n_missing = int(np.isnan(values).sum())
    if n_missing == len(values):
        return "not defined in any epoch"
    return f"median {np.nanmedian(values):.3g}{unit}" + (f" (not defined in {n_missing})" if n_missing else "")


def _finish_measure(axes: "Axes", measure: _Measure, edges: NDArray[np.float64], highest: float) -> None:
    """Scale and label the axes of one panel; no ticks above the highest share, where the medians are written."""
    from matplotlib.ticker import MaxNLocator

    ticks = np.asarray(MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(0.0, highest))
    axes.set_yticks(ticks[ticks <= 1.001 * highest])
    axes.set_xlim(edges[0], edges[-1])
    if measure.is_logarithmic:
        axes.set_xscale("log")
        axes.set_xlim(edges[0], edges[-1])
        draw_number_ticks(axes.xaxis, edges[0], edges[-1], least=measure.least)
    axes.set_title(measure.title, loc="left", pad=21, fontweight="bold")
    axes.annotate(measure.better, (0.0, 1.0), (0, 6), xycoords="axes fraction", textcoords="offset points", color=MUTED)
    axes.set_xlabel(measure.label)
    axes.grid(axis="y", color="#dfe2e8", lw=0.7)
    axes.set_axisbelow(True)
