# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Risk-coverage curves: the rate of wrong answers among those accepted, over the share of accepted ones."""

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from maxcon.errors import ArrayError
from maxcon.lab.evaluation import SUCCESS_WORDS, RiskCoverage
from maxcon.plotting.canvas.figure import draw_titles, saved_figure
from maxcon.plotting.canvas.method_style import METHOD_STYLES, LegendShape, MethodStyle, check_methods, draw_legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["plot_risk_coverage"]

WIDTH, AXES_HEIGHT = 9.2, 4.1
# Inches: what is kept free around the axes.
LEFT, RIGHT, BELOW, TITLES = 0.82, 0.3, 0.62, 1.4
# Rates of fewer accepted answers are not drawn.
FEWEST = 10
# The axis reaches at least so far, percent; for intervals alone it reaches no farther than this rate.
LEAST_TOP, MOST_FOR_INTERVALS = 1.0, 0.2
# Percent: bars that lie on each other are set apart so far.
APART = 0.8
# Half the height of a marker over that of the axes.
MARKER = 0.015


def plot_risk_coverage(
    path: str | os.PathLike[str],
    by_method: Mapping[str, RiskCoverage],
    *,
    criterion: str = f"not within {SUCCESS_WORDS} of the reference",
    title: str = "Wrong answers among those accepted",
) -> None:
    """Draw the rate of wrong answers among those accepted against the share of epochs that are accepted.

    Filled markers: the answers that the method itself says may be used, with an interval of 95 %. Open markers: all
    answers, if it withholds any. Lines: the most trusted answers first; a method without measures of trust has none.

    path: a .png or .svg to write.
    by_method: by the method's name, at most 8.
    criterion: what counts as wrong; stated in the picture.
    title: what is written above.
    """
    check_methods(by_method)
    for name, found in by_method.items():
        if found.n_epochs == 0:
            raise ArrayError(f"Expected epochs of {name!r}, got none. Leave the method out.")
    labels = [_label(name, found) for name, found in by_method.items()]
    legend = LegendShape.of(labels, WIDTH)
    bottom = BELOW + legend.height
    height = bottom + AXES_HEIGHT + TITLES
    with saved_figure(path, WIDTH, height) as figure:
        draw_titles(
            figure,
            title,
            f"Wrong: {criterion}. Filled: what the method itself trusts, with 95 %\n"
            "intervals; open: all answers, if it withholds any. Lines: the most trusted first.\n"
            "Bars that would lie on each other are set apart. Below: how many of the trusted are wrong.",
        )
        axes = figure.add_axes((LEFT / WIDTH, bottom / height, (WIDTH - LEFT - RIGHT) / WIDTH, AXES_HEIGHT / height))
        top = min(102.0, 1.25 * max(LEAST_TOP, *(_highest(found) for found in by_method.values())))
        places = _set_apart(list(by_method.values()), top)
        handles = [
            _draw_method(axes, METHOD_STYLES[number], found, places[number])
            for number, found in enumerate(by_method.values())
        ]
        _finish(axes, top)
        draw_legend(figure, handles, labels, legend)


def _label(name: str, found: RiskCoverage) -> str:
    """Return the legend of a method: how many of the answers that it trusts are wrong."""
    return f"{name}: {found.n_trusted_wrong:,} of {found.n_trusted:,}"


def _highest(found: RiskCoverage) -> float:
    """The highest rate to be drawn, percent: of markers and line, and of the interval up to `MOST_FOR_INTERVALS`."""
    line = found.rates[found.n_accepted >= FEWEST]
    trusted = found.n_trusted_wrong / max(found.n_trusted, 1)
    end = min(found.trusted_interval[1], MOST_FOR_INTERVALS) if found.n_trusted else 0.0
    return 100.0 * max(trusted, end, float(np.append(line, found.rates[-1:]).max(initial=0.0)))


def _set_apart(by_method: Sequence[RiskCoverage], top: float) -> list[float]:
    """Places of the bars, percent: the share of epochs each method trusts, moved aside where it would cover another.

    NaN where a method trusts nothing. top : upper end of the y axis, percent.
    """
    places: list[float] = []
    bars: list[tuple[float, float, float]] = []
    for found in by_method:
        if not found.n_trusted:
            places.append(math.nan)
            continue
        share = 100.0 * found.n_trusted / found.n_epochs
        low, high = (100.0 * end for end in found.trusted_interval)
        reach = low - MARKER * top, high + MARKER * top
        near = [x for x, below, above in bars if reach[0] < above and below < reach[1]]
        places_near = (share + APART * step for step in sorted(range(-len(near), len(near) + 1), key=abs))
        # A bar is less than 0.99 steps from at most two of these places, so one of them is free.
        share = next(place for place in places_near if all(abs(place - x) > 0.99 * APART for x in near))
        bars.append((share, low, high))
        places.append(share)
    return places


def _draw_method(axes: "Axes", style: MethodStyle, found: RiskCoverage, place: float) -> Any:
    """Draw the curve of one method, and at `place`, percent, the rate and interval of the answers that it trusts."""
    shares, rates = 100.0 * found.shares, 100.0 * found.rates
    is_drawn = found.n_accepted >= FEWEST
    if is_drawn.sum() > 2:
        order: dict[str, Any] = {"color": style.color, "ls": style.line, "lw": 1.5, "drawstyle": "steps-post"}
        axes.plot(shares[is_drawn], rates[is_drawn], zorder=3, clip_on=False, **order)
    marks: dict[str, Any] = {"marker": style.marker, "ms": 9, "ls": "", "clip_on": False}
    if len(shares) and found.n_accepted[-1] > found.n_trusted:
        axes.plot(shares[-1], rates[-1], color=style.color, mfc="white", mew=1.5, zorder=4, **marks)
    if found.n_trusted:
        low, high = (100.0 * end for end in found.trusted_interval)
        axes.vlines(place, low, high, color=style.color, lw=1.8, alpha=0.6, zorder=2)
        rate = 100.0 * found.n_trusted_wrong / found.n_trusted
        axes.plot(place, rate, color=style.color, mec="white", mew=0.8, zorder=5, **marks)
    (handle,) = axes.plot([], [], color=style.color, ls=style.line, lw=1.5, marker=style.marker, ms=7.5, mec="white")
    return handle


def _finish(axes: "Axes", top: float) -> None:
    """Scale and label the axes."""
    axes.set_xlim(0.0, 100.0 + 4.5 * APART)
    axes.set_ylim(-0.02 * top, top)
    axes.set_xticks(np.arange(0, 101, 10))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_xlabel("share of all epochs whose answer is accepted [%]")
    axes.set_ylabel("wrong among those accepted [%]")
    axes.grid(color="#dfe2e8", lw=0.7)
    axes.set_axisbelow(True)
