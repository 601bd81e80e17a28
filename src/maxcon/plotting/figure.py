# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The common style of all figures, their files (same input, same bytes), axes in inches, and styles of methods."""

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon._system.atomic import atomic_file
from maxcon.errors import ArrayError, MissingExtraError, OptionError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, MUTED, GRID = "#1f2430", "#5b6270", "#dfe2e8"
SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Colours of things that stand side by side; told apart by colour-blind readers too (Okabe and Ito)."""
DASHES = (0, (5, 3))
"""Dashes of a line that marks a limit."""

DOTS_PER_INCH = 120
# Set over matplotlib's own defaults, so that no settings of the user's change what a figure shows.
_STYLE: dict[Any, Any] = {
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.labelsize": 10.5,
    "axes.linewidth": 0.8,
    "axes.titlecolor": INK,
    "axes.titlesize": 11,
    "figure.dpi": DOTS_PER_INCH,
    "font.family": "DejaVu Sans",
    "legend.fontsize": 10,
    "legend.frameon": False,
    "savefig.dpi": DOTS_PER_INCH,
    "svg.fonttype": "path",
    "svg.hashsalt": "maxcon",
    "text.color": INK,
    "xtick.color": MUTED,
    "xtick.labelsize": 9.5,
    "ytick.color": MUTED,
    "ytick.labelsize": 9.5,
}
_METADATA: dict[str, dict[str, Any]] = {"png": {"Software": None}, "svg": {"Date": None, "Creator": None}}


def check_matplotlib() -> None:
    """Raise a MissingExtraError if matplotlib is not installed, before the work whose result it is to draw."""
    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(
            "Expected matplotlib to draw pictures, but it is not installed. Run: pip install 'maxcon[demo]'"
        ) from error


@contextmanager
def saved_figure(
    path: str | os.PathLike[str], width: float, height: float, title: str, lines: str
) -> Iterator["Figure"]:
    """Yield a figure of some inches to draw on, with a title; it is written to `path` when the block ends well.

    path: ends in .png, of 120 pixels to the inch, or .svg.
    title, lines: written at the top left; a $ in them begins no formula.
    """
    kind = Path(path).suffix.lower().removeprefix(".")
    if kind not in _METADATA:
        raise OptionError(f"Expected the name of a picture to end in .png or .svg, got {os.fspath(path)!r}. Rename it.")
    check_matplotlib()
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        figure = Figure(figsize=(width, height), facecolor="white")
        FigureCanvasAgg(figure)
        left, top = 0.3 / width, 1.0 - 0.16 / height
        figure.text(left, top, title, fontsize=15, fontweight="bold", va="top", parse_math=False)
        figure.text(left, top - 0.34 / height, lines, fontsize=11, va="top", linespacing=1.35, parse_math=False)
        yield figure
        with atomic_file(path) as partial:
            figure.savefig(partial, format=kind, metadata=_METADATA[kind])


def add_axes(figure: "Figure", left: float, bottom: float, width: float, height: float, **options: Any) -> "Axes":
    """Add axes to a figure; place and size in inches."""
    across, up = figure.get_size_inches()
    return figure.add_axes((left / across, bottom / up, width / across, height / up), **options)


def draw_grid(axes: "Axes", **options: Any) -> None:
    """Draw thin grid lines below everything else."""
    axes.grid(**{"color": GRID, "lw": 0.7, **options})
    axes.set_axisbelow(True)


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
"""Styles of the methods of a figure, in the order in which they are given: each mark alone tells them apart."""


def check_count(n_given: int, largest: int, what: str) -> None:
    """Raise an OptionError unless there are 1 to `largest` things, as many as a figure can tell apart."""
    if not 1 <= n_given <= largest:
        raise OptionError(f"Expected 1 to {largest} {what}, got {n_given}. Draw several pictures.")


def as_epoch_values(
    values: ArrayLike, name: str, low: float, high: float = np.inf, *, n_epochs: int | None = None
) -> NDArray[np.float64]:
    """Return values from `low` to `high` or NaN, as float64 of shape (n,): n = `n_epochs`, or any n > 0 if None."""
    array = np.asarray(values, dtype=np.float64)
    shape = "(n,), n > 0" if n_epochs is None else f"({n_epochs},)"
    if array.ndim != 1 or len(array) != (n_epochs if n_epochs is not None else max(len(array), 1)):
        raise ArrayError(f"Expected {name} to have shape {shape}, got {array.shape}. Give one value per epoch.")
    is_wrong = (array < low) | (array > high) | np.isinf(array)
    if is_wrong.any():
        limits = f"{low:g} or more" if np.isinf(high) else f"from {low:g} to {high:g}"
        found = f"{array[is_wrong][0]:g}. Use NaN where it is not defined."
        raise ArrayError(f"Expected {name} to be {limits}, got {found}")
    return array


def as_methods_values(
    by_method: Mapping[str, ArrayLike],
    largest: int = len(METHOD_STYLES),
    *,
    what: str = "errors",
    n_epochs: int | None = None,
) -> dict[str, NDArray[np.float64]]:
    """Return values of 0 or more, or NaN, of 1 to `largest` methods by their names, each of shape (n,)."""
    check_count(len(by_method), largest, "methods")
    named = ((name, f"the {what} of {name!r}", values) for name, values in by_method.items())
    return {name: as_epoch_values(values, words, 0.0, n_epochs=n_epochs) for name, words, values in named}


def common_length(by_method: Mapping[str, Any], missing: str) -> int:
    """Return the number of epochs, or raise an ArrayError if methods have different numbers of them."""
    n_epochs = {len(values) for values in by_method.values()}
    if len(n_epochs) > 1:
        found = f"{sorted(n_epochs)} of them. Use NaN where a method has no {missing}."
        raise ArrayError(f"Expected the same epochs of every method, got {found}")
    return n_epochs.pop()


class LegendShape(NamedTuple):
    """Rows, columns and height (inches) of a legend below a figure: as few rows as the labels fit into."""

    n_rows: int
    n_columns: int
    height: float

    @classmethod
    def of(cls, labels: Sequence[str], width: float) -> "LegendShape":
        """Return the shape for labels in `width` inches."""
        widest = 0.85 + 0.078 * max(map(len, labels))
        n_rows = math.ceil(len(labels) / max(1, min(len(labels), 4, int(width / widest))))
        return cls(n_rows, math.ceil(len(labels) / n_rows), 0.1 + 0.22 * n_rows)


def draw_legend(figure: "Figure", handles: Sequence[Any], labels: Sequence[str], handle_length: float = 3.4) -> None:
    """Write a legend at the lower left of a figure, in the shape that fits; a $ in labels begins no formula."""
    width = figure.get_size_inches()[0]
    n_columns, place = LegendShape.of(labels, width).n_columns, (0.2 / width, 0.0)
    legend = figure.legend(
        handles, labels, loc="lower left", bbox_to_anchor=place, ncols=n_columns, handlelength=handle_length,
        labelspacing=0.35,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)


@contextmanager
def method_chart(
    path: str | os.PathLike[str],
    labels: Sequence[str],
    titles: tuple[str, str],
    *,
    height: float,
    above: float,
    left: float = 0.82,
    right: float = 0.25,
) -> Iterator[tuple["Axes", list[Any]]]:
    """Yield axes of `height` inches in a figure with a legend of methods below, and a list for the legend's handles.

    `above`, `left` and `right` are kept free around the axes, inches.
    """
    width = 9.2
    bottom = 0.62 + LegendShape.of(labels, width).height
    with saved_figure(path, width, bottom + height + above, *titles) as figure:
        handles: list[Any] = []
        yield add_axes(figure, left, bottom, width - left - right, height), handles
        draw_legend(figure, handles, labels)


def draw_number_ticks(axis: Any, low: float, high: float, least: float = 0.0) -> None:
    """Write 1, 2 and 5 times the powers of ten on a logarithmic axis; fewer over more than 3 decades.

    axis: x or y axis, or the long axis of a colour bar, with the limits `low` and `high`.
    least: lower values are drawn at this one, so its tick has a "≤".
    """
    from matplotlib.ticker import NullFormatter

    digits = (1.0, 2.0, 5.0) if high <= 1.001e3 * low else (1.0,)
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1.0)
    ticks = np.outer(powers, digits).ravel()
    is_shown = (ticks >= low * (1.0 - 1e-9)) & (ticks <= high * (1.0 + 1e-9))
    axis.set_ticks(list(ticks[is_shown]))
    axis.set_major_formatter(lambda value, _: f"{'≤ ' if value <= least * (1.0 + 1e-9) else ''}{value:g}")
    axis.set_minor_formatter(NullFormatter())
