"""How often each method is right, how often wrong without knowing it, and how long it takes, by its prior's error."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from maxcon.lab.evaluation import SUCCESS_WORDS, clopper_pearson
from maxcon.lab.report.charts import METHOD_STYLES, draw_grid, draw_legend, draw_number_ticks
from maxcon.lab.study.table import MethodRows, MethodStatistics, statistics
from maxcon.plotting.figure import INK, MUTED, SERIES, saved_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Levels = Mapping[str, Sequence[MethodStatistics]]
"""Methods at each level of the prior's error, by its name ("12 m, 10°"), rising."""
LABELS = ("right [%]", "wrong, but\ncalled good [%]", "one epoch,\nmedian [ms]")
LEAST_MS = 0.1  # shorter times, ms, are drawn at this one: the axis is logarithmic
MOST_BINS = 8
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


def plot_prior_error(path: str | os.PathLike[str], levels_by_drive: Mapping[str, Levels]) -> None:
    """Draw how many epochs are right, how many wrong but called good, and the time of one, over the prior's error.

    levels_by_drive: one column per drive by its title; of the same methods, at most 8, the first emphasized.
    """
    from matplotlib.lines import Line2D

    everything = [one for levels in levels_by_drive.values() for one in chain(*levels.values())]
    names = list(dict.fromkeys(one.method for one in everything))
    looks = {names[0]: FIRST} | {
        name: LOOKS.get(name, _look(style.color, 1.5, style.line, style.marker, 6.0))
        for name, style in zip(names[1:], METHOD_STYLES[1:], strict=False)
    }
    words = (
        f"Right: within {SUCCESS_WORDS} of the reference; upright lines: 95 % intervals.\n"
        "Called good: by the method itself. ms: below at the widest prior."
    )
    n_drives = len(levels_by_drive)
    width, height = max(7.4, 1.3 + 2.9 * n_drives), 7.6
    with saved_figure(path, width, height, "How wrong may the prior be?", words) as figure:
        panels = figure.subplots(3, n_drives, sharey="row", squeeze=False, height_ratios=(2.1, 1.05, 1.5))
        for column, (drive, levels) in zip(panels.T, levels_by_drive.items(), strict=True):
            column[0].set_title(drive, loc="left", fontweight="bold", parse_math=False)
            _draw_levels(column, levels, looks)
        _set_limits(list(panels[:, 0]), everything)
        for axes, label in zip(panels[:, 0], LABELS, strict=True):
            axes.set_ylabel(label)
        figure.align_ylabels(panels[:, 0])
        marks = [Line2D([], [], **look) for look in looks.values()]
        # With times to two digits, as more would not be repeatable.
        of_drives = [list(chain(*levels.values())) for levels in levels_by_drive.values()]
        ms = [  # at the widest level that a method has, of each drive
            np.median([[one for one in levels if one.method == name][-1].ms.median for levels in of_drives])
            for name in looks
        ]
        labels = [
            name if math.isnan(took) else f"{name}: {float(f'{took:.2g}'):,.0f} ms"
            for name, took in zip(looks, ms, strict=True)
        ]
        legend = draw_legend(figure, marks, labels, labelcolor=MUTED)
        legend.get_texts()[0].set(color=INK, fontweight="bold")


def _values(one: MethodStatistics) -> tuple[float, float, float]:
    """What is drawn of a method at a level: right, %; wrong but called good, %; ms."""
    ms = np.fmax(one.ms.median, LEAST_MS)  # NaN without any answer
    return 100.0 * one.n_success / one.n_epochs, 100.0 * one.n_false / one.n_epochs, float(ms)


def _set_limits(panels: Sequence["Axes"], found: Sequence[MethodStatistics]) -> None:
    """Set the limits of the y axes: right, %; wrong, %, up to a multiple of 20; time, ms."""
    _, wrong, ms = zip(*map(_values, found), strict=True)
    panels[0].set_ylim(0.0, 103.0)
    panels[1].set_ylim(0.0, 1.0 + max(20.0, 20.0 * math.ceil(max(wrong) / 20.0 - 1e-9)))
    panels[2].set(yscale="log", ylim=(0.7 * min(ms), 1.4 * max(ms)))
    draw_number_ticks(panels[2].yaxis, *panels[2].get_ylim())
    panels[2].minorticks_off()


def _draw_levels(panels: Sequence["Axes"], levels: Levels, looks: Mapping[str, dict[str, Any]]) -> None:
    """Draw one column of panels; the levels of the prior's error stand at equal distances, whatever their values."""
    for rank, (name, look) in enumerate(reversed(list(looks.items()))):
        # Wide lines lie below thin ones, the first method above all.
        above = 9.0 if look is FIRST else 2.0 + 0.1 * rank + (2.0 if look["lw"] < 2.0 else 0.0)
        mine = [(place, one) for place, found in enumerate(levels.values()) for one in found if one.method == name]
        places, *values = np.array([(place, *_values(one)) for place, one in mine]).reshape(-1, 4).T
        for axes, drawn in zip(panels, values, strict=True):
            axes.plot(places, drawn, zorder=above, **look)
        ends = np.array([clopper_pearson(one.n_success, one.n_epochs) for _, one in mine]).reshape(-1, 2).T
        panels[0].vlines(places, *(100.0 * ends), color=look["color"], lw=1.2, alpha=0.5, zorder=1.5)
    for axes in panels:
        axes.set(xlim=(-0.3, len(levels) - 0.7), xticks=range(len(levels)))
        draw_grid(axes, color="#e3e6eb")
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelbottom=axes is panels[2])
    panels[2].set_xticklabels([name.replace(", ", "\n") for name in levels])
    panels[2].set_xlabel("prior wrong by up to", labelpad=2.0)


def levels_of_distance(rows_by_name: Mapping[str, MethodRows]) -> dict[str, list[MethodStatistics]]:
    """Return methods, by names of their own, in at most 8 bins of the prior's distance from the reference.

    Empty if no epoch that was tried has one. A level is named after its bin's upper edge and how many epochs it holds.
    """
    known = {}
    for name, rows in rows_by_name.items():
        distance = rows.numbers("prior_distance")
        is_known = np.isfinite(distance) & rows.is_tried
        known[name] = np.where(is_known, distance, np.nan)
    farthest = max((float(np.nanmax(values, initial=-1.0)) for values in known.values()), default=-1.0)
    if farthest < 0.0:
        return {}
    width = round_width(farthest)
    levels = {}
    for number in range(int(farthest / width) + 1):
        bins = {name: np.floor(values / width) == number for name, values in known.items()}
        found = [
            replace(statistics(rows.where(bins[name])), method=name)
            for name, rows in rows_by_name.items()
            if bins[name].any()
        ]
        n_epochs = sorted({one.n_epochs for one in found})
        if found:
            words = "–".join(f"{n:,}" for n in dict.fromkeys((n_epochs[0], n_epochs[-1])))
            levels[f"{(number + 1) * width:g} m, {words} epoch{'s' * (n_epochs[-1] > 1)}"] = found
    return levels


def round_width(farthest: float) -> float:
    """Return the smallest of 0.5, 1, 2, 5, 10, ... m that makes at most 8 bins up to the farthest offset."""
    widths = [digit * 10.0**power for power in range(-1, 9) for digit in (1.0, 2.0, 5.0)]
    return next(width for width in widths[2:] if int(farthest / width) < MOST_BINS)
