"""Charts of several methods: how each is drawn, legends, grids, round numbers; the distributions of their errors."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.evaluation import SUCCESS_DISTANCE
from maxcon.lab.report import Picture
from maxcon.plotting.figure import INK, MUTED, SERIES, saved_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

Floats = NDArray[np.float64]
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


def draw_number_ticks(axis: Any, low: float, high: float, least: float = 0.0) -> None:
    """Write 1, 2 and 5 times the powers of ten on a logarithmic axis; fewer over more than 3 decades."""
    # It has the limits `low` and `high`; lower values than `least` are drawn at this one, so its tick has a “≤”.
    from matplotlib.ticker import NullFormatter

    digits = (1.0, 2.0, 5.0) if high <= 1.001e3 * low else (1.0,)
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1.0)
    ticks = np.outer(powers, digits).ravel()
    is_shown = (ticks >= low * (1.0 - 1e-9)) & (ticks <= high * (1.0 + 1e-9))
    axis.set_ticks(list(ticks[is_shown]))
    axis.set_major_formatter(lambda value, _: f"{'≤ ' if value <= least * (1.0 + 1e-9) else ''}{value:g}")
    axis.set_minor_formatter(NullFormatter())


# The axis of distributions, m: a centimetre is below any reference's accuracy, ten metres beyond any search space.
LEAST, MOST = 0.01, 10.0


def plot_error_distributions(path: Path, errors_by_method: Mapping[str, Floats]) -> Picture:
    """Draw the cumulative distribution of each method's horizontal errors over all epochs.

    errors_by_method: shape (n,); distance to the reference, m, by the method's name, at most 8, all of the same epochs;
        NaN without an answer: such an epoch is within no error, the curve ends below 100 %.
    """
    n_epochs = len(next(iter(errors_by_method.values())))
    words = (
        f"Epochs: {n_epochs}, those without an answer too. Dashed: success, {SUCCESS_DISTANCE:g} m."
        " Below: shares within it."
    )
    labels = [_distribution_label(name, values) for name, values in errors_by_method.items()]
    with saved_figure(path, 9.2, 6.4, "How many epochs stay within which error", words) as figure:
        axes, handles = figure.subplots(), []
        for number, (style, errors) in enumerate(zip(METHOD_STYLES, errors_by_method.values(), strict=False)):
            limits = np.unique([LEAST, *errors[(errors > LEAST) & (errors < MOST)], MOST])
            handles += axes.plot(
                limits, percents_within(errors, limits), color=style.color, ls=style.line, lw=1.9, marker=style.marker,
                ms=6.5, mec="white", mew=0.7, markevery=(0.03 + 0.012 * number, 0.13), drawstyle="steps-post",
                clip_on=False, zorder=3,
            )  # fmt: skip
        axes.set(xscale="log", xlim=(LEAST, MOST), ylim=(0.0, 102.0))
        draw_number_ticks(axes.xaxis, LEAST, MOST)
        axes.set_xlabel("horizontal error [m]")
        axes.set_ylabel("share of all epochs with at most this error [%]")
        axes.axvline(SUCCESS_DISTANCE, color=INK, lw=1.1, ls=DASHES, zorder=2)
        draw_grid(axes, which="major")
        draw_legend(figure, handles, labels)
    return Picture.of("errors", Path(path))


def percents_within(errors: Floats, limits: Floats) -> Floats:
    """Percentage of all epochs with at most these errors, shape (m,), for limits (m,); NaN is within none."""
    known = np.sort(errors[~np.isnan(errors)])
    return np.asarray(100.0 * np.searchsorted(known, limits, side="right") / len(errors), dtype=np.float64)


def _distribution_label(name: str, errors: Floats) -> str:
    """Return the legend of a method: its epochs within the limit of success, and those without an answer."""
    percent = float(percents_within(errors, np.array([SUCCESS_DISTANCE]))[0])
    n_missing = int(np.isnan(errors).sum())
    return f"{name}: {percent:.1f} %" + (f", {n_missing} without an answer" if n_missing else "")
