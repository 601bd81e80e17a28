# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How often each method is right, how often wrong without knowing it, and how long it takes, by its prior's error."""

import math
import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from maxcon.lab.charts import METHOD_STYLES, draw_grid, draw_number_ticks
from maxcon.lab.evaluation import SUCCESS_WORDS
from maxcon.plotting.figure import INK, MUTED, SERIES, add_axes, saved_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from maxcon.lab.study.prior_trials import TrialSummary

# Inches: the panels of a drive (right, wrong, ms), and what stands around them.
NARROWEST, PANEL, GAP, LEFT, RIGHT, TITLES = 7.4, 2.72, 0.22, 1.05, 0.2, 1.2
HEIGHTS, BETWEEN, BELOW, LEGEND_ROW = (2.1, 1.05, 1.5), 0.22, 0.84, 0.235
LABELS = ("right [%]", "wrong, but\ncalled good [%]", "one epoch,\nmedian [ms]")
LEAST_MS = 0.1
"""Shorter times, ms, are drawn at this one: the axis is logarithmic."""


DOTTED, SOLID, DASHED = (0.0, (1.2, 1.2)), (0.0, None), (0.0, (6.0, 2.0))


def _look(color: str, width: float, dashes: Any, marker: str, size: float) -> dict[str, Any]:
    """Look of a line, as matplotlib's keywords."""
    return {
        "color": color, "lw": width, "ls": dashes, "marker": marker, "ms": size, "mec": "white", "mew": 0.8,
        "solid_capstyle": "round", "clip_on": False,
    }  # fmt: skip


FIRST = _look(SERIES[0], 2.6, SOLID, "o", 7.5)
LOOKS = {
    "count 1 m, then GICP": _look(SERIES[2], 5.5, SOLID, "D", 9.5),
    "GICP from 75 starts": _look("#9fd4c3", 9.0, SOLID, "", 0.0),
    "GICP, gate 1 m": _look(SERIES[1], 1.5, DOTTED, "^", 5.5),
    "GICP, gate 3 m": _look(SERIES[1], 1.5, SOLID, "^", 6.5),
    "GICP, gate 6 m": _look(SERIES[1], 1.5, DASHED, "^", 5.5),
    "ICP, gate 1 m": _look(SERIES[3], 1.5, DOTTED, "v", 5.5),
    "ICP, gate 3 m": _look(SERIES[3], 1.5, SOLID, "v", 6.5),
}
"""Methods that search a window have wide lines, each wider than the next, as all lie at 100 %; others thin ones."""


