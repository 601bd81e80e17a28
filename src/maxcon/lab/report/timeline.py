# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A drive epoch by epoch: what the method said of each answer, and its errors beside what it predicted."""

import os
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.estimate import Status
from maxcon.lab.evaluation import SUCCESS_WORDS
from maxcon.lab.report.charts import draw_grid
from maxcon.plotting.figure import INK, MUTED, SERIES, saved_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BAND, TRUSTED, WITHHELD, WRONG = "#bcd9ee", SERIES[0], "#9aa1ad", "#c00000"
STATUS_COLORS = {
    Status.LOCALIZED.value: SERIES[0], Status.AMBIGUOUS.value: SERIES[4], Status.WALLS_MISSING.value: SERIES[3],
    Status.NOT_CONFIRMED.value: SERIES[5], Status.AT_RIM.value: SERIES[2], Status.UNDETERMINED.value: SERIES[1],
    Status.NOT_CONVERGED.value: SERIES[1],
}  # fmt: skip
"""Colours of the statuses that an answer can have; others are drawn in `MUTED`."""
# The axis ends at so many times what 98 % of the epochs stay below; errors beyond are marked at its end.
ROOM = 1.25
# Strokes of protection levels are at least as long as the width of the row over this.
MOST_STROKES = 400
# More epochs are drawn as pixels, as their strokes would take megabytes.
MANY_EPOCHS = 300
# Inches: the width of the figure and of its rows, and the heights of rows.
WIDTH, ROW_WIDTH, STATUS_ROW, ERROR_ROW = 11.5, 9.5, 0.24, 1.35


class ErrorRow(NamedTuple):
    """One kind of error over a drive, with its predicted standard deviations and protection levels.

    name, unit: name of the error ("along"), and the unit in which it is given and drawn.
    errors, sigmas, levels: shape (n,); in that unit, errors signed; NaN where there is none.
    """

    name: str
    unit: str
    errors: NDArray[np.float64]
    sigmas: NDArray[np.float64]
    levels: NDArray[np.float64]

    @property
    def limit(self) -> float:
        """The row is drawn from -limit to limit, a range that is not dominated by gross errors."""
        errors, *predicted = (
            float(np.nanquantile(values, 0.98)) if _is_any(values) else 0.0
            for values in (np.abs(self.errors), 2.0 * self.sigmas, self.levels)
        )
        limit = max(errors, *predicted) or 1.0
        if errors and max(predicted):  # a few gross errors must not flatten all others
            limit = min(limit, 4.0 * max(predicted))
        return ROOM * max(limit, 1e-3)


def _is_any(values: NDArray[np.float64]) -> bool:
    """Whether there is any value."""
    return not bool(np.isnan(values).all())


def _has_errors(rows: Sequence[ErrorRow]) -> bool:
    """Whether any error is known: without a reference none is."""
    return any(_is_any(row.errors) for row in rows)


