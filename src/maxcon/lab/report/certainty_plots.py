"""What a method says of its answers beside their errors: a drive epoch by epoch, and the Stanford diagram."""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.estimate import Status
from maxcon.lab.evaluation import ALERT_LIMIT, SUCCESS_WORDS, ProtectionCounts
from maxcon.lab.report.charts import DASHES, Floats, draw_grid, draw_number_ticks
from maxcon.plotting.figure import INK, MUTED, SERIES, saved_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# More epochs are drawn as pixels, as their strokes would take megabytes; their dots are smaller and paler.
MANY_EPOCHS = 300

BAND, TRUSTED, WITHHELD, WRONG = "#bcd9ee", SERIES[0], "#9aa1ad", "#c00000"
STATUS_COLORS = {
    Status.LOCALIZED.value: SERIES[0], Status.AMBIGUOUS.value: SERIES[4], Status.WALLS_MISSING.value: SERIES[3],
    Status.NOT_CONFIRMED.value: SERIES[5], Status.AT_RIM.value: SERIES[2], Status.UNDETERMINED.value: SERIES[1],
    Status.NOT_CONVERGED.value: SERIES[1],
}  # fmt: skip
"""Colours of the statuses that an answer can have; others are drawn in `MUTED`."""
# The axis ends at so many times what 98 % of the epochs stay below; errors beyond are marked at its end.
ROOM = 1.25
# Strokes of protection levels are at least as long as the width of the row over this.
MOST_STROKES = 400
# Inches: the width of the figure and of its rows, and the heights of rows.
WIDTH, ROW_WIDTH, STATUS_ROW, ERROR_ROW = 11.5, 9.5, 0.24, 1.35


class ErrorRow(NamedTuple):
    """One kind of error over a drive, shape (n,), with what was said of it; NaN where there is none."""

    name: str  # "along"
    unit: str  # of the numbers, and as drawn
    errors: Floats  # signed
    sigmas: Floats  # predicted standard deviations
    levels: Floats  # protection levels

    @property
    def limit(self) -> float:
        """The row is drawn from -limit to limit, a range that is not dominated by gross errors."""
        drawn = (np.abs(self.errors), 2.0 * self.sigmas, self.levels)
        known = [values[~np.isnan(values)] for values in drawn]
        errors, *predicted = (float(np.quantile(values, 0.98)) if len(values) else 0.0 for values in known)
        limit = max(errors, *predicted) or 1.0
        if errors and max(predicted):  # a few gross errors must not flatten all others
            limit = min(limit, 4.0 * max(predicted))
        return ROOM * max(limit, 1e-3)


def _has(rows: Sequence[ErrorRow], name: str) -> bool:
    """Whether any of the errors, sigmas or levels is known."""
    return any(bool(np.isfinite(getattr(row, name)).any()) for row in rows)


