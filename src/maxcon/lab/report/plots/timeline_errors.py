# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""One kind of error over a drive, drawn with the band that the method predicts and its protection level."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError
from maxcon.plotting.canvas.figure import INK, MUTED, SERIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["BAND", "MANY_EPOCHS", "TRUSTED", "WITHHELD", "ErrorDrawing", "ErrorRow"]

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
