# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""How often each method is right, how often wrong without knowing it, and how long it takes, by its prior's error."""

import math
import os
from collections.abc import Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from maxcon.lab.charts import METHOD_STYLES, draw_grid, draw_legend, draw_number_ticks
from maxcon.lab.evaluation import SUCCESS_WORDS
from maxcon.plotting.figure import INK, MUTED, SERIES, saved_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from maxcon.lab.study.table import MethodStatistics

Levels = Mapping[str, Sequence["MethodStatistics"]]
"""Methods at each level of the prior's error, by its name ("12 m, 10°"), rising."""
LABELS = ("right [%]", "wrong, but\ncalled good [%]", "one epoch,\nmedian [ms]")
LEAST_MS = 0.1  # shorter times, ms, are drawn at this one: the axis is logarithmic


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

    levels_by_drive: one column per drive by its name; of the same methods, at most 8, the first emphasized.
    """
    from matplotlib.lines import Line2D

    everything = [one for levels in levels_by_drive.values() for one in chain(*levels.values())]
    names = list(dict.fromkeys(one.method for one in everything))
    looks = {names[0]: FIRST} | {
        name: LOOKS.get(name, _look(style.color, 1.5, style.line, style.marker, 6.0))
        for name, style in zip(names[1:], METHOD_STYLES[1:], strict=False)
    }
    words = (
        f"Right: within {SUCCESS_WORDS} of the reference. Called good: by the method itself.\n"
        "Epochs and priors are the same for all. ms: in one thread; below at the widest prior."
    )
    n_drives = len(levels_by_drive)
    width, height = max(7.4, 1.3 + 2.9 * n_drives), 7.6
    with saved_figure(path, width, height, "How wrong may the prior be?", words) as figure:
        panels = figure.subplots(3, n_drives, sharey="row", squeeze=False, height_ratios=(2.1, 1.05, 1.5))
        for column, (drive, levels) in zip(panels.T, levels_by_drive.items(), strict=True):
            _draw_drive(column, drive, levels, looks)
        _set_limits(list(panels[:, 0]), everything)
        for axes, label in zip(panels[:, 0], LABELS, strict=True):
            axes.set_ylabel(label)
        figure.align_ylabels(panels[:, 0])
        marks = [Line2D([], [], **look) for look in looks.values()]
        # With times to two digits, as more would not be repeatable.
        ms = [_median_ms(name, levels_by_drive) for name in looks]
        labels = [f"{name}: {float(f'{took:.2g}'):,.0f} ms" for name, took in zip(looks, ms, strict=True)]
        legend = draw_legend(figure, marks, labels, labelcolor=MUTED)
        legend.get_texts()[0].set(color=INK, fontweight="bold")


def _values(one: "MethodStatistics") -> tuple[float, float, float]:
    """What is drawn of a method at a level: right, %; wrong but called good, %; ms."""
    return (
        100.0 * one.n_success / one.n_epochs, 100.0 * one.n_false / one.n_epochs, max(one.ms.median, LEAST_MS),
    )  # fmt: skip


def _set_limits(panels: Sequence["Axes"], found: Sequence["MethodStatistics"]) -> None:
    """Set the limits of the y axes: right, %; wrong, %, up to a multiple of 20; time, ms."""
    _, wrong, ms = zip(*map(_values, found), strict=True)
    panels[0].set_ylim(0.0, 103.0)
    panels[1].set_ylim(0.0, 1.0 + max(20.0, 20.0 * math.ceil(max(wrong) / 20.0 - 1e-9)))
    panels[2].set(yscale="log", ylim=(0.7 * min(ms), 1.4 * max(ms)))
    draw_number_ticks(panels[2].yaxis, *panels[2].get_ylim())
    panels[2].minorticks_off()


def _median_ms(name: str, levels_by_drive: Mapping[str, Levels]) -> float:
    """Median over the drives of a method's median time at the widest level that it has, ms."""
    of_drives = [[one for one in chain(*levels.values()) if one.method == name] for levels in levels_by_drive.values()]
    return float(np.median([mine[-1].ms.median for mine in of_drives]))


def _draw_drive(panels: Sequence["Axes"], drive: str, levels: Levels, looks: Mapping[str, dict[str, Any]]) -> None:
    """Draw one column of panels; the levels of the prior's error stand at equal distances, whatever their values."""
    n_epochs = max(one.n_epochs for one in chain(*levels.values()))
    panels[0].set_title(f"{drive}, {n_epochs} epochs", loc="left", fontweight="bold", parse_math=False)
    for rank, (name, look) in enumerate(reversed(list(looks.items()))):
        rows = [
            (place, *_values(one)) for place, found in enumerate(levels.values()) for one in found if one.method == name
        ]
        # Wide lines lie below thin ones, the first method above all.
        above = 9.0 if look is FIRST else 2.0 + 0.1 * rank + (2.0 if look["lw"] < 2.0 else 0.0)
        places, *values = np.array(rows).reshape(-1, 4).T
        for axes, drawn in zip(panels, values, strict=True):
            axes.plot(places, drawn, zorder=above, **look)
    for axes in panels:
        axes.set(xlim=(-0.3, len(levels) - 0.7), xticks=range(len(levels)))
        draw_grid(axes, color="#e3e6eb")
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelbottom=axes is panels[2])
    panels[2].set_xticklabels([name.replace(", ", "\n") for name in levels])
    panels[2].set_xlabel("prior wrong by up to", labelpad=2.0)