def plot_prior_error(path: str | os.PathLike[str], summaries_by_drive: Mapping[str, Sequence["TrialSummary"]]) -> None:
    """Draw how many epochs are right, how many wrong but called good, and the time of one, over the prior's error.

    path: a .png or .svg to write.
    summaries_by_drive: one column per drive by its name; of the same methods, at most 8, the first emphasized.
    """
    everything = [one for found in summaries_by_drive.values() for one in found]
    names = list(dict.fromkeys(one.method for one in everything))
    others = {
        name: LOOKS.get(name, _look(style.color, 1.5, style.line, style.marker, 6.0))
        for name, style in zip(names[1:], METHOD_STYLES[1:], strict=False)
    }
    looks = {names[0]: FIRST, **others}
    n_gaps = len(summaries_by_drive) - 1
    width = max(NARROWEST, LEFT + (n_gaps + 1) * PANEL + n_gaps * GAP + RIGHT)
    panel = (width - LEFT - RIGHT - n_gaps * GAP) / (n_gaps + 1)
    n_columns = max(2, int(width / 2.9))
    height = BELOW + LEGEND_ROW * -(-len(names) // n_columns) + sum(HEIGHTS) + 2.0 * BETWEEN + TITLES
    words = (
        f"Right: within {SUCCESS_WORDS} of the reference. Called good: by the method itself.\n"
        "Epochs and priors are the same for all. ms: in one thread; below at the widest prior."
    )
    with saved_figure(path, width, height, "How wrong may the prior be?", words) as figure:
        limits = _limits(everything)
        for number, (drive, found) in enumerate(summaries_by_drive.items()):
            panels, top = [], height - TITLES
            for row in HEIGHTS:
                panels.append(add_axes(figure, LEFT + number * (panel + GAP), top - row, panel, row))
                top -= row + BETWEEN
            _draw_drive(panels, drive, found, looks, limits)
            for axes, label in zip(panels, LABELS, strict=True):
                if number:
                    axes.tick_params(labelleft=False)
                else:
                    axes.set_ylabel(label)
                    axes.yaxis.set_label_coords(-0.5 / panel, 0.5)
        ms = {name: _median_ms(name, summaries_by_drive) for name in looks}
        _draw_legend(figure, looks, ms, n_columns)


def _values(one: "TrialSummary") -> tuple[float, float, float]:
    """What is drawn of a method at a level: right, %; wrong but called good, %; ms."""
    right, wrong = one.n_right / one.n_epochs, one.n_wrong_but_good / one.n_epochs
    return 100.0 * right, 100.0 * wrong, max(one.median_ms, LEAST_MS)


def _limits(found: Sequence["TrialSummary"]) -> list[tuple[float, float]]:
    """Limits of the y axes: right, %; wrong, %, up to a multiple of 20; time, ms."""
    _, wrong, ms = zip(*map(_values, found), strict=True)
    highest = max(20.0, 20.0 * math.ceil(max(wrong) / 20.0 - 1e-9))
    return [(0.0, 103.0), (0.0, highest + 1.0), (0.7 * min(ms), 1.4 * max(ms))]


def _median_ms(name: str, summaries_by_drive: Mapping[str, Sequence["TrialSummary"]]) -> float:
    """Median over the drives of a method's median time at the widest level, ms."""
    of_drives = ([one for one in found if one.method == name] for found in summaries_by_drive.values())
    return float(np.median([max(mine, key=lambda one: one.offset).median_ms for mine in of_drives]))


def _draw_drive(
    panels: Sequence["Axes"],
    drive: str,
    found: Sequence["TrialSummary"],
    looks: Mapping[str, dict[str, Any]],
    limits: Sequence[tuple[float, float]],
) -> None:
    """Draw one column of panels; the levels of the prior's error stand at equal distances, whatever their values."""
    n_epochs = max(one.n_epochs for one in found)
    panels[0].set_title(f"{drive}, {n_epochs} epochs", loc="left", fontweight="bold", parse_math=False)
    panels[2].set_yscale("log")
    levels = sorted({(one.offset, one.heading_deg) for one in found})
    for rank, (name, look) in enumerate(reversed(list(looks.items()))):
        rows = sorted((one for one in found if one.method == name), key=lambda one: one.offset)
        places = [levels.index((one.offset, one.heading_deg)) for one in rows]
        # Wide lines lie below thin ones, the first method above all.
        above = 9.0 if look is FIRST else 2.0 + 0.1 * rank + (2.0 if look["lw"] < 2.0 else 0.0)
        for axes, values in zip(panels, np.array([_values(one) for one in rows]).reshape(-1, 3).T, strict=True):
            axes.plot(places, values, zorder=above, **look)
    for axes, (low, high) in zip(panels, limits, strict=True):
        axes.set_xlim(-0.3, len(levels) - 0.7)
        axes.set_ylim(low, high)
        axes.set_xticks(range(len(levels)))
        draw_grid(axes, color="#e3e6eb")
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelbottom=False)
    draw_number_ticks(panels[2].yaxis, *limits[2])
    panels[2].minorticks_off()
    panels[2].tick_params(labelbottom=True)
    panels[2].set_xticklabels([f"{offset:g} m\n{heading:g}°" for offset, heading in levels])
    panels[2].set_xlabel("prior wrong by up to", labelpad=2.0)


def _draw_legend(
    figure: "Figure", looks: Mapping[str, dict[str, Any]], ms: Mapping[str, float], n_columns: int
) -> None:
    """Name the methods below, with their times to two digits, as more would not be repeatable; the first in bold."""
    from matplotlib.lines import Line2D

    legend = figure.legend(
        [Line2D([], [], **look) for look in looks.values()],
        [f"{name}: {float(f'{ms[name]:.2g}'):,.0f} ms" for name in looks],
        loc="lower left", bbox_to_anchor=(0.2 / figure.get_size_inches()[0], 0.0), ncols=n_columns, handlelength=2.6,
        columnspacing=1.6, labelspacing=0.45,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)
        text.set_color(MUTED)
    legend.get_texts()[0].set(color=INK, fontweight="bold")
