# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Stated certainty against errors: sigmas, Stanford diagram."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.evaluation import ALERT_LIMIT, PROMISED, Coverage, ProtectionCounts, clopper_pearson
from maxcon.plotting.canvas.figure import INK, MUTED, SERIES, draw_titles, saved_figure
from maxcon.plotting.canvas.method_style import as_epoch_values, check_methods, draw_number_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_PANELS = 4
# Errors below this part of the smallest sigma are drawn at it: the axis is logarithmic.
LEAST = 0.03
# More epochs are drawn as smaller, paler dots.
MANY_EPOCHS = 300
# Inches.
AXES_WIDTH, AXES_HEIGHT, SHARES_HEIGHT = 3.0, 3.3, 2.1
LEFT, BETWEEN, RIGHT, BELOW, ABOVE_SHARES, TITLES = 0.9, 1.0, 0.25, 0.62, 0.85, 1.5
# Where the lower axis ends, sigmas.
FARTHEST = 4.0


@dataclass(frozen=True)
class SigmaPanel:
    """Errors of one kind, and their predicted standard deviations.

    name, unit: name of the error ("along"), and the unit in which it is given and drawn.
    errors: shape (n,); in that unit; the sign does not matter. NaN where there is none.
    sigmas: shape (n,); in that unit, above 0; NaN where none is predicted.
    """

    name: str
    unit: str
    errors: ArrayLike
    sigmas: ArrayLike

    def known(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Absolute errors and sigmas of the epochs that have both."""
        errors = as_epoch_values(np.abs(np.asarray(self.errors, np.float64)), f"errors {self.name}", 0.0)
        sigmas = as_epoch_values(self.sigmas, f"sigmas {self.name}", np.finfo(float).tiny)
        if errors.shape != sigmas.shape:
            raise ArrayError(
                f"Expected errors and sigmas {self.name} of one shape, got {errors.shape} and {sigmas.shape}."
            )
        is_known = ~np.isnan(errors) & ~np.isnan(sigmas)
        return errors[is_known], sigmas[is_known]


def plot_sigmas(
    path: str | os.PathLike[str], panels: Sequence[SigmaPanel], *, title: str = "Error against predicted sigma"
) -> None:
    """Draw the error of each epoch against its predicted standard deviation, with lines at 1, 2 and 3 sigma.

    Below, the share of errors within k sigmas, over k, beside that of a normal distribution.

    path: a .png or .svg to write.
    panels: side by side, at most 4; each with at least one epoch that has an error and a sigma.
    title: what is written above.
    """
    if not 1 <= len(panels) <= MOST_PANELS:
        raise OptionError(f"Expected 1 to {MOST_PANELS} panels, got {len(panels)}. Draw several pictures.")
    known = [panel.known() for panel in panels]
    for panel, (errors, _) in zip(panels, known, strict=True):
        if len(errors) == 0:
            raise ArrayError(f"Expected an epoch with error and sigma {panel.name}, got none. Leave the panel out.")
    width = LEFT + len(panels) * AXES_WIDTH + (len(panels) - 1) * BETWEEN + RIGHT
    width, height = max(width, 8.2), BELOW + SHARES_HEIGHT + ABOVE_SHARES + AXES_HEIGHT + TITLES
    promised = ", ".join(f"{100.0 * share:.1f}" for share in PROMISED)
    with saved_figure(path, width, height) as figure:
        draw_titles(
            figure,
            title,
            f"Above: a dot for each epoch, lines at 1, 2 and 3 sigma; {promised} % of the dots should lie below them.\n"
            "Below: the share of errors within so many sigmas; shaded: what so many epochs leave possible (95 %).",
        )
        for number, (panel, (errors, sigmas)) in enumerate(zip(panels, known, strict=True)):
            left = LEFT + number * (AXES_WIDTH + BETWEEN)
            for bottom, row_height, draw in (
                (BELOW + SHARES_HEIGHT + ABOVE_SHARES, AXES_HEIGHT, _draw_panel),
                (BELOW, SHARES_HEIGHT, _draw_shares),
            ):
                axes = figure.add_axes((left / width, bottom / height, AXES_WIDTH / width, row_height / height))
                draw(axes, panel, errors, sigmas)


def _draw_panel(axes: "Axes", panel: SigmaPanel, errors: NDArray[np.float64], sigmas: NDArray[np.float64]) -> None:
    """Draw one kind of error."""
    low, high = 0.8 * float(sigmas.min()), 1.25 * float(sigmas.max())
    middle = (low * high) ** 0.5
    low, high = min(low, middle / 2.0), max(high, middle * 2.0)
    least, most = LEAST * float(sigmas.min()), 1.6 * max(3.0 * high, float(errors.max()))
    is_far = errors > 3.0 * sigmas
    size = 26.0 if len(errors) <= MANY_EPOCHS else 9.0
    for is_shown, color, marker in ((~is_far, SERIES[0], "o"), (is_far, SERIES[1], "D")):
        axes.scatter(
            sigmas[is_shown],
            np.maximum(errors[is_shown], least),
            s=size,
            color=color,
            marker=marker,
            alpha=0.55 if len(errors) <= MANY_EPOCHS else 0.35,
            linewidths=0.0,
            zorder=3,
            rasterized=len(errors) > MANY_EPOCHS,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set(xlim=(low, high), ylim=(least, most))
    for k, dashes in ((1, (0, (1.5, 1.5))), (2, (0, (5, 2))), (3, (0, None))):
        axes.plot([low, high], [k * low, k * high], color=INK, lw=1.1, ls=dashes, zorder=4)
    for k, below, place in ((1, -3.0, "top"), (3, 2.0, "bottom")):  # the line between is that of 2
        axes.annotate(
            f"{k}σ", (high, k * high), (-2.0, below), textcoords="offset points", ha="right", va=place, fontsize=8.5,
            color=INK, zorder=5,
        )  # fmt: skip
    draw_number_ticks(axes.xaxis, low, high)
    draw_number_ticks(axes.yaxis, least, most, least)
    axes.set_xlabel(f"predicted sigma [{panel.unit}]")
    axes.set_ylabel(f"error [{panel.unit}]")
    shares = Coverage.of(errors, sigmas).shares
    axes.set_title(
        f"{panel.name}\nwithin: " + " · ".join(f"{100.0 * share:.1f}" for share in shares) + f" % of {len(errors):,}",
        loc="left",
        fontsize=10.5,
        parse_math=False,
    )
    axes.grid(which="major", color="#dfe2e8", lw=0.7)
    axes.tick_params(which="minor", color=MUTED, length=2)
    axes.set_axisbelow(True)


def _draw_shares(axes: "Axes", panel: SigmaPanel, errors: NDArray[np.float64], sigmas: NDArray[np.float64]) -> None:
    """Draw the share of errors within k sigmas over k, and what it should be."""
    del panel
    limits = np.linspace(0.0, FARTHEST, 161)
    n_within = np.searchsorted(np.sort(errors / sigmas), limits, side="right")
    ends = np.array([clopper_pearson(int(n), len(errors)) for n in n_within])
    axes.fill_between(limits, *(100.0 * ends.T), color=SERIES[0], alpha=0.2, lw=0.0, zorder=1)
    axes.plot(limits, 100.0 * n_within / len(errors), color=SERIES[0], lw=1.7, label="these errors", zorder=3)
    normal = [100.0 * math.erf(limit / math.sqrt(2.0)) for limit in limits]
    axes.plot(limits, normal, color=INK, lw=1.3, ls=(0, (5, 2)), label="promised", zorder=2)
    axes.set(xlim=(0.0, FARTHEST), ylim=(0.0, 102.0))
    axes.set_xlabel("error [predicted sigmas]")
    axes.set_ylabel("epochs within [%]")
    axes.grid(color="#dfe2e8", lw=0.7)
    axes.set_axisbelow(True)
    axes.legend(loc="lower right", fontsize=9)


# Both axes, m: a millimetre is below any reference's accuracy.
LEAST_LEVEL = 1e-3
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
    line = np.array([LEAST_LEVEL, alert_limit])
    axes.fill_between(line, line, alert_limit, color=NOMINAL, lw=0.0, zorder=0)
    axes.fill_between(line, LEAST_LEVEL, line, color=MISLEADING, lw=0.0, zorder=0)
    axes.fill_between([alert_limit, most], LEAST_LEVEL, alert_limit, color=HAZARDOUS, lw=0.0, zorder=0)
    axes.fill_between([LEAST_LEVEL, most], alert_limit, most, color=UNAVAILABLE, lw=0.0, zorder=0)
    axes.plot([LEAST_LEVEL, most], [LEAST_LEVEL, most], color=INK, lw=1.1, zorder=2)
    for draw in (axes.axhline, axes.axvline):
        draw(alert_limit, color=INK, lw=1.1, ls=(0, (5, 3)), zorder=2)
    places = (
        (1.25 * LEAST_LEVEL, 0.86 * alert_limit, "left", "top", "nominal", counts.n_nominal),
        (0.92 * alert_limit, 1.25 * LEAST_LEVEL, "right", "bottom", "misleading", counts.n_misleading),
        (0.92 * most, 1.25 * LEAST_LEVEL, "right", "bottom", "hazardous", counts.n_hazardous),
        (1.25 * LEAST_LEVEL, 0.86 * most, "left", "top", "unavailable", counts.n_unavailable),
    )
    for x, y, across, up, word, n_epochs in places:
        axes.text(x, y, f"{word}\n{n_epochs:,}", ha=across, va=up, fontsize=9.5, color=INK, zorder=5, linespacing=1.25)


def _draw_epochs(axes: "Axes", strip: "Axes", errors: NDArray[np.float64], levels: NDArray[np.float64]) -> None:
    """Draw epochs with a level into the diagram, the errors of those without into the strip."""
    drawn = np.maximum(errors, LEAST_LEVEL)
    is_many = len(errors) > MANY_EPOCHS
    has_level, is_above = ~np.isnan(levels), errors > levels
    for is_shown, color, marker in ((has_level & ~is_above, SERIES[0], "o"), (has_level & is_above, SERIES[1], "D")):
        axes.scatter(
            drawn[is_shown], np.maximum(levels[is_shown], LEAST_LEVEL), s=9.0 if is_many else 26.0, color=color,
            marker=marker, alpha=0.35 if is_many else 0.6, linewidths=0.0, zorder=3, rasterized=is_many,
        )  # fmt: skip
    withheld = drawn[~has_level & ~np.isnan(errors)]
    if len(withheld):
        strip.plot(withheld, np.full(len(withheld), 0.5), "x", ms=5.5, mew=1.2, color=MUTED, clip_on=False)


def _finish(axes: "Axes", strip: "Axes", name: str, most: float) -> None:
    """Scale and label the axes."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set(xlim=(LEAST_LEVEL, most), ylim=(LEAST_LEVEL, most))
    for axis in (axes.xaxis, axes.yaxis):
        draw_number_ticks(axis, LEAST_LEVEL, most, LEAST_LEVEL)
    axes.set_xlabel(f"error {name} [m]")
    axes.set_ylabel(f"protection level {name} [m]")
    strip.set(ylim=(0.0, 1.0), yticks=[])
    strip.tick_params(which="both", bottom=False, labelbottom=False)
    strip.set_title(name, loc="left")
