# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Stated certainty against errors: the Stanford diagram, risk over coverage."""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.evaluation import ALERT_LIMIT, SUCCESS_WORDS, ProtectionCounts, RiskCoverage
from maxcon.lab.report.charts import (
    DASHES,
    METHOD_STYLES,
    Floats,
    MethodStyle,
    draw_grid,
    draw_number_ticks,
    method_chart,
)
from maxcon.plotting.figure import INK, MUTED, SERIES, saved_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

# More epochs are drawn as smaller, paler dots.
MANY_EPOCHS = 300


def _draw_dots(axes: "Axes", x: Floats, y: Floats, is_exceeded: NDArray[np.bool_]) -> None:
    """Draw a dot per epoch on logarithmic axes, those whose error exceeds its limit with other marks."""
    is_many = len(x) > MANY_EPOCHS
    size, alpha = (9.0, 0.35) if is_many else (26.0, 0.55)
    for is_shown, color, marker in ((~is_exceeded, SERIES[0], "o"), (is_exceeded, SERIES[1], "D")):
        axes.scatter(
            x[is_shown], y[is_shown], s=size, color=color, marker=marker, alpha=alpha,
            linewidths=0.0, zorder=3, rasterized=is_many,
        )  # fmt: skip
    axes.set(xscale="log", yscale="log")


# Both axes of the Stanford diagram, m: a millimetre is below any reference's accuracy.
LEAST_LEVEL = 1e-3
NOMINAL, MISLEADING, HAZARDOUS, UNAVAILABLE = "#e3f4ec", "#fdeecb", "#f9d5c8", "#eceef2"


def plot_stanford(
    path: str | os.PathLike[str], errors_by_direction: Mapping[str, Floats], levels_by_direction: Mapping[str, Floats],
    *, title: str,
) -> None:  # fmt: skip
    """Draw the protection level of each epoch against its error, count each region, and say what that proves.

    errors_by_direction, levels_by_direction: shape (n,); m, by the name of the direction; the sign does not matter.
        Without an answer the error is NaN, without a level the level: such errors lie in a strip above the diagram.
    """
    everything = np.abs(np.concatenate([*errors_by_direction.values(), *levels_by_direction.values()]))
    most = 1.6 * max(1.0, 2.0 * ALERT_LIMIT, float(np.nanmax(everything, initial=0.0)))
    words = (
        f"Right of the diagonal the error exceeds its protection level. Alert limit: {ALERT_LIMIT:g} m.\n"
        "Strip on top: errors of answers that the method withheld or gave no level for."
    )
    with saved_figure(path, max(7.4, 5.3 * len(errors_by_direction)), 7.3, title, words) as figure:
        panels = figure.subplots(1, len(errors_by_direction), squeeze=False)[0]
        for axes, (name, errors) in zip(panels, errors_by_direction.items(), strict=True):
            levels = levels_by_direction[name]
            strip = axes.inset_axes((0.0, 1.0, 1.0, 0.07), sharex=axes)
            counts = ProtectionCounts.of(errors, levels)
            _draw_regions(axes, counts, most)
            _draw_levels(axes, strip, np.abs(errors), levels)
            axes.set(xlim=(LEAST_LEVEL, most), ylim=(LEAST_LEVEL, most), box_aspect=1.0)
            for axis in (axes.xaxis, axes.yaxis):
                draw_number_ticks(axis, LEAST_LEVEL, most, LEAST_LEVEL)
            axes.set(xlabel=f"error {name} [m]\n\n{_proof(counts)}", ylabel=f"protection level {name} [m]")
            strip.set(ylim=(0.0, 1.0), yticks=[])
            strip.tick_params(which="both", bottom=False, labelbottom=False)
            strip.set_title(name, loc="left")


def _proof(counts: ProtectionCounts) -> str:
    """Say what the epochs prove of the rate at which errors exceed their level."""
    if counts.n_used == 0:
        return "No epoch has a level within the alert limit:\nnothing is proved."
    return (
        f"Errors above their level: {counts.n_exceeded:,} of {counts.n_used:,} used epochs;\n"
        f"proved with 95 % confidence: a rate of at most {100.0 * counts.exceeded_bound:.1f} %."
    )


def _draw_regions(axes: "Axes", counts: ProtectionCounts, most: float) -> None:
    """Colour the regions, and write into each how many epochs it holds."""
    line = np.array([LEAST_LEVEL, ALERT_LIMIT])
    axes.fill_between(line, line, ALERT_LIMIT, color=NOMINAL, lw=0.0, zorder=0)
    axes.fill_between(line, LEAST_LEVEL, line, color=MISLEADING, lw=0.0, zorder=0)
    axes.fill_between([ALERT_LIMIT, most], LEAST_LEVEL, ALERT_LIMIT, color=HAZARDOUS, lw=0.0, zorder=0)
    axes.fill_between([LEAST_LEVEL, most], ALERT_LIMIT, most, color=UNAVAILABLE, lw=0.0, zorder=0)
    axes.plot([LEAST_LEVEL, most], [LEAST_LEVEL, most], color=INK, lw=1.1, zorder=2)
    for draw in (axes.axhline, axes.axvline):
        draw(ALERT_LIMIT, color=INK, lw=1.1, ls=DASHES, zorder=2)
    for x, y, across, up, word, n_epochs in (
        (1.25 * LEAST_LEVEL, 0.86 * ALERT_LIMIT, "left", "top", "nominal", counts.n_nominal),
        (0.92 * ALERT_LIMIT, 1.25 * LEAST_LEVEL, "right", "bottom", "misleading", counts.n_misleading),
        (0.92 * most, 1.25 * LEAST_LEVEL, "right", "bottom", "hazardous", counts.n_hazardous),
        (1.25 * LEAST_LEVEL, 0.86 * most, "left", "top", "unavailable", counts.n_unavailable),
    ):
        axes.text(x, y, f"{word}\n{n_epochs:,}", ha=across, va=up, fontsize=9.5, color=INK, zorder=5, linespacing=1.25)