def plot_timeline(
    path: str | os.PathLike[str],
    epochs: NDArray[np.float64],
    statuses: Sequence[str],
    is_wrong: NDArray[np.bool_],
    rows: Sequence[ErrorRow],
    *,
    title: str,
) -> None:
    """Draw a drive: a row for each status that occurs, and one for each kind of error, whether errors are known or not.

    epochs: shape (n,), n > 0; numbers of the scans, rising.
    statuses: status of each answer, as the method says.
    is_wrong: shape (n,); bool: whether the answer is known to be beyond the limits of success.
    """
    said = np.array(statuses)
    trusted = said == Status.LOCALIZED.value
    words = sorted(Counter(statuses), key=lambda word: (word != Status.LOCALIZED.value, -statuses.count(word)))
    lines = [(word, said == word, STATUS_COLORS.get(word, MUTED)) for word in words]
    if _has_errors(rows):
        lines.append(("trusted and wrong", trusted & is_wrong, WRONG))
    subtitle = _words(rows, len(epochs), int((trusted & is_wrong).sum()))
    # Width of the stroke of an epoch, points: without gaps between neighbours, and never too thin to be seen.
    step = float(np.median(np.diff(epochs))) if len(epochs) > 1 else 1.0
    extent = max(float(np.ptp(epochs)), 1.0)
    stroke = float(np.clip(0.9 * 72.0 * ROW_WIDTH * step / extent, 0.9, 8.0))
    heights = [len(lines) * STATUS_ROW, *([ERROR_ROW] * len(rows))]
    with saved_figure(path, WIDTH, 2.2 + sum(heights), title, subtitle) as figure:
        first, *others = panels = figure.subplots(len(heights), sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for axes in panels:
            draw_grid(axes)
        _draw_statuses(first, epochs, lines, stroke)
        for axes, row in zip(others, rows, strict=True):
            _draw_errors(axes, row, epochs, trusted, stroke, 0.5 * max(step, extent / MOST_STROKES))
            axes.set_ylabel(f"{row.name}\n[{row.unit}]", labelpad=8)
        figure.align_ylabels(others)
        panels[-1].set_xlabel("epoch (number of the scan)")
        margin = max(0.6, 0.012 * extent)
        first.set_xlim(epochs[0] - margin, epochs[-1] + margin)
        _draw_legend(figure, rows)


def _words(rows: Sequence[ErrorRow], n_epochs: int, n_wrong: int) -> str:
    """Return the subtitle: how many trusted answers are wrong, and what to look for."""
    if not _has_errors(rows):
        return f"{n_epochs:,} epochs, without a reference: what the method predicts."
    wrong = "No trusted answer is wrong" if n_wrong == 0 else f"Trusted and wrong: {n_wrong:,}"
    look = "The method predicts no errors: there are no bands."
    if any(_is_any(row.sigmas) for row in rows):
        look = "About 95 % of the dots should lie within the band, and hardly any beyond the lines."
    return f"{n_epochs:,} epochs. {wrong} ({SUCCESS_WORDS}).\n{look}"


def _draw_statuses(
    axes: "Axes", epochs: NDArray[np.float64], lines: Sequence[tuple[str, NDArray[np.bool_], str]], stroke: float
) -> None:
    """Draw a line of strokes for each status; those of wrong answers are never too thin to be seen."""
    is_many = len(epochs) > MANY_EPOCHS
    for number, (_, is_here, color) in enumerate(lines):
        width = max(stroke, 2.0) if color == WRONG else stroke
        axes.vlines(epochs[is_here], number - 0.36, number + 0.36, color=color, lw=width, rasterized=is_many)
    axes.set(ylim=(len(lines) - 0.5, -0.5))
    axes.set_yticks(range(len(lines)), [f"{word}: {int(is_here.sum()):,}" for word, is_here, _ in lines])
    axes.tick_params(axis="y", length=0, labelsize=9)
    axes.grid(visible=False, axis="y")


def _draw_errors(
    axes: "Axes", row: ErrorRow, epochs: NDArray[np.float64], trusted: NDArray[np.bool_], stroke: float, half: float
) -> None:
    """Draw band, levels (`half` an epoch to either side) and errors; those beyond the axis are marked at its end."""
    is_many, limit = len(epochs) > MANY_EPOCHS, row.limit
    axes.vlines(epochs, -2.0 * row.sigmas, 2.0 * row.sigmas, color=BAND, lw=stroke, zorder=1, rasterized=is_many)
    for sign in (-1.0, 1.0):
        axes.hlines(sign * row.levels, epochs - half, epochs + half, color=INK, lw=0.9, zorder=2, rasterized=is_many)
    size = 5.0 if len(epochs) <= 120 else 3.2 if len(epochs) <= 600 else 1.8
    for is_here, color, above in ((trusted, TRUSTED, 3), (~trusted, WITHHELD, 4)):
        here = is_here & (np.abs(row.errors) <= limit)
        look: dict[str, Any] = {"ls": "", "mew": 0, "color": color}
        axes.plot(epochs[here], row.errors[here], marker="o", ms=size, zorder=above, rasterized=is_many, **look)
        for sign, marker in ((1.0, "^"), (-1.0, "v")):
            beyond = epochs[is_here & (sign * row.errors > limit)]
            axes.plot(beyond, np.full(len(beyond), sign * 0.93 * limit), marker=marker, ms=5.5, zorder=5, **look)
    axes.axhline(0.0, color=MUTED, lw=0.7, zorder=1.5)
    axes.set_ylim(-limit, limit)
    axes.locator_params(axis="y", nbins=5)
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))


def _draw_legend(figure: "Figure", rows: Sequence[ErrorRow]) -> None:
    """Say what the marks of the error rows mean."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], ls="", marker="o", ms=6, color=TRUSTED, label="error, trusted answer"),
        Line2D([], [], ls="", marker="o", ms=6, color=WITHHELD, label="error, withheld answer"),
        Line2D([], [], ls="", marker="^", ms=6, color=MUTED, label="beyond the axis"),
    ]
    handles = handles if _has_errors(rows) else []
    if any(_is_any(row.sigmas) for row in rows):
        handles.append(Line2D([], [], color=BAND, lw=7, label="±2 predicted sigmas"))
    if any(_is_any(row.levels) for row in rows):
        handles.append(Line2D([], [], color=INK, lw=0.9, label="protection level"))
    figure.legend(handles=handles, loc="outside lower left", ncols=len(handles))
