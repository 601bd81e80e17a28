# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors over a drive, method by method: against time, and as cumulative distributions."""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.lab.evaluation import SUCCESS_DISTANCE
from maxcon.plotting.canvas.figure import INK, draw_titles, saved_figure
from maxcon.plotting.canvas.method_style import METHOD_STYLES, as_epoch_values, check_methods

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_errors"]

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