def _draw_levels(axes: "Axes", strip: "Axes", errors: Floats, levels: Floats) -> None:
    """Draw epochs with a level into the diagram, the errors of those without into the strip."""
    drawn, has_level = np.maximum(errors, LEAST_LEVEL), ~np.isnan(levels)
    shown = np.maximum(levels[has_level], LEAST_LEVEL)
    _draw_dots(axes, drawn[has_level], shown, errors[has_level] > levels[has_level])
    withheld = drawn[~has_level & ~np.isnan(errors)]
    if len(withheld):
        strip.plot(withheld, np.full(len(withheld), 0.5), "x", ms=5.5, mew=1.2, color=MUTED, clip_on=False)


# Rates of fewer accepted answers are not drawn.
FEWEST = 10
# The axis of risk reaches at least so far, percent; for intervals alone it reaches no farther than this rate.
LEAST_TOP, MOST_FOR_INTERVALS = 1.0, 0.2
# Percent: markers of methods, many of which trust every epoch, are set apart so far.
APART = 0.5


def plot_risk_coverage(path: str | os.PathLike[str], by_method: Mapping[str, RiskCoverage]) -> None:
    """Draw the rate of wrong answers among those accepted over the fraction of epochs accepted, of at most 8 methods.

    A method without measures of trust has no line, only markers.
    """
    labels = [f"{name}: {found.n_trusted_wrong:,} of {found.n_trusted:,}" for name, found in by_method.items()]
    words = (
        f"Wrong: not within {SUCCESS_WORDS} of the reference. Filled: what the method itself trusts, with 95 %\n"
        "intervals; open: all answers, if it withholds any. Lines: the most trusted first.\n"
        "Markers are set apart, by up to 2 %. Below: how many of the trusted are wrong."
    )
    titles = ("Wrong answers among those accepted", words)
    top = min(102.0, 1.25 * max(LEAST_TOP, *(_highest(found) for found in by_method.values())))
    with method_chart(path, labels, titles) as (axes, handles):
        for number, (style, found) in enumerate(zip(METHOD_STYLES, by_method.values(), strict=False)):
            handles.append(_draw_risk(axes, style, found, APART * (number - 0.5 * (len(by_method) - 1))))
        axes.set(xlim=(0.0, 100.0 + 4.5 * APART), ylim=(-0.02 * top, top), xticks=np.arange(0, 101, 10))
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_xlabel("share of all epochs whose answer is accepted [%]")
        axes.set_ylabel("wrong among those accepted [%]")
        draw_grid(axes)


def _highest(found: RiskCoverage) -> float:
    """The highest rate to be drawn, percent: of markers and line, and of the interval up to `MOST_FOR_INTERVALS`."""
    line = found.rates[found.n_accepted >= FEWEST]
    trusted = found.n_trusted_wrong / max(found.n_trusted, 1)
    end = min(found.trusted_interval[1], MOST_FOR_INTERVALS) if found.n_trusted else 0.0
    return 100.0 * max(trusted, end, float(np.append(line, found.rates[-1:]).max(initial=0.0)))


def _draw_risk(axes: "Axes", style: MethodStyle, found: RiskCoverage, aside: float) -> "Line2D":
    """Draw the curve of one method and, `aside` by so many percent, rate and interval of the answers it trusts."""
    fractions, rates = 100.0 * found.shares, 100.0 * found.rates
    is_drawn = found.n_accepted >= FEWEST
    if is_drawn.sum() > 2:
        order: dict[str, Any] = {"color": style.color, "ls": style.line, "lw": 1.5, "drawstyle": "steps-post"}
        axes.plot(fractions[is_drawn], rates[is_drawn], zorder=3, clip_on=False, **order)
    marks: dict[str, Any] = {"marker": style.marker, "ms": 9, "ls": "", "clip_on": False}
    if len(fractions) and found.n_accepted[-1] > found.n_trusted:
        axes.plot(fractions[-1], rates[-1], color=style.color, mfc="white", mew=1.5, zorder=4, **marks)
    if found.n_trusted:
        place = 100.0 * found.n_trusted / found.n_epochs + aside
        low, high = (100.0 * end for end in found.trusted_interval)
        axes.vlines(place, low, high, color=style.color, lw=1.8, alpha=0.6, zorder=2)
        rate = 100.0 * found.n_trusted_wrong / found.n_trusted
        axes.plot(place, rate, color=style.color, mec="white", mew=0.8, zorder=5, **marks)
    (handle,) = axes.plot([], [], color=style.color, ls=style.line, lw=1.5, marker=style.marker, ms=7.5, mec="white")
    return handle
