# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Errors and scores over time."""

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError, OptionError
from maxcon.estimate import Status
from maxcon.lab.evaluation import SUCCESS_WORDS
from maxcon.plotting.canvas.figure import INK, MUTED, SERIES, draw_titles, saved_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BAND, TRUSTED, WITHHELD = "#bcd9ee", SERIES[0], "#9aa1ad"
# The axis ends at so many times what 98 % of the epochs stay below; errors beyond are marked at its end.
ROOM = 1.25
# Strokes of protection levels are at least as long as the width of the row over this.
MOST_STROKES = 400
# More epochs are drawn as pixels, as their strokes would take megabytes.
MANY_EPOCHS = 300


@dataclass(frozen=True)
class ErrorRow:
    """One kind of error over a drive, with its predicted standard deviations and protection levels.

    name, unit: name of the error ("along"), and the unit in which it is given and drawn.
    errors: shape (n,); signed, in that unit; NaN where there is no answer.
    sigmas: shape (n,); predicted standard deviations in that unit; NaN where there is none.
    levels: shape (n,), optional; protection levels in that unit; NaN where there is none.
    """

    name: str
    unit: str
    errors: ArrayLike
    sigmas: ArrayLike
    levels: ArrayLike | None = None


@dataclass(frozen=True)
class ErrorDrawing:
    """The arrays of an `ErrorRow`, checked, and the range it is drawn in: from -limit to limit."""

    errors: NDArray[np.float64]
    sigmas: NDArray[np.float64]
    levels: NDArray[np.float64]
    limit: float

    @classmethod
    def of(cls, row: ErrorRow, n_epochs: int) -> "ErrorDrawing":
        """Check a row, and choose a range that is not dominated by gross errors."""
        levels = np.full(n_epochs, np.nan) if row.levels is None else row.levels
        found = [np.asarray(values, dtype=np.float64) for values in (row.errors, row.sigmas, levels)]
        if any(values.shape != (n_epochs,) for values in found):
            shapes = ", ".join(str(values.shape) for values in found)
            raise ArrayError(f"Expected errors, sigmas and levels {row.name} of shape ({n_epochs},), got {shapes}.")
        errors, sigmas, levels = found
        reach = [
            float(np.quantile(values[~np.isnan(values)], 0.98))
            for values in (np.abs(errors), 2.0 * sigmas, levels)
            if not np.isnan(values).all()
        ]
        predicted = reach[1:] if len(reach) > 1 else []
        limit = max(reach, default=1.0)
        if predicted:  # a few gross errors must not flatten all others
            limit = min(limit, 4.0 * max(predicted))
        return cls(errors, sigmas, levels, ROOM * max(limit, 1e-3))

    @property
    def has_sigmas(self) -> bool:
        """Whether anything is predicted."""
        return not bool(np.isnan(self.sigmas).all())

    @property
    def has_levels(self) -> bool:
        """Whether there is a protection level."""
        return not bool(np.isnan(self.levels).all())

    def draw(self, axes: "Axes", numbers: NDArray[np.float64], trusted: NDArray[np.bool_], stroke: float) -> None:
        """Draw band, levels and errors; errors beyond the axis are marked at its end.

        numbers, trusted : (n,), number of each epoch, and whether its answer is trusted; stroke : width, points.
        """
        is_many = len(numbers) > MANY_EPOCHS
        axes.vlines(numbers, -2.0 * self.sigmas, 2.0 * self.sigmas, color=BAND, lw=stroke, zorder=1, rasterized=is_many)
        step = float(np.median(np.diff(numbers))) if len(numbers) > 1 else 1.0
        half = 0.5 * max(step, float(np.ptp(numbers)) / MOST_STROKES)
        for sign in (-1.0, 1.0):
            axes.hlines(
                sign * self.levels, numbers - half, numbers + half, color=INK, lw=0.9, zorder=2, rasterized=is_many
            )
        size = 5.0 if len(numbers) <= 120 else 3.2 if len(numbers) <= 600 else 1.8
        is_inside = np.abs(self.errors) <= self.limit
        for is_here, color, above in ((trusted, TRUSTED, 3), (~trusted, WITHHELD, 4)):
            here = is_inside & is_here
            look: dict[str, Any] = {"ls": "", "mew": 0, "color": color}
            axes.plot(numbers[here], self.errors[here], marker="o", ms=size, zorder=above, rasterized=is_many, **look)
            for sign, marker in ((1.0, "^"), (-1.0, "v")):
                beyond = numbers[is_here & (sign * self.errors > self.limit)]
                rim = np.full(len(beyond), sign * 0.93 * self.limit)
                axes.plot(beyond, rim, marker=marker, ms=5.5, zorder=5, **look)
        axes.axhline(0.0, color=MUTED, lw=0.7, zorder=1.5)
        axes.set_ylim(-self.limit, self.limit)
        axes.locator_params(axis="y", nbins=5)
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))


