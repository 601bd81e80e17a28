# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors of methods over a drive, and their shares."""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError
from maxcon.lab.evaluation import SUCCESS_DISTANCE
from maxcon.plotting.canvas.figure import INK, draw_titles, saved_figure
from maxcon.plotting.canvas.method_style import (
    METHOD_STYLES,
    LegendShape,
    as_epoch_values,
    check_methods,
    draw_legend,
    draw_number_ticks,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

# Errors below a millimetre are drawn at a millimetre: the axis is logarithmic.
LEAST_ERROR = 1e-3
# More methods cover each other.
MOST_METHODS = 6


def plot_errors(
    path: str | os.PathLike[str],
    times: ArrayLike,
    errors_by_method: Mapping[str, ArrayLike],
    *,
    title: str = "Error of each epoch",
    success: float = SUCCESS_DISTANCE,
) -> None:
    """Draw the horizontal error of each epoch over the drive, and the share of epochs within each error.

    path: a .png or .svg to write.
    times: shape (n,); when each epoch was, s; drawn from the first one on.
    errors_by_method: shape (n,); distance to the reference, m, by the method's name, at most 6; NaN where it did not
        localize.
    title: what is written above.
    success: the error drawn as the limit of success, m.
    """
    times = np.asarray(times, dtype=np.float64)
    check_methods(errors_by_method, MOST_METHODS)
    errors = {
        name: as_epoch_values(values, f"the errors of {name!r}", 0.0, n_epochs=len(times))
        for name, values in errors_by_method.items()
    }
    width, height = 11.5, 4.9
    with saved_figure(path, width, height) as figure:
        draw_titles(
            figure, title, f"Distance to the reference. Dashed: success, {success:g} m. Crosses on top: not localized."
        )
        over_time = figure.add_axes((0.8 / width, 1.05 / height, 6.9 / width, 2.85 / height))
        shares = figure.add_axes((8.0 / width, 1.05 / height, 3.25 / width, 2.85 / height), sharey=over_time)
        for number, (name, values) in enumerate(errors.items()):
            _draw_method(over_time, shares, number, name, times - times.min(initial=np.inf), values)
        _finish_errors(over_time, shares, errors, success)
        figure.legend(
            *over_time.get_legend_handles_labels(), loc="lower left", bbox_to_anchor=(0.6 / width, 0.0), ncols=4
        )


def _draw_method(
    over_time: "Axes", shares: "Axes", number: int, name: str, times: NDArray[np.float64], errors: NDArray[np.float64]
) -> None:
    """Draw one method: its errors over time, and their cumulative distribution."""
    style = METHOD_STYLES[number]
    drawn = np.maximum(errors, LEAST_ERROR)
    size = 5.0 if len(times) <= 200 else 2.5
    over_time.plot(times, drawn, marker=style.marker, ms=size, mew=0, lw=1.0, color=style.color, label=name)
    is_missing = np.isnan(errors)
    over_time.plot(
        times[is_missing],
        np.full(int(is_missing.sum()), 0.97 - 0.035 * number),
        "x",
        color=style.color,
        ms=6,
        transform=over_time.get_xaxis_transform(),
        clip_on=False,
    )
    reached = np.sort(drawn[~is_missing])
    percent = 100.0 * np.arange(1, len(reached) + 1) / max(1, len(times))
    shares.plot(percent, reached, color=style.color, lw=1.8, drawstyle="steps-mid")


def _finish_errors(
    over_time: "Axes", shares: "Axes", errors: Mapping[str, NDArray[np.float64]], success: float
) -> None:
    """Scale and label both axes, and draw the limit of success."""
    highest = max([float(np.nanmax(values)) for values in errors.values() if np.isfinite(values).any()] or [1.0])
    lowest = min([float(np.nanmin(values)) for values in errors.values() if np.isfinite(values).any()] or [0.01])
    over_time.set_yscale("log")
    over_time.set_ylim(0.6 * max(LEAST_ERROR, min(lowest, 0.1)), 2.5 * max(highest, 1.0))
    over_time.set_xlabel("time since the first epoch [s]")
    over_time.set_ylabel("error [m]")
    over_time.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    shares.set_xlim(0.0, 101.0)
    shares.set_xlabel("share of epochs with at most this error [%]")
    shares.tick_params(labelleft=False)
    for axes in (over_time, shares):
        axes.axhline(success, color=INK, lw=1.0, ls=(0, (5, 3)), zorder=1)
        axes.grid(which="major", color="#dfe2e8", lw=0.7)
        axes.set_axisbelow(True)


# The axis, m: a centimetre is below any reference's accuracy, ten metres beyond any search space.
LEAST, MOST = 0.01, 10.0
WIDTH, AXES_HEIGHT = 9.2, 4.3
# Inches: what is kept free around the axes.
LEFT, RIGHT, BELOW, TITLES = 0.82, 0.25, 0.62, 0.92


def shares_within(errors: NDArray[np.float64], limits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of all epochs with at most these errors, percent; an epoch without an answer is within none.

    errors: shape (n,); m, n > 0; NaN where there is no answer.
    limits: shape (m,); m.
    Returns shape (m,).
    """
    known = np.sort(errors[~np.isnan(errors)])
    return np.asarray(100.0 * np.searchsorted(known, limits, side="right") / len(errors), dtype=np.float64)


def plot_error_shares(
    path: str | os.PathLike[str],
    errors_by_method: Mapping[str, ArrayLike],
    *,
    success: float = SUCCESS_DISTANCE,
    title: str = "How many epochs stay within which error",
) -> None:
    """Draw the cumulative distribution of each method's horizontal errors over all epochs.

    path: a .png or .svg to write.
    errors_by_method: shape (n,); distance to the reference, m, by the method's name, at most 8, all of the same epochs;
        NaN where it did not localize: such an epoch is within no error, the curve ends below 100 %.
    success: the error drawn as the limit of success, m; the legend states each method's share within it.
    title: what is written above.
    """
    check_methods(errors_by_method)
    errors = {
        name: as_epoch_values(values, f"the errors of {name!r}", 0.0) for name, values in errors_by_method.items()
    }
    n_epochs = {len(values) for values in errors.values()}
    if len(n_epochs) > 1:
        raise ArrayError(
            f"Expected the same epochs of every method, got {sorted(n_epochs)} of them."
            " Use NaN where a method has no answer."
        )
    labels = [_label(name, values, success) for name, values in errors.items()]
    legend = LegendShape.of(labels, WIDTH)
    bottom = BELOW + legend.height
    height = bottom + AXES_HEIGHT + TITLES
    with saved_figure(path, WIDTH, height) as figure:
        draw_titles(
            figure,
            title,
            f"Epochs: {n_epochs.pop()}, those without an answer too."
            f" Dashed: success, {success:g} m. Below: shares within it.",
        )
        axes = figure.add_axes((LEFT / WIDTH, bottom / height, (WIDTH - LEFT - RIGHT) / WIDTH, AXES_HEIGHT / height))
        handles = [_draw_shares(axes, number, values) for number, values in enumerate(errors.values())]
        _finish(axes, success)
        draw_legend(figure, handles, labels, legend)


def _label(name: str, errors: NDArray[np.float64], success: float) -> str:
    """Return the legend of a method: its share within the limit of success, and epochs without an answer."""
    share = float(shares_within(errors, np.array([success]))[0])
    n_missing = int(np.isnan(errors).sum())
    return f"{name}: {share:.1f} %" + (f", {n_missing} without an answer" if n_missing else "")


def _draw_shares(axes: "Axes", number: int, errors: NDArray[np.float64]) -> "Line2D":
    """Draw the curve of one method, from edge to edge, with a few of its markers."""
    style = METHOD_STYLES[number]
    inside = errors[(errors > LEAST) & (errors < MOST)]
    limits = np.concatenate([[LEAST], np.unique(inside), [MOST]])
    (line,) = axes.plot(
        limits,
        shares_within(errors, limits),
        color=style.color,
        ls=style.line,
        lw=1.9,
        marker=style.marker,
        ms=6.5,
        mec="white",
        mew=0.7,
        markevery=(0.03 + 0.012 * number, 0.13),
        drawstyle="steps-post",
        clip_on=False,
        zorder=3,
    )
    return line


def _finish(axes: "Axes", success: float) -> None:
    """Scale and label the axes, and draw the limit of success."""
    axes.set_xscale("log")
    axes.set_xlim(LEAST, MOST)
    axes.set_ylim(0.0, 102.0)
    draw_number_ticks(axes.xaxis, LEAST, MOST)
    axes.set_xlabel("horizontal error [m]")
    axes.set_ylabel("share of all epochs with at most this error [%]")
    axes.axvline(success, color=INK, lw=1.1, ls=(0, (5, 3)), zorder=2)
    axes.grid(which="major", color="#dfe2e8", lw=0.7)
    axes.set_axisbelow(True)
