# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Success rate of each method over the distance of the prior from the reference."""

import math
import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.evaluation import SUCCESS_WORDS, wilson_interval
from maxcon.plotting.canvas.figure import MUTED, draw_titles, saved_figure
from maxcon.plotting.canvas.method_style import METHOD_STYLES, LegendShape, as_epoch_values, check_methods, draw_legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SuccessBins", "plot_success"]

MOST_BINS = 20
WIDTH, AXES_HEIGHT = 9.2, 4.1
# Inches: what is kept free around the axes, and how high a row of numbers of epochs is.
LEFT, RIGHT, BELOW, TITLES, ROW = 1.02, 0.2, 0.62, 1.1, 0.21


class SuccessBins(NamedTuple):
    """Epochs and successes of one method, by the distance of the prior from the reference.

    n_epochs, n_successes: shape (n_bins,); int64; bin k holds the distances from k to below k + 1 bin widths.
    """

    n_epochs: NDArray[np.int64]
    n_successes: NDArray[np.int64]

    @classmethod
    def of(
        cls, offsets: NDArray[np.float64], is_success: NDArray[np.bool_], bin_width: float, n_bins: int
    ) -> "SuccessBins":
        """Count the epochs of each bin; all offsets are below n_bins bin widths."""
        bins = np.floor(offsets / bin_width).astype(np.int64)
        n_epochs = np.bincount(bins, minlength=n_bins).astype(np.int64)
        return cls(n_epochs, np.bincount(bins[is_success], minlength=n_bins).astype(np.int64))


def plot_success(
    path: str | os.PathLike[str],
    offsets_by_method: Mapping[str, ArrayLike],
    success_by_method: Mapping[str, ArrayLike],
    *,
    bin_width: float | None = None,
    criterion: str = f"within {SUCCESS_WORDS} of the reference",
    title: str = "Success by the error of the prior",
) -> None:
    """Draw the success rate of each method against the distance of the prior from the reference.

    Bars are Wilson intervals of 95 %; the numbers of epochs of each bin stand above it.

    path: a .png or .svg to write.
    offsets_by_method: shape (n,); distance of each prior from the reference, m, by the method's name, at most 8 of
        them; the methods need not have the same epochs.
    success_by_method: shape (n,); bool: whether the method succeeded, under the same names; False where it did not
        localize.
    bin_width: m; if None, the smallest of 0.5, 1, 2, 5, 10, ... m that makes at most 20 bins.
    criterion: what counts as a success; stated in the picture.
    title: what is written above.
    """
    check_methods(offsets_by_method)
    offsets, successes = _checked(offsets_by_method, success_by_method)
    farthest = max(float(values.max()) for values in offsets.values())
    bin_width = _checked_width(farthest, bin_width)
    n_bins = int(farthest / bin_width) + 1
    bins = [SuccessBins.of(offsets[name], successes[name], bin_width, n_bins) for name in offsets]
    n_rows = 1 if all((one.n_epochs == bins[0].n_epochs).all() for one in bins) else len(bins)
    labels = [
        f"{name}: {100.0 * one.n_successes.sum() / one.n_epochs.sum():.1f} %"
        for name, one in zip(offsets, bins, strict=True)
    ]
    legend = LegendShape.of(labels, WIDTH)
    bottom = BELOW + legend.height
    height = bottom + AXES_HEIGHT + n_rows * ROW + TITLES
    with saved_figure(path, WIDTH, height) as figure:
        draw_titles(
            figure,
            title,
            f"Success: {criterion}. Bins of {bin_width:g} m; bars: Wilson's 95 % intervals.\n"
            "Numbers above: epochs in each bin. Below: success over all epochs.",
        )
        axes = figure.add_axes((LEFT / WIDTH, bottom / height, (WIDTH - LEFT - RIGHT) / WIDTH, AXES_HEIGHT / height))
        handles = [_draw_method(axes, number, len(bins), one, bin_width) for number, one in enumerate(bins)]
        _draw_numbers(axes, bins[:n_rows], bin_width)
        _finish(axes, n_bins, bin_width)
        draw_legend(figure, handles, labels, legend)