STATUS_COLORS = {
    Status.LOCALIZED.value: SERIES[2],
    Status.AMBIGUOUS.value: SERIES[4],
    Status.WALLS_MISSING.value: SERIES[3],
    Status.NOT_CONFIRMED.value: SERIES[5],
    Status.AT_RIM.value: SERIES[0],
    Status.UNDETERMINED.value: SERIES[1],
    Status.NOT_CONVERGED.value: SERIES[1],
}
"""Colours of the statuses that an answer can have; others are drawn in `MUTED`."""

WIDTH = 11.5
# Inches.
LEFT, RIGHT, BELOW, TITLES, BETWEEN = 1.75, 0.25, 1.0, 1.08, 0.12
STATUS_ROW, ERROR_ROW = 0.24, 1.35
MOST_ROWS = 4


def plot_timeline(
    path: str | os.PathLike[str],
    epochs: ArrayLike,
    statuses: Sequence[str],
    is_wrong: ArrayLike,
    rows: Sequence[ErrorRow],
    *,
    title: str = "The drive, epoch by epoch",
) -> None:
    """Draw a drive: a row for each status that occurs, and one for each kind of error.

    path: a .png or .svg to write.
    epochs: shape (n,); numbers of the scans, rising.
    statuses: status of each answer, as the method says.
    is_wrong: shape (n,); bool: whether the answer is known to be beyond the limits of success.
    rows: at most 4.
    title: what is written above.
    """
    numbers, wrong = np.asarray(epochs, dtype=np.float64), np.asarray(is_wrong, dtype=bool)
    if not 1 <= len(rows) <= MOST_ROWS:
        raise OptionError(f"Expected 1 to {MOST_ROWS} rows, got {len(rows)}. Draw several pictures.")
    if numbers.ndim != 1 or len(numbers) == 0 or wrong.shape != numbers.shape or len(statuses) != len(numbers):
        raise ArrayError(
            f"Expected one status, and whether it is wrong, for each of n > 0 epochs, got {numbers.shape},"
            f" {len(statuses)} and {wrong.shape}."
        )
    errors = [ErrorDrawing.of(row, len(numbers)) for row in rows]
    words = [word for word, _ in Counter(statuses).most_common()]
    words.sort(key=lambda word: word != Status.LOCALIZED.value)
    trusted = np.array([word == Status.LOCALIZED.value for word in statuses])
    n_lines = len(words) + 1
    height = BELOW + len(rows) * (ERROR_ROW + BETWEEN) + n_lines * STATUS_ROW + TITLES
    with saved_figure(path, WIDTH, height) as figure:
        draw_titles(figure, title, _words(errors, len(numbers), int((trusted & wrong).sum())))
        stroke = _stroke(numbers)
        bottom = height - TITLES - n_lines * STATUS_ROW
        first = _add_row(figure, bottom, n_lines * STATUS_ROW, None)
        _draw_statuses(first, numbers, statuses, words, trusted & wrong, stroke)
        for row, drawn in zip(rows, errors, strict=True):
            bottom -= ERROR_ROW + BETWEEN
            axes = _add_row(figure, bottom, ERROR_ROW, first)
            drawn.draw(axes, numbers, trusted, stroke)
            axes.set_ylabel(f"{row.name}\n[{row.unit}]", labelpad=8)
        axes.set_xlabel("epoch (number of the scan)")
        axes.tick_params(labelbottom=True)
        margin = max(0.6, 0.012 * float(np.ptp(numbers)))
        first.set_xlim(numbers[0] - margin, numbers[-1] + margin)
        _draw_legend(figure, errors)


