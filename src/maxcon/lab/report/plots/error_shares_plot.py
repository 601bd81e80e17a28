# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Cumulative distributions of errors: how many of all epochs each method localizes within which error."""

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

__all__ = ["plot_error_shares", "shares_within"]

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