def _checked(
    offsets_by_method: Mapping[str, ArrayLike], success_by_method: Mapping[str, ArrayLike]
) -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.bool_]]]:
    """Return both mappings with arrays that fit each other."""
    if set(offsets_by_method) != set(success_by_method):
        raise OptionError(
            f"Expected offsets and successes of the same methods, got {sorted(offsets_by_method)}"
            f" and {sorted(success_by_method)}. Use the same names."
        )
    offsets, successes = {}, {}
    for name, values in offsets_by_method.items():
        offsets[name] = as_epoch_values(values, f"the offsets of {name!r}", 0.0)
        if np.isnan(offsets[name]).any():
            raise ArrayError(f"Expected the offsets of {name!r} to be finite, got NaN. Leave these epochs out.")
        is_success = np.asarray(success_by_method[name])
        if is_success.dtype != np.bool_ or is_success.shape != offsets[name].shape:
            raise ArrayError(
                f"Expected the successes of {name!r} to be booleans of shape {offsets[name].shape}, got"
                f" {is_success.dtype} of shape {is_success.shape}. Give one per epoch, False for no answer."
            )
        successes[name] = is_success
    return offsets, successes


def _checked_width(farthest: float, bin_width: float | None) -> float:
    """Return the bin width if it suits the farthest offset, or one that does."""
    if bin_width is None:
        bin_width, steps = 0.5, (2.0, 2.0, 2.5)
        number = 0
        while int(farthest / bin_width) >= MOST_BINS:
            bin_width *= steps[number % 3]
            number += 1
        return bin_width
    if not 0.0 < bin_width < math.inf or int(farthest / bin_width) >= MOST_BINS:
        raise OptionError(
            f"Expected `bin_width` to make at most {MOST_BINS} bins up to {farthest:g} m, got {bin_width:g} m."
            f" Use {_checked_width(farthest, None):g}."
        )
    return bin_width


def _draw_method(axes: "Axes", number: int, n_methods: int, bins: SuccessBins, bin_width: float) -> Any:
    """Draw the rates of one method with their intervals, set apart from the others' within each bin."""
    style = METHOD_STYLES[number]
    apart = (number - 0.5 * (n_methods - 1)) * min(0.12, 0.7 / n_methods)
    places = (np.arange(len(bins.n_epochs)) + 0.5 + apart) * bin_width
    low, high = wilson_interval(bins.n_successes, bins.n_epochs)
    rates = np.divide(bins.n_successes, bins.n_epochs, out=np.full(len(places), np.nan), where=bins.n_epochs > 0)
    axes.vlines(places, 100.0 * low, 100.0 * high, color=style.color, lw=1.5, alpha=0.75, zorder=2)
    (line,) = axes.plot(
        places,
        100.0 * rates,
        color=style.color,
        ls=style.line,
        lw=1.3,
        marker=style.marker,
        ms=6.5,
        mec="white",
        mew=0.7,
        zorder=3,
        clip_on=False,
    )
    return line


def _draw_numbers(axes: "Axes", rows: list[SuccessBins], bin_width: float) -> None:
    """Write how many epochs each bin holds above it: one row for all methods, or one for each."""
    place: dict[str, Any] = {
        "xycoords": ("data", "axes fraction"),
        "textcoords": "offset points",
        "va": "center",
        "fontsize": 9,
    }
    for number, bins in enumerate(rows):
        above = 72.0 * ROW * (len(rows) - number - 0.35)
        style, is_shared = METHOD_STYLES[number], len(rows) == 1
        for middle, n_epochs in zip((np.arange(len(bins.n_epochs)) + 0.5) * bin_width, bins.n_epochs, strict=True):
            axes.annotate(f"{n_epochs}", (middle, 1.0), (0.0, above), ha="center", color=MUTED, **place)
        if number == 0:
            axes.annotate("epochs", (0.0, 1.0), (-20.0, above), ha="right", color=MUTED, **place)
        if not is_shared:
            height = 1.0 + above / (72.0 * AXES_HEIGHT)
            axes.plot(-0.018, height, style.marker, color=style.color, ms=6.5, transform=axes.transAxes, clip_on=False)


def _finish(axes: "Axes", n_bins: int, bin_width: float) -> None:
    """Scale and label the axes."""
    axes.set_xlim(0.0, n_bins * bin_width)
    axes.set_ylim(0.0, 102.0)
    axes.set_xticks(np.arange(n_bins + 1) * bin_width)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_xlabel("distance of the prior from the reference [m]")
    axes.set_ylabel("success [% of the epochs in the bin]")
    axes.grid(color="#dfe2e8", lw=0.7)
    axes.set_axisbelow(True)
