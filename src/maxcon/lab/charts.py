# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Charts of several methods: how each is drawn, their legend, and axes with grids and round numbers."""

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from maxcon.plotting.figure import INK, MUTED, SERIES, saved_figure
from maxcon.plotting.score_panel import SearchSpaceView

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

GRID = "#dfe2e8"
DASHES = (0, (5, 3))  # dashes of a line that marks a limit


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


def draw_legend(figure: "Figure", handles: Sequence[Any], labels: Sequence[str], **options: Any) -> "Legend":
    """Write a legend below all axes, in at most 4 columns that fit; a $ in labels begins no formula."""
    widest = 0.85 + 0.078 * max(map(len, labels))
    n_columns = max(1, min(len(labels), 4, int(figure.get_size_inches()[0] / widest)))
    n_rows = math.ceil(len(labels) / n_columns)
    legend = figure.legend(
        handles, labels, loc="outside lower left", ncols=math.ceil(len(labels) / n_rows), handlelength=3.4,
        labelspacing=0.35, **options,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)
    return legend


@contextmanager
def method_chart(
    path: str | os.PathLike[str], labels: Sequence[str], titles: tuple[str, str]
) -> Iterator[tuple["Axes", list[Any]]]:
    """Yield axes in a figure with a legend of methods below, and a list for the legend's handles."""
    with saved_figure(path, 9.2, 6.4, *titles) as figure:
        handles: list[Any] = []
        yield figure.subplots(), handles
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


def scale_words(views: Iterable[SearchSpaceView]) -> str:
    """Return the label of a colour scale from 0 to 1 that search spaces share, each from 0 to its own highest score."""
    if any(view.limits[0] < 0.0 for view in views):
        return "score, from the lowest (0) to the highest (1) of the square"
    return "score, over the highest of the square"


def offset_words(offset: float) -> str:
    """Return an offset (m) to the centimetre, with a minus that is as wide as a digit, and none before 0."""
    return f"{round(offset, 2) + 0.0:.2f}".replace("-", "−")
