# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How methods are told apart in one picture: by colour, and in grey print by line, marker and hatch."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError, OptionError
from maxcon.plotting.canvas.figure import INK, MUTED, SERIES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "METHOD_STYLES",
    "LegendShape",
    "MethodStyle",
    "as_epoch_values",
    "check_methods",
    "draw_legend",
    "draw_number_ticks",
]


class MethodStyle(NamedTuple):
    """How a method is drawn: its colour, dashes (offset, (on, off, ...)) in points, marker, and hatch of its areas."""

    color: str
    line: tuple[float, tuple[float, ...] | None]
    marker: str
    hatch: str


METHOD_STYLES = (
    MethodStyle(SERIES[0], (0, None), "o", ""),
    MethodStyle(SERIES[1], (0, (5, 1.6)), "s", "////"),
    MethodStyle(SERIES[2], (0, (1.2, 1.2)), "^", "...."),
    MethodStyle(SERIES[3], (0, (6, 1.4, 1.2, 1.4)), "D", "\\\\\\\\"),
    MethodStyle(SERIES[4], (0, (2.6, 1.2)), "v", "xxxx"),
    MethodStyle(SERIES[5], (0, (9, 2)), "P", "----"),
    MethodStyle(INK, (0, (6, 1.4, 1.2, 1.4, 1.2, 1.4)), "X", "||||"),
    MethodStyle(MUTED, (0, (2.6, 1.2, 1.2, 1.2)), "p", "++++"),
)
"""Styles of the methods of a picture, in the order in which they are given."""


class LegendShape(NamedTuple):
    """Rows and columns of a legend below a picture: as few rows as the labels fit into."""

    n_rows: int
    n_columns: int

    @classmethod
    def of(cls, labels: Sequence[str], width: float) -> "LegendShape":
        """Return the shape for labels in `width` inches."""
        widest = 0.85 + 0.078 * max(map(len, labels))
        n_columns = max(1, min(len(labels), 4, int(width / widest)))
        n_rows = math.ceil(len(labels) / n_columns)
        return cls(n_rows, math.ceil(len(labels) / n_rows))

    @property
    def height(self) -> float:
        """Height of the legend, inches."""
        return 0.1 + 0.22 * self.n_rows


def check_methods(by_method: Mapping[str, Any], largest: int = len(METHOD_STYLES)) -> None:
    """Raise an OptionError unless there are 1 to `largest` methods, as many as a picture can tell apart."""
    if not 1 <= len(by_method) <= largest:
        raise OptionError(f"Expected 1 to {largest} methods, got {len(by_method)}. Draw several pictures.")


def as_epoch_values(
    values: ArrayLike, name: str, low: float, high: float = np.inf, *, n_epochs: int | None = None
) -> NDArray[np.float64]:
    """Return values from `low` to `high` or NaN, as float64 of shape (n,): n = `n_epochs`, or any n > 0 if None."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or (len(array) == 0 if n_epochs is None else len(array) != n_epochs):
        shape = "(n,), n > 0" if n_epochs is None else f"({n_epochs},)"
        raise ArrayError(f"Expected {name} to have shape {shape}, got {array.shape}. Give one value per epoch.")
    is_wrong = (array < low) | (array > high) | np.isinf(array)
    if is_wrong.any():
        limits = f"{low:g} or more" if np.isinf(high) else f"from {low:g} to {high:g}"
        raise ArrayError(
            f"Expected {name} to be {limits}, got {array[is_wrong][0]:g}. Use NaN where it is not defined."
        )
    return array


def draw_legend(
    figure: "Figure", handles: Sequence[Any], labels: Sequence[str], shape: LegendShape, handle_length: float = 3.4
) -> None:
    """Write a legend at the lower left of a figure; a $ in labels begins no formula."""
    width = figure.get_size_inches()[0]
    legend = figure.legend(
        handles, labels, loc="lower left", bbox_to_anchor=(0.2 / width, 0.0), ncols=shape.n_columns,
        handlelength=handle_length, labelspacing=0.35,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)


def draw_number_ticks(axis: Any, low: float, high: float, least: float = 0.0) -> None:
    """Write 1, 2 and 5 times the powers of ten on a logarithmic axis; fewer over more than 3 decades.

    axis : x or y axis, or the long axis of a colour bar; low, high : its limits; least : lower values are drawn at this
    one, so its tick has a "≤".
    """
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter

    digits = (1.0, 2.0, 5.0) if high <= 1.001e3 * low else (1.0,)
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1.0)
    ticks = np.outer(powers, digits).ravel()
    is_shown = (ticks >= low * (1.0 - 1e-9)) & (ticks <= high * (1.0 + 1e-9))
    axis.set_major_locator(FixedLocator(list(ticks[is_shown])))
    axis.set_major_formatter(
        FuncFormatter(lambda value, _: f"{'≤ ' if value <= least * (1.0 + 1e-9) else ''}{value:g}")
    )
    axis.set_minor_formatter(NullFormatter())
