# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The Stanford diagram: protection levels, which a method says errors do not exceed, against true errors."""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.evaluation import ALERT_LIMIT, ProtectionCounts
from maxcon.plotting.canvas.figure import INK, MUTED, SERIES, draw_titles, saved_figure
from maxcon.plotting.canvas.method_style import as_epoch_values, check_methods, draw_number_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_stanford"]

# Both axes, m: a millimetre is below any reference's accuracy.
LEAST = 1e-3
MANY_EPOCHS = 300
MOST_DIRECTIONS = 2
NOMINAL, MISLEADING, HAZARDOUS, UNAVAILABLE = "#e3f4ec", "#fdeecb", "#f9d5c8", "#eceef2"
# Inches.
SIDE, LEFT, BETWEEN, RIGHT, BELOW, TITLES, STRIP = 4.2, 1.0, 1.05, 0.3, 1.12, 1.3, 0.3


def plot_stanford(
    path: str | os.PathLike[str],
    errors_by_direction: Mapping[str, ArrayLike],
    levels_by_direction: Mapping[str, ArrayLike],
    *,
    alert_limit: float = ALERT_LIMIT,
    title: str = "Protection level against true error",
) -> None:
    """Draw the protection level of each epoch against its error, with the number of epochs in each region.

    Below each panel stands the upper limit, with 95 % confidence, of the rate at which errors exceed their level.

    path: a .png or .svg to write.
    errors_by_direction: shape (n,); m, by the name of the direction, one or two; the sign does not matter. NaN where
        there is no answer.
    levels_by_direction: shape (n,); protection levels, m, above 0, under the same names; NaN where there is none: these
        errors are drawn in a strip above the diagram.
    alert_limit: the error above which a vehicle is in danger, m.
    title: what is written above.
    """
    check_methods(errors_by_direction, MOST_DIRECTIONS)
    if set(errors_by_direction) != set(levels_by_direction):
        raise OptionError(
            f"Expected errors and levels of the same directions, got {sorted(errors_by_direction)} and"
            f" {sorted(levels_by_direction)}. Use the same names."
        )
    found = {}
    for name, values in errors_by_direction.items():
        errors = as_epoch_values(np.abs(np.asarray(values, np.float64)), f"errors {name}", 0.0)
        levels = as_epoch_values(levels_by_direction[name], f"levels {name}", np.finfo(float).tiny)
        if errors.shape != levels.shape:
            raise ArrayError(f"Expected errors and levels {name} of one shape, got {errors.shape} and {levels.shape}.")
        found[name] = errors, levels
    everything = np.concatenate([np.concatenate(pair) for pair in found.values()])
    most = 1.6 * max(1.0, 2.0 * alert_limit, float(np.nanmax(everything, initial=0.0)))
    width = max(LEFT + len(found) * SIDE + (len(found) - 1) * BETWEEN + RIGHT, 7.4)
    height = BELOW + SIDE + STRIP + TITLES
    with saved_figure(path, width, height) as figure:
        draw_titles(
            figure,
            title,
            f"Right of the diagonal the error exceeds its protection level. Alert limit: {alert_limit:g} m.\n"
            "Strip on top: errors of answers that the method withheld or gave no level for.",
        )
        for number, (name, (errors, levels)) in enumerate(found.items()):
            left = LEFT + number * (SIDE + BETWEEN)
            axes = figure.add_axes((left / width, BELOW / height, SIDE / width, SIDE / height))
            strip = figure.add_axes((left / width, (BELOW + SIDE) / height, SIDE / width, STRIP / height), sharex=axes)
            counts = ProtectionCounts.of(errors, levels, alert_limit)
            _draw_regions(axes, counts, alert_limit, most)
            _draw_epochs(axes, strip, errors, levels)
            _finish(axes, strip, name, most)
            figure.text(
                left / width, 0.5 / height, _proof(counts), fontsize=9.5, color=MUTED, va="top", parse_math=False
            )


def _proof(counts: ProtectionCounts) -> str:
    """Say what the epochs prove of the rate at which errors exceed their level."""
    if counts.n_used == 0:
        return "No epoch has a level within the alert limit: nothing is proved."
    return (
        f"Errors above their level: {counts.n_exceeded:,} of {counts.n_used:,} used epochs;\n"
        f"proved with 95 % confidence: a rate of at most {100.0 * counts.exceeded_bound:.1f} %."
    )


def _draw_regions(axes: "Axes", counts: ProtectionCounts, alert_limit: float, most: float) -> None:
    """Colour the regions, and write into each how many epochs it holds."""
    line = np.array([LEAST, alert_limit])
    axes.fill_between(line, line, alert_limit, color=NOMINAL, lw=0.0, zorder=0)
    axes.fill_between(line, LEAST, line, color=MISLEADING, lw=0.0, zorder=0)
    axes.fill_between([alert_limit, most], LEAST, alert_limit, color=HAZARDOUS, lw=0.0, zorder=0)
    axes.fill_between([LEAST, most], alert_limit, most, color=UNAVAILABLE, lw=0.0, zorder=0)
    axes.plot([LEAST, most], [LEAST, most], color=INK, lw=1.1, zorder=2)
    for draw in (axes.axhline, axes.axvline):
        draw(alert_limit, color=INK, lw=1.1, ls=(0, (5, 3)), zorder=2)
    places = (
        (1.25 * LEAST, 0.86 * alert_limit, "left", "top", "nominal", counts.n_nominal),
        (0.92 * alert_limit, 1.25 * LEAST, "right", "bottom", "misleading", counts.n_misleading),
        (0.92 * most, 1.25 * LEAST, "right", "bottom", "hazardous", counts.n_hazardous),
        (1.25 * LEAST, 0.86 * most, "left", "top", "unavailable", counts.n_unavailable),
    )
    for x, y, across, up, word, n_epochs in places:
        axes.text(x, y, f"{word}\n{n_epochs:,}", ha=across, va=up, fontsize=9.5, color=INK, zorder=5, linespacing=1.25)


def _draw_epochs(axes: "Axes", strip: "Axes", errors: NDArray[np.float64], levels: NDArray[np.float64]) -> None:
    """Draw epochs with a level into the diagram, the errors of those without into the strip."""
    drawn = np.maximum(errors, LEAST)
    is_many = len(errors) > MANY_EPOCHS
    has_level, is_above = ~np.isnan(levels), errors > levels
    for is_shown, color, marker in ((has_level & ~is_above, SERIES[0], "o"), (has_level & is_above, SERIES[1], "D")):
        axes.scatter(
            drawn[is_shown], np.maximum(levels[is_shown], LEAST), s=9.0 if is_many else 26.0, color=color,
            marker=marker, alpha=0.35 if is_many else 0.6, linewidths=0.0, zorder=3, rasterized=is_many,
        )  # fmt: skip
    withheld = drawn[~has_level & ~np.isnan(errors)]
    if len(withheld):
        strip.plot(withheld, np.full(len(withheld), 0.5), "x", ms=5.5, mew=1.2, color=MUTED, clip_on=False)


def _finish(axes: "Axes", strip: "Axes", name: str, most: float) -> None:
    """Scale and label the axes."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set(xlim=(LEAST, most), ylim=(LEAST, most))
    for axis in (axes.xaxis, axes.yaxis):
        draw_number_ticks(axis, LEAST, most, LEAST)
    axes.set_xlabel(f"error {name} [m]")
    axes.set_ylabel(f"protection level {name} [m]")
    strip.set(ylim=(0.0, 1.0), yticks=[])
    strip.tick_params(which="both", bottom=False, labelbottom=False)
    strip.set_title(name, loc="left")