def plot_timeline(
    path: str | os.PathLike[str], epochs: Floats, statuses: Sequence[str], is_wrong: NDArray[np.bool_],
    rows: Sequence[ErrorRow], *, title: str,
) -> None:  # fmt: skip
    """Draw a drive: a row for each status that occurs, and one for each kind of error, whether errors are known or not.

    epochs, statuses, is_wrong: shape (n,), n > 0; numbers of the scans, rising; as the method says; whether the answer
        is known to be beyond the limits of success.
    """
    said = np.array(statuses)
    trusted = said == Status.LOCALIZED.value
    words = sorted(Counter(statuses), key=lambda word: (word != Status.LOCALIZED.value, -statuses.count(word)))
    lines = [(word, said == word, STATUS_COLORS.get(word, MUTED)) for word in words]
    if _has(rows, "errors"):
        lines.append(("trusted and wrong", trusted & is_wrong, WRONG))
    subtitle = _words(rows, len(epochs), int((trusted & is_wrong).sum()))
    # Width of the stroke of an epoch, points: without gaps between neighbours, and never too thin to be seen.
    step = float(np.median(np.diff(epochs))) if len(epochs) > 1 else 1.0
    extent = max(float(np.ptp(epochs)), 1.0)
    stroke = float(np.clip(0.9 * 72.0 * ROW_WIDTH * step / extent, 0.9, 8.0))
    heights = [len(lines) * STATUS_ROW, *([ERROR_ROW] * len(rows))]
    with saved_figure(path, WIDTH, 2.2 + sum(heights), title, subtitle) as figure:
        first, *others = panels = figure.subplots(len(heights), sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        for axes in panels:
            draw_grid(axes)
        _draw_statuses(first, epochs, lines, stroke)
        for axes, row in zip(others, rows, strict=True):
            _draw_errors(axes, row, epochs, trusted, stroke, 0.5 * max(step, extent / MOST_STROKES))
            axes.set_ylabel(f"{row.name}\n[{row.unit}]", labelpad=8)
        figure.align_ylabels(others)
        panels[-1].set_xlabel("epoch (number of the scan)")
        margin = max(0.6, 0.012 * extent)
        first.set_xlim(epochs[0] - margin, epochs[-1] + margin)
        _draw_legend(figure, rows)


def _words(rows: Sequence[ErrorRow], n_epochs: int, n_wrong: int) -> str:
    """Return the subtitle: how many trusted answers are wrong, and what to look for."""
    if not _has(rows, "errors"):
        return f"{n_epochs:,} epochs, without a reference: what the method predicts."
    wrong = "No trusted answer is wrong" if n_wrong == 0 else f"Trusted and wrong: {n_wrong:,}"
    look = "The method predicts no errors: there are no bands."
    if _has(rows, "sigmas"):
        look = "About 95 % of the dots should lie within the band, and hardly any beyond the lines."
    return f"{n_epochs:,} epochs. {wrong} ({SUCCESS_WORDS}).\n{look}"


def _draw_statuses(
    axes: "Axes", epochs: Floats, lines: Sequence[tuple[str, NDArray[np.bool_], str]], stroke: float
) -> None:
    """Draw a line of strokes for each status; those of wrong answers are never too thin to be seen."""
    is_many = len(epochs) > MANY_EPOCHS
    for number, (_, is_here, color) in enumerate(lines):
        width = max(stroke, 2.0) if color == WRONG else stroke
        axes.vlines(epochs[is_here], number - 0.36, number + 0.36, color=color, lw=width, rasterized=is_many)
    axes.set(ylim=(len(lines) - 0.5, -0.5))
    axes.set_yticks(range(len(lines)), [f"{word}: {int(is_here.sum()):,}" for word, is_here, _ in lines])
    axes.tick_params(axis="y", length=0, labelsize=9)
    axes.grid(visible=False, axis="y")


def _draw_errors(
    axes: "Axes", row: ErrorRow, epochs: Floats, trusted: NDArray[np.bool_], stroke: float, half: float
) -> None:
    """Draw band, levels (`half` an epoch to either side) and errors; those beyond the axis are marked at its end."""
    is_many, limit = len(epochs) > MANY_EPOCHS, row.limit
    axes.vlines(epochs, -2.0 * row.sigmas, 2.0 * row.sigmas, color=BAND, lw=stroke, zorder=1, rasterized=is_many)
    for sign in (-1.0, 1.0):
        axes.hlines(sign * row.levels, epochs - half, epochs + half, color=INK, lw=0.9, zorder=2, rasterized=is_many)
    size = 5.0 if len(epochs) <= 120 else 3.2 if len(epochs) <= 600 else 1.8
    for is_here, color, above in ((trusted, TRUSTED, 3), (~trusted, WITHHELD, 4)):
        here = is_here & (np.abs(row.errors) <= limit)
        look: dict[str, Any] = {"ls": "", "mew": 0, "color": color}
        axes.plot(epochs[here], row.errors[here], marker="o", ms=size, zorder=above, rasterized=is_many, **look)
        for sign, marker in ((1.0, "^"), (-1.0, "v")):
            beyond = epochs[is_here & (sign * row.errors > limit)]
            axes.plot(beyond, np.full(len(beyond), sign * 0.93 * limit), marker=marker, ms=5.5, zorder=5, **look)
    axes.axhline(0.0, color=MUTED, lw=0.7, zorder=1.5)
    axes.set_ylim(-limit, limit)
    axes.locator_params(axis="y", nbins=5)
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))


def _draw_legend(figure: "Figure", rows: Sequence[ErrorRow]) -> None:
    """Say what the marks of the error rows mean."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], ls="", marker="o", ms=6, color=TRUSTED, label="error, trusted answer"),
        Line2D([], [], ls="", marker="o", ms=6, color=WITHHELD, label="error, withheld answer"),
        Line2D([], [], ls="", marker="^", ms=6, color=MUTED, label="beyond the axis"),
    ]
    handles = handles if _has(rows, "errors") else []
    if _has(rows, "sigmas"):
        handles.append(Line2D([], [], color=BAND, lw=7, label="±2 predicted sigmas"))
    if _has(rows, "levels"):
        handles.append(Line2D([], [], color=INK, lw=0.9, label="protection level"))
    figure.legend(handles=handles, loc="outside lower left", ncols=len(handles))


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
    is_many = len(errors) > MANY_EPOCHS
    size, alpha = (9.0, 0.35) if is_many else (26.0, 0.55)
    for is_shown, color, marker in ((errors <= levels, SERIES[0], "o"), (errors > levels, SERIES[1], "D")):
        axes.scatter(
            drawn[is_shown], np.maximum(levels[is_shown], LEAST_LEVEL), s=size, color=color, marker=marker,
            alpha=alpha, linewidths=0.0, zorder=3, rasterized=is_many,
        )  # fmt: skip
    axes.set(xscale="log", yscale="log")
    withheld = drawn[~has_level & ~np.isnan(errors)]
    if len(withheld):
        strip.plot(withheld, np.full(len(withheld), 0.5), "x", ms=5.5, mew=1.2, color=MUTED, clip_on=False)
