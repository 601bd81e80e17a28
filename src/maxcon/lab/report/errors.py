# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors of methods: over a drive, as cumulative distributions, and success over the error of the prior."""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError
from maxcon.lab.evaluation import SUCCESS_DISTANCE, SUCCESS_WORDS, wilson_interval
from maxcon.plotting.figure import (
    DASHES,
    INK,
    METHOD_STYLES,
    MUTED,
    add_axes,
    as_methods_values,
    common_length,
    draw_grid,
    draw_number_ticks,
    method_chart,
    saved_figure,
)  # fmt: skip

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

# Errors below a millimetre are drawn at a millimetre: the axis is logarithmic.
LEAST_ERROR = 1e-3


def plot_errors(path: str | os.PathLike[str], times: ArrayLike, errors_by_method: Mapping[str, ArrayLike]) -> None:
    """Draw the horizontal error of each epoch over the drive, and the fraction of epochs within each error.

    path: a .png or .svg to write.
    times: shape (n,); when each epoch was, s; drawn from the first one on.
    errors_by_method: shape (n,); distance to the reference, m, by the method's name, at most 6, as more cover each
        other; NaN where it did not localize.
    """
    times = np.asarray(times, dtype=np.float64)
    errors = as_methods_values(errors_by_method, 6, n_epochs=len(times))
    words = f"Distance to the reference. Dashed: success, {SUCCESS_DISTANCE:g} m. Crosses on top: not localized."
    with saved_figure(path, 11.5, 4.9, "Error of each epoch", words) as figure:
        over_time = add_axes(figure, 0.8, 1.05, 6.9, 2.85)
        fractions = add_axes(figure, 8.0, 1.05, 3.25, 2.85, sharey=over_time)
        for number, (name, values) in enumerate(errors.items()):
            _draw_over_time(over_time, number, name, times - times.min(initial=np.inf), values)
            reached = np.sort(np.maximum(values[~np.isnan(values)], LEAST_ERROR))
            percent = 100.0 * np.arange(1, len(reached) + 1) / max(1, len(times))
            fractions.plot(percent, reached, color=METHOD_STYLES[number].color, lw=1.8, drawstyle="steps-mid")
        _finish_errors(over_time, fractions, np.concatenate(list(errors.values())))
        handles, labels = over_time.get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower left", bbox_to_anchor=(0.6 / 11.5, 0.0), ncols=4)


def _draw_over_time(
    axes: "Axes", number: int, name: str, times: NDArray[np.float64], errors: NDArray[np.float64]
) -> None:
    """Draw the errors of one method over time, and a cross for each epoch without an answer."""
    style, is_missing = METHOD_STYLES[number], np.isnan(errors)
    size = 5.0 if len(times) <= 200 else 2.5
    drawn = np.maximum(errors, LEAST_ERROR)
    axes.plot(times, drawn, marker=style.marker, ms=size, mew=0, lw=1.0, color=style.color, label=name)
    axes.plot(
        times[is_missing], np.full(int(is_missing.sum()), 0.97 - 0.035 * number), "x", color=style.color, ms=6,
        transform=axes.get_xaxis_transform(), clip_on=False,
    )  # fmt: skip


def _finish_errors(over_time: "Axes", fractions: "Axes", errors: NDArray[np.float64]) -> None:
    """Scale and label both axes, and draw the limit of success."""
    known = errors[np.isfinite(errors)]
    highest, lowest = (float(known.max()), float(known.min())) if len(known) else (1.0, 0.01)
    over_time.set_yscale("log")
    over_time.set_ylim(0.6 * max(LEAST_ERROR, min(lowest, 0.1)), 2.5 * max(highest, 1.0))
    over_time.set_xlabel("time since the first epoch [s]")
    over_time.set_ylabel("error [m]")
    over_time.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    fractions.set_xlim(0.0, 101.0)
    fractions.set_xlabel("share of epochs with at most this error [%]")
    fractions.tick_params(labelleft=False)
    for axes in (over_time, fractions):
        axes.axhline(SUCCESS_DISTANCE, color=INK, lw=1.0, ls=DASHES, zorder=1)
        draw_grid(axes, which="major")


# The axis of distributions, m: a centimetre is below any reference's accuracy, ten metres beyond any search space.
LEAST, MOST = 0.01, 10.0


