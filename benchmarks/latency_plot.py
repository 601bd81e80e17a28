# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The picture of what benchmarks/latency.py measured.

python benchmarks/latency_plot.py FOLDER [--out docs/images/latency.svg]
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from drives import DOCS
from latency import MAXCON, STAGES
from latency_table import read_series

from maxcon.lab.charts import draw_grid, draw_number_ticks
from maxcon.plotting.figure import INK, MUTED, SERIES, saved_figure

# Inches: the picture is read on phones, so it is narrow and its letters are large.
WIDTH, LEFT, RIGHT, TOP, BOTTOM, ROW, PANEL_TITLE = 6.4, 2.4, 1.4, 1.13, 0.45, 0.26, 0.66
MS_AT, RIGHT_AT = 0.68, 1.33  # inches beyond the axes
BEFORE = 0.4  # rows, between a window's heading and the window before
STAGES_OF = "12 m, 10°"
"""Of this window, the default's, the stages are drawn; of the last one measured if it was not."""


@dataclass(frozen=True)
class Row:
    """What is drawn in a row: percentiles of milliseconds, or, without them, a heading."""

    label: str
    style: int = 0
    percentiles: np.ndarray | None = None
    right: str = ""


def rows_of_panel(series):
    """Rows from above: stages of maximum consensus, then each window's methods."""
    windows = list(dict.fromkeys(each.window for each in series))
    chosen = STAGES_OF if STAGES_OF in windows else windows[-1]
    ours = next(each for each in series if each.method == MAXCON and each.window == chosen)
    rows = [Row(f"{chosen}: stages of maxcon"), *(Row(name, 0, ours.percentiles(name)) for name in STAGES)]
    for window in windows:
        rows.append(Row(f"{window}: end to end"))
        for each in series:
            if each.window == window:
                right = f"{each.count(('is_right', True))}/{len(each.epochs)}"
                style = 1 if each.method.startswith(MAXCON) else 2
                rows.append(Row(each.method.removeprefix("maxcon, "), style, each.percentiles("ms"), right))
    return rows


def _places(rows):
    """How far down each row lies, in rows."""
    is_heading = [row.percentiles is None for row in rows]
    return np.arange(len(rows)) + BEFORE * (np.cumsum(is_heading) - 1)


def plot(path, panels):
    """Draw p50, p95 and p99 of each stage of the default window, and of each method in each window."""
    heights = [ROW * (_places(rows)[-1] + 1.5) + PANEL_TITLE for rows in panels.values()]
    height = TOP + sum(heights) + BOTTOM
    values = np.array([row.percentiles for rows in panels.values() for row in rows if row.percentiles is not None])
    nice = np.outer(10.0 ** np.arange(-3, 2), (1, 2, 5)).ravel()
    limits = nice[nice < 0.95 * values.min()].max(), 1.25 * values.max()
    words = (
        "Processor time. Mark: median of epochs; thick line: to p95, thin: to p99.\n"
        "Right: epochs within 0.3 m and 1° of the reference."
    )
    with saved_figure(path, WIDTH, height, "One epoch in one thread", words) as figure:
        figure.set_layout_engine("none")  # columns of words stand beside the axes
        _draw_key(figure, height)
        top, across = height - TOP, (WIDTH - LEFT - RIGHT) / WIDTH
        for (name, rows), panel_height in zip(panels.items(), heights, strict=True):
            up = (top - panel_height) / height, (panel_height - PANEL_TITLE) / height
            axes = figure.add_axes((LEFT / WIDTH, up[0], across, up[1]))
            _draw_panel(axes, name, rows, limits)
            top -= panel_height
        axes.set_xlabel("ms, logarithmic")


STYLES = ((SERIES[0], "o", "a stage of maxcon"), (INK, "D", "maxcon"), (SERIES[1], "s", "registration"))


def _draw_key(figure, height):
    from matplotlib.lines import Line2D

    marks = [Line2D([], [], ls="", marker=mark, ms=7, color=color, label=words) for color, mark, words in STYLES]
    place = {"loc": "upper left", "bbox_to_anchor": (0.15 / WIDTH, 1.0 - 0.94 / height)}
    figure.legend(handles=marks, ncols=3, handletextpad=0.1, columnspacing=0.9, fontsize=10.5, **place)


def _draw_panel(axes, title, rows, limits):
    places = _places(rows)
    axes.set(xscale="log", xlim=limits, ylim=(places[-1] + 0.5, -0.5), yticks=[])
    names_at = -LEFT / (WIDTH - LEFT - RIGHT) + 0.085
    axes.set_title(title, loc="left", x=names_at, fontweight="bold", fontsize=12.5)
    for words, inches in (("p50 ms", MS_AT), ("right", RIGHT_AT)):
        at = (1.0 + inches / (WIDTH - LEFT - RIGHT), 1.0)
        place = {"xytext": (0, 6), "textcoords": "offset points", "ha": "right", "va": "baseline"}
        axes.annotate(words, at, xycoords="axes fraction", fontsize=11, color=MUTED, **place)
    draw_number_ticks(axes.xaxis, *limits)
    axes.tick_params(labelsize=10.5)
    draw_grid(axes, axis="x")
    axes.spines[["top", "right", "left"]].set_visible(False)
    for y, row in zip(places, rows, strict=True):
        _draw_row(axes, y, row, names_at)


def _draw_row(axes, y, row, names_at):
    place = {"xycoords": ("axes fraction", "data"), "va": "center_baseline", "annotation_clip": False}
    if row.percentiles is None:
        axes.annotate(row.label, (names_at, y), fontsize=11, color=MUTED, ha="left", **place)
        return
    color, mark, _ = STYLES[row.style]
    p50, p95, p99 = row.percentiles
    axes.plot([p50, p99], [y, y], color=color, lw=1.2)
    axes.plot([p50, p95], [y, y], color=color, lw=4.0, solid_capstyle="butt", alpha=0.55)
    axes.plot([p99, p99], [y - 0.16, y + 0.16], color=color, lw=1.2)
    axes.plot(p50, y, mark, color=color, ms=7.5, mec="white", mew=0.8)
    weight = "bold" if row.style else "normal"
    place |= {"fontsize": 11, "color": INK, "ha": "right"}
    axes.annotate(row.label, (-0.03, y), fontweight="bold" if row.label == MAXCON else "normal", **place)
    for words, inches in ((f"{p50:.1f}", MS_AT), (row.right, RIGHT_AT)):
        axes.annotate(words, (1.0 + inches / (WIDTH - LEFT - RIGHT), y), fontweight=weight, **place)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=DOCS / "images" / "latency.svg")
    arguments = parser.parse_args()
    found = read_series(arguments.folder)
    plot(arguments.out, {drive: rows_of_panel(series) for drive, series in found.items()})


if __name__ == "__main__":
    main()
