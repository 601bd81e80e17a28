# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The picture of benchmarks/latency.py."""

import numpy as np

from maxcon.report.figure import INK, MUTED, SERIES, draw_titles, saved_figure
from maxcon.report.method_style import draw_number_ticks

WIDTH, LEFT, RIGHT, TOP, BOTTOM, ROW, PANEL_TITLE = 6.4, 2.45, 0.75, 1.15, 0.65, 0.29, 0.42
GAP = 0.35  # rows, between stages, searches and registrations


def plot(path, panels):
    """Draw p50, p95 and p99 of each stage of the first search, and of each method end to end."""
    heights = [ROW * (len(rows) + 2 * GAP) + PANEL_TITLE for rows in panels.values()]
    height = TOP + sum(heights) + BOTTOM
    values = np.array([numbers for rows in panels.values() for _, numbers, _ in rows])
    nice = np.outer(10.0 ** np.arange(-3, 2), (1, 2, 5)).ravel()
    limits = nice[nice < 0.95 * values.min()].max(), 1.25 * values.max()
    with saved_figure(path, WIDTH, height) as figure:
        draw_titles(
            figure,
            "One epoch on one core",
            "Processor time. Mark: median of epochs; thick line: to p95, thin: to p99.",
        )
        _draw_key(figure, height)
        top = height - TOP
        for (name, rows), panel_height in zip(panels.items(), heights, strict=True):
            box = (LEFT, top - panel_height, WIDTH - LEFT - RIGHT, panel_height - PANEL_TITLE)
            axes = figure.add_axes((box[0] / WIDTH, box[1] / height, box[2] / WIDTH, box[3] / height))
            _draw_panel(axes, name, rows, limits)
            top -= panel_height
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("ms, logarithmic")


STYLES = (
    (SERIES[0], "o", "a stage"),
    (INK, "D", "the search, end to end"),
    (SERIES[1], "s", "registration, end to end"),
)


def _draw_key(figure, height):
    from matplotlib.lines import Line2D

    marks = [
        Line2D([], [], ls="", marker=mark, ms=7, color=color, label=words) for color, mark, words in STYLES
    ]
    place = {"loc": "upper left", "bbox_to_anchor": (0.15 / WIDTH, 1.0 - 0.72 / height)}
    figure.legend(handles=marks, ncols=3, handletextpad=0.1, columnspacing=0.9, fontsize=10.5, **place)


def _draw_panel(axes, title, rows, limits):
    places = [number + GAP * style for number, (_, _, style) in enumerate(rows)]
    axes.set(xscale="log", xlim=limits, ylim=(places[-1] + 0.5, -0.5), yticks=places)
    axes.set_yticklabels([label for label, _, _ in rows], fontsize=11, color=INK)
    axes.set_title(
        title, loc="left", x=-LEFT / (WIDTH - LEFT - RIGHT) + 0.085, fontweight="bold", fontsize=12.5
    )
    axes.set_title("p50 ms", loc="right", x=1.0 + 0.68 / (WIDTH - LEFT - RIGHT), fontsize=11, color=MUTED)
    draw_number_ticks(axes.xaxis, *limits)
    axes.tick_params(labelbottom=False, labelsize=10.5)
    axes.tick_params(axis="y", length=0, labelcolor=INK)
    axes.grid(axis="x", color="#dfe2e8", lw=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    for y, (_, (p50, p95, p99), style) in zip(places, rows, strict=True):
        color, mark, _ = STYLES[style]
        axes.plot([p50, p99], [y, y], color=color, lw=1.2)
        axes.plot([p50, p95], [y, y], color=color, lw=4.0, solid_capstyle="butt", alpha=0.55)
        axes.plot([p99, p99], [y - 0.16, y + 0.16], color=color, lw=1.2)
        axes.plot(p50, y, mark, color=color, ms=7.5, mec="white", mew=0.8)
        place = {"xycoords": ("axes fraction", "data"), "ha": "right", "va": "center_baseline"}
        weight = "bold" if style else "normal"
        x = 1.0 + 0.68 / (WIDTH - LEFT - RIGHT)
        axes.annotate(
            f"{p50:.1f}", (x, y), fontsize=11, color=INK, fontweight=weight, annotation_clip=False, **place
        )