def percents_within(errors: NDArray[np.float64], limits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Percentage of all epochs with at most these errors; an epoch without an answer (NaN) is within none.

    errors: shape (n,); m, n > 0; limits: shape (m,); m. Returns shape (m,).
    """
    known = np.sort(errors[~np.isnan(errors)])
    return np.asarray(100.0 * np.searchsorted(known, limits, side="right") / len(errors), dtype=np.float64)


def plot_error_distributions(path: str | os.PathLike[str], errors_by_method: Mapping[str, ArrayLike]) -> None:
    """Draw the cumulative distribution of each method's horizontal errors over all epochs.

    path: a .png or .svg to write.
    errors_by_method: shape (n,); distance to the reference, m, by the method's name, at most 8, all of the same epochs;
        NaN where it did not localize: such an epoch is within no error, the curve ends below 100 %.
    """
    errors = as_methods_values(errors_by_method)
    words = (
        f"Epochs: {common_length(errors, 'answer')}, those without an answer too."
        f" Dashed: success, {SUCCESS_DISTANCE:g} m. Below: shares within it."
    )
    labels = [_label(name, values) for name, values in errors.items()]
    titles = ("How many epochs stay within which error", words)
    with method_chart(path, labels, titles, height=4.3, above=0.92) as (axes, handles):
        handles += [_draw_distribution(axes, number, values) for number, values in enumerate(errors.values())]
        axes.set_xscale("log")
        axes.set_xlim(LEAST, MOST)
        axes.set_ylim(0.0, 102.0)
        draw_number_ticks(axes.xaxis, LEAST, MOST)
        axes.set_xlabel("horizontal error [m]")
        axes.set_ylabel("share of all epochs with at most this error [%]")
        axes.axvline(SUCCESS_DISTANCE, color=INK, lw=1.1, ls=DASHES, zorder=2)
        draw_grid(axes, which="major")


def _label(name: str, errors: NDArray[np.float64]) -> str:
    """Return the legend of a method: its epochs within the limit of success, and those without an answer."""
    percent = float(percents_within(errors, np.array([SUCCESS_DISTANCE]))[0])
    n_missing = int(np.isnan(errors).sum())
    return f"{name}: {percent:.1f} %" + (f", {n_missing} without an answer" if n_missing else "")


def _draw_distribution(axes: "Axes", number: int, errors: NDArray[np.float64]) -> "Line2D":
    """Draw the curve of one method, from edge to edge, with a few of its markers."""
    style = METHOD_STYLES[number]
    inside = errors[(errors > LEAST) & (errors < MOST)]
    limits = np.concatenate([[LEAST], np.unique(inside), [MOST]])
    (line,) = axes.plot(
        limits, percents_within(errors, limits), color=style.color, ls=style.line, lw=1.9, marker=style.marker, ms=6.5,
        mec="white", mew=0.7, markevery=(0.03 + 0.012 * number, 0.13), drawstyle="steps-post", clip_on=False, zorder=3,
    )  # fmt: skip
    return line


MOST_BINS = 20
# Inches: height of the axes of success, and of a row of numbers of epochs above it.
AXES_HEIGHT, ROW = 4.1, 0.21


def count_by_distance(
    offsets: NDArray[np.float64], is_success: NDArray[np.bool_], bin_width: float, n_bins: int
) -> NDArray[np.int64]:
    """Count epochs and successes, shape (2, n_bins), by the distance of the prior from the reference.

    Bin k holds the distances from k to below k + 1 bin widths; all offsets are below n_bins bin widths.
    """
    bins = np.floor(offsets / bin_width).astype(np.int64)
    return np.array([np.bincount(chosen, minlength=n_bins) for chosen in (bins, bins[is_success])])


def plot_success(
    path: str | os.PathLike[str],
    offsets_by_method: Mapping[str, ArrayLike],
    success_by_method: Mapping[str, NDArray[np.bool_]],
) -> None:
    """Draw the success rate of each method against the distance of the prior from the reference.

    Bars are Wilson intervals of 95 %; the numbers of epochs of each bin stand above it.

    path: a .png or .svg to write.
    offsets_by_method: shape (n,); distance of each prior from the reference, m, finite, by the method's name, at most 8
        of them; the methods need not have the same epochs.
    success_by_method: shape (n,); bool: whether the method succeeded, under the same names; False where it did not
        localize.
    """
    offsets = as_methods_values(offsets_by_method, what="offsets")
    for name, values in offsets.items():
        if np.isnan(values).any():
            raise ArrayError(f"Expected the offsets of {name!r} to be finite, got NaN. Leave these epochs out.")
        if success_by_method[name].shape != values.shape:
            raise ArrayError(
                f"Expected the successes of {name!r} to have shape {values.shape}, got {success_by_method[name].shape}."
                " Give one per epoch, False for no answer."
            )
    farthest = max(float(values.max()) for values in offsets.values())
    bin_width = round_width(farthest)
    n_bins = int(farthest / bin_width) + 1
    bins = {name: count_by_distance(offsets[name], success_by_method[name], bin_width, n_bins) for name in offsets}
    rows = [n_epochs for n_epochs, _ in bins.values()]
    if all((row == rows[0]).all() for row in rows):
        rows = rows[:1]
    labels = [f"{name}: {100.0 * one[1].sum() / one[0].sum():.1f} %" for name, one in bins.items()]
    words = (
        f"Success: within {SUCCESS_WORDS} of the reference. Bins of {bin_width:g} m; bars: Wilson's 95 % intervals.\n"
        "Numbers above: epochs in each bin. Below: success over all epochs."
    )
    titles, above = ("Success by the error of the prior", words), len(rows) * ROW + 1.1
    with method_chart(path, labels, titles, height=AXES_HEIGHT, above=above, left=1.02, right=0.2) as (axes, handles):
        handles += [_draw_rates(axes, number, len(bins), one, bin_width) for number, one in enumerate(bins.values())]
        _draw_numbers(axes, rows, bin_width)
        axes.set_xlim(0.0, n_bins * bin_width)
        axes.set_ylim(0.0, 102.0)
        axes.set_xticks(np.arange(n_bins + 1) * bin_width)
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_xlabel("distance of the prior from the reference [m]")
        axes.set_ylabel("success [% of the epochs in the bin]")
        draw_grid(axes)


def round_width(farthest: float) -> float:
    """Return the smallest of 0.5, 1, 2, 5, 10, ... m that makes at most 20 bins up to the farthest offset."""
    width, number = 0.5, 0
    while int(farthest / width) >= MOST_BINS:
        width *= (2.0, 2.0, 2.5)[number % 3]
        number += 1
    return width


def _draw_rates(axes: "Axes", number: int, n_methods: int, counts: NDArray[np.int64], bin_width: float) -> "Line2D":
    """Draw the rates of one method with their intervals, set apart from the others' within each bin."""
    style = METHOD_STYLES[number]
    apart = (number - 0.5 * (n_methods - 1)) * min(0.12, 0.7 / n_methods)
    n_epochs, n_successes = counts
    places = (np.arange(len(n_epochs)) + 0.5 + apart) * bin_width
    low, high = wilson_interval(n_successes, n_epochs)
    rates = np.divide(n_successes, n_epochs, out=np.full(len(places), np.nan), where=n_epochs > 0)
    axes.vlines(places, 100.0 * low, 100.0 * high, color=style.color, lw=1.5, alpha=0.75, zorder=2)
    (line,) = axes.plot(
        places, 100.0 * rates, color=style.color, ls=style.line, lw=1.3, marker=style.marker, ms=6.5, mec="white",
        mew=0.7, zorder=3, clip_on=False,
    )  # fmt: skip
    return line


def _draw_numbers(axes: "Axes", rows: list[NDArray[np.int64]], bin_width: float) -> None:
    """Write how many epochs each bin holds above it: one row for all methods, or one for each."""
    place: dict[str, Any] = {
        "xycoords": ("data", "axes fraction"), "textcoords": "offset points", "va": "center", "fontsize": 9,
        "color": MUTED,
    }  # fmt: skip
    for number, row in enumerate(rows):
        above = 72.0 * ROW * (len(rows) - number - 0.35)
        for bin_number, n_epochs in enumerate(row):
            axes.annotate(f"{n_epochs}", ((bin_number + 0.5) * bin_width, 1.0), (0.0, above), ha="center", **place)
        if number == 0:
            axes.annotate("epochs", (0.0, 1.0), (-20.0, above), ha="right", **place)
        if len(rows) > 1:
            style, height = METHOD_STYLES[number], 1.0 + above / (72.0 * AXES_HEIGHT)
            axes.plot(-0.018, height, style.marker, color=style.color, ms=6.5, transform=axes.transAxes, clip_on=False)