def _words(errors: "Sequence[ErrorDrawing]", n_epochs: int, n_wrong: int) -> str:
    """Return the subtitle: how many trusted answers are wrong, and what to look for."""
    wrong = "No trusted answer is wrong" if n_wrong == 0 else f"Trusted and wrong: {n_wrong:,}"
    lines = [f"{n_epochs:,} epochs. {wrong} ({SUCCESS_WORDS})."]
    if any(drawn.has_sigmas for drawn in errors):
        lines.append("About 95 % of the dots should lie within the band, and hardly any beyond the lines.")
    else:
        lines.append("The method predicts no errors: there are no bands.")
    return "\n".join(lines)


def _stroke(numbers: NDArray[np.float64]) -> float:
    """Width of the stroke of an epoch, points: without gaps between neighbours, and never too thin to be seen."""
    if len(numbers) == 1:
        return 8.0
    step = float(np.median(np.diff(numbers))) / max(float(np.ptp(numbers)), 1.0)
    return float(np.clip(0.9 * 72.0 * (WIDTH - LEFT - RIGHT) * step, 0.9, 8.0))


def _add_row(figure: "Figure", bottom: float, row_height: float, first: "Axes | None") -> "Axes":
    """Add axes over the whole width, with its bottom and height in inches, sharing the x axis of the first row."""
    _, height = figure.get_size_inches()
    axes = figure.add_axes(
        (LEFT / WIDTH, bottom / height, (WIDTH - LEFT - RIGHT) / WIDTH, row_height / height), sharex=first
    )
    axes.tick_params(labelbottom=False)
    axes.grid(color="#dfe2e8", lw=0.7)
    axes.set_axisbelow(True)
    return axes


def _draw_statuses(
    axes: "Axes",
    numbers: NDArray[np.float64],
    statuses: Sequence[str],
    words: Sequence[str],
    is_false: NDArray[np.bool_],
    stroke: float,
) -> None:
    """Draw a line of strokes for each status, and one for answers that are trusted and wrong."""
    said = np.array(statuses)
    lines = [(word, said == word, STATUS_COLORS.get(word, MUTED)) for word in words]
    lines.append(("trusted and wrong", is_false, "#c00000"))
    for number, (_, is_here, color) in enumerate(lines):
        axes.vlines(
            numbers[is_here],
            number - 0.36,
            number + 0.36,
            color=color,
            lw=stroke if number < len(words) else max(stroke, 2.0),
            rasterized=len(numbers) > MANY_EPOCHS,
        )
    axes.set(ylim=(len(lines) - 0.5, -0.5))
    axes.set_yticks(range(len(lines)), [f"{word}: {int(is_here.sum()):,}" for word, is_here, _ in lines])
    axes.tick_params(axis="y", length=0, labelsize=9)
    axes.grid(visible=False, axis="y")


def _draw_legend(figure: "Figure", errors: Sequence[ErrorDrawing]) -> None:
    """Say what the marks of the error rows mean."""
    from matplotlib.lines import Line2D

    entries = [
        (Line2D([], [], ls="", marker="o", ms=6, color=TRUSTED), "error, trusted answer"),
        (Line2D([], [], ls="", marker="o", ms=6, color=WITHHELD), "error, withheld answer"),
        (Line2D([], [], ls="", marker="^", ms=6, color=MUTED), "beyond the axis"),
    ]
    if any(drawn.has_sigmas for drawn in errors):
        entries.append((Line2D([], [], color=BAND, lw=7), "±2 predicted sigmas"))
    if any(drawn.has_levels for drawn in errors):
        entries.append((Line2D([], [], color=INK, lw=0.9), "protection level"))
    handles, labels = zip(*entries, strict=True)
    figure.legend(handles, labels, loc="lower left", bbox_to_anchor=(0.2 / WIDTH, 0.0), ncols=len(entries))
