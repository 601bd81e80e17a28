# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors against their predicted standard deviations."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.evaluation import PROMISED, Coverage, clopper_pearson
from maxcon.plotting.canvas.figure import INK, MUTED, SERIES, draw_titles, saved_figure
from maxcon.plotting.canvas.method_style import as_epoch_values, draw_number_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SigmaPanel", "plot_sigmas"]

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
