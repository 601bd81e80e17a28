# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Figures over all epochs of a study: how distinct answers are, success by the prior's error, errors."""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.charts import DASHES, METHOD_STYLES, draw_grid, draw_number_ticks, method_chart
from maxcon.lab.distinctness import GUARD_RADIUS
from maxcon.lab.evaluation import SUCCESS_DISTANCE, SUCCESS_WORDS, clopper_pearson
from maxcon.lab.paper.claims import COUNT, HELMERT
from maxcon.lab.paper.distinctness_plots import MEASURES, plot_distinctness, plot_kurtosis_map
from maxcon.lab.report import Picture
from maxcon.lab.study import MethodRows, known_methods
from maxcon.map import PointMap
from maxcon.plotting.figure import INK, MUTED
from maxcon.search.space import SearchSpace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]
# Methods that are drawn together in one picture, the first `MOST_SHOWN` of those that a study has.
SHOWN = (
    "maxcon", "helmert-points", "helmert-occupied", "count-points", "count-occupied",
    "icp-plane-1m", "icp-plane-3m", "gicp-3m", "icp-point-3m",
)  # fmt: skip
MOST_SHOWN = len(METHOD_STYLES)
NAMES = {
    "maxcon": "maxcon, refined",
    "helmert-points": "Helmert, as published",
    "helmert-occupied": "Helmert, our defaults",
    "count-points": "Count, as published",
    "count-occupied": "Count, our defaults",
}
PAIRS = {"points": (COUNT, HELMERT), "occupied": ("count-occupied", "helmert-occupied")}


def draw_statistics(folder: Path, methods: Mapping[str, MethodRows], point_map: PointMap | None) -> list[Picture]:
    """Draw the figures into a folder, as SVG; return them with their captions.

    methods: by name, one prior.
    point_map: drawn below the trajectory, if given.
    """
    measured = {stem: pair for stem, pair in PAIRS.items() if _have(methods, pair, "kurtosis")}
    own = [name for name in own_methods(methods) if _have(methods, [name, *PAIRS["occupied"]], "kurtosis")]
    groups = measured | ({"occupied": (*own[: MOST_SHOWN - 2], *PAIRS["occupied"])} if own else {})
    pictures = [_distinctness(folder, methods, stem, group) for stem, group in groups.items()]
    placed = [stem for stem, pair in measured.items() if _have(methods, pair, "reference_x")]
    pictures += [_kurtosis(folder, methods, stem, PAIRS[stem], point_map) for stem in placed[:1]]
    shown = shown_methods(methods)
    pictures += _success(folder / "success.svg", methods, shown)
    if len(epochs := common_epochs(methods, shown)):
        errors = {NAMES.get(name, name): _column(methods[name], "distance", epochs) for name in shown}
        pictures.append(plot_error_distributions(folder / "errors.svg", errors))
    return pictures


def own_methods(methods: Iterable[str]) -> list[str]:
    """Names of the methods that are the user's own."""
    known = known_methods(SearchSpace.paper())
    return [name for name in methods if name not in known]


def shown_methods(methods: Mapping[str, MethodRows]) -> list[str]:
    """Names of the methods that are drawn together in one picture, at most 8: the user's own first."""
    named = [*own_methods(methods), *(name for name in SHOWN if name in methods)]
    return (named or list(methods))[:MOST_SHOWN]


def _have(methods: Mapping[str, MethodRows], names: Sequence[str], column: str) -> bool:
    """Whether each of these methods has, in epochs common to all, some value in a column."""
    if not all(name in methods for name in names):
        return False
    epochs = common_epochs(methods, names)
    return all(bool(np.isfinite(_column(methods[name], column, epochs)).any()) for name in names)


def common_epochs(methods: Mapping[str, MethodRows], names: Sequence[str]) -> Floats:
    """Numbers of the epochs that all of these methods have a row for, rising."""
    epochs = methods[names[0]].numbers("epoch")
    for name in names[1:]:
        epochs = np.intersect1d(epochs, methods[name].numbers("epoch"))
    return epochs


def _column(rows: MethodRows, name: str, epochs: Floats) -> Floats:
    """Values of a column in the given epochs, in order of epochs."""
    return rows.numbers(name)[np.isin(rows.numbers("epoch"), epochs)]


def _distinctness(folder: Path, methods: Mapping[str, MethodRows], stem: str, pair: Sequence[str]) -> Picture:
    epochs, path = common_epochs(methods, pair), folder / f"distinctness-{stem}.svg"
    words = "as published" if stem == "points" else "by our defaults"
    values = {
        NAMES.get(name, name): {field: _column(methods[name], field, epochs) for field in MEASURES} for name in pair
    }
    plot_distinctness(path, values, title=f"How distinct the answers are: {words}")
    return Picture.of("distinctness", path, words=words, guard=GUARD_RADIUS)


def _kurtosis(
    folder: Path, methods: Mapping[str, MethodRows], stem: str, pair: Sequence[str], point_map: PointMap | None
) -> Picture:
    epochs, path, rows = common_epochs(methods, pair), folder / f"kurtosis-{stem}.svg", methods[pair[0]]
    positions = np.column_stack([_column(rows, f"reference_{axis}", epochs) for axis in ("x", "y", "z")])
    is_known = np.isfinite(positions).all(axis=1)
    local = positions[is_known]
    local = local - local.min(axis=0) if point_map is None else point_map.frame.to_local(local)
    small, large = ((NAMES[name], _column(methods[name], "kurtosis", epochs)[is_known]) for name in pair)
    plot_kurtosis_map(path, local[:, :2], small, large, point_map=point_map, title="Kurtosis along the drive")
    return Picture.of("kurtosis", path, small=small[0], large=large[0])


def _success(path: Path, methods: Mapping[str, MethodRows], shown: Sequence[str]) -> list[Picture]:
    found = {}
    for name in shown:
        distance = methods[name].numbers("prior_distance")
        is_known = np.isfinite(distance) & methods[name].is_tried
        if is_known.any():
            is_success = methods[name].numbers("is_success")[is_known] == 1.0
            found[NAMES.get(name, name)] = (distance[is_known], is_success)
    if not found:
        return []
    plot_success(path, found)
    return [Picture.of("success", path, success=SUCCESS_WORDS)]


# The axis of distributions, m: a centimetre is below any reference's accuracy, ten metres beyond any search space.
LEAST, MOST = 0.01, 10.0


def percents_within(errors: Floats, limits: Floats) -> Floats:
    """Percentage of all epochs with at most these errors; an epoch without an answer (NaN) is within none.

    errors: shape (n,); m, n > 0; limits: shape (m,); m. Returns shape (m,).
    """
    known = np.sort(errors[~np.isnan(errors)])
    return np.asarray(100.0 * np.searchsorted(known, limits, side="right") / len(errors), dtype=np.float64)


def plot_error_distributions(path: Path, errors_by_method: Mapping[str, Floats]) -> Picture:
    """Draw the cumulative distribution of each method's horizontal errors over all epochs.

    errors_by_method: shape (n,); distance to the reference, m, by the method's name, at most 8, all of the same epochs;
        NaN where it did not localize: such an epoch is within no error, the curve ends below 100 %.
    """
    n_epochs = len(next(iter(errors_by_method.values())))
    words = (
        f"Epochs: {n_epochs}, those without an answer too. Dashed: success, {SUCCESS_DISTANCE:g} m."
        " Below: shares within it."
    )
    labels = [_label(name, values) for name, values in errors_by_method.items()]
    titles = ("How many epochs stay within which error", words)
    with method_chart(path, labels, titles) as (axes, handles):
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
    return Picture.of("errors", Path(path))


def _label(name: str, errors: Floats) -> str:
    """Return the legend of a method: its epochs within the limit of success, and those without an answer."""
    percent = float(percents_within(errors, np.array([SUCCESS_DISTANCE]))[0])
    n_missing = int(np.isnan(errors).sum())
    return f"{name}: {percent:.1f} %" + (f", {n_missing} without an answer" if n_missing else "")


MOST_BINS = 20


def plot_success(path: str | os.PathLike[str], found: Mapping[str, tuple[Floats, NDArray[np.bool_]]]) -> None:
    """Draw the success rate of each method against the distance of the prior from the reference.

    Bars are intervals of 95 % (`clopper_pearson`); the numbers of epochs of each bin stand above it.

    found: by the method's name, at most 8: distance of each prior from the reference, m, finite, shape (n,), and
        whether the method succeeded, bool, shape (n,). The methods need not have the same epochs.
    """
    farthest = max(float(offsets.max()) for offsets, _ in found.values())
    edges = round_width(farthest) * np.arange(int(farthest / round_width(farthest)) + 2)
    counts = {
        name: [np.histogram(chosen, edges)[0] for chosen in (offsets, offsets[is_success])]
        for name, (offsets, is_success) in found.items()
    }
    labels = [f"{name}: {100.0 * good.sum() / total.sum():.1f} %" for name, (total, good) in counts.items()]
    words = (
        f"Success: within {SUCCESS_WORDS} of the reference. Bins of {edges[1]:g} m; bars: 95 % intervals.\n"
        "Numbers above: epochs in each bin. Below: success over all epochs."
    )
    titles = ("Success by the error of the prior", words)
    with method_chart(path, labels, titles) as (axes, handles):
        for number, (total, good) in enumerate(counts.values()):
            apart = (number - 0.5 * (len(counts) - 1)) * min(0.12, 0.7 / len(counts))
            handles += _draw_rates(axes, number, edges[:-1] + (0.5 + apart) * edges[1], total, good)
        _draw_numbers(axes, np.array([total for total, _ in counts.values()]), edges)
        axes.set(xlim=(0.0, edges[-1]), ylim=(0.0, 102.0), xticks=edges)
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_xlabel("distance of the prior from the reference [m]")
        axes.set_ylabel("success [% of the epochs in the bin]")
        draw_grid(axes)


def round_width(farthest: float) -> float:
    """Return the smallest of 0.5, 1, 2, 5, 10, ... m that makes at most 20 bins up to the farthest offset."""
    widths = [digit * 10.0**power for power in range(-1, 9) for digit in (1.0, 2.0, 5.0)]
    return next(width for width in widths[2:] if int(farthest / width) < MOST_BINS)


def _draw_rates(axes: "Axes", number: int, places: Floats, total: NDArray[Any], good: NDArray[Any]) -> list[Any]:
    """Draw the rates of one method with their intervals at `places`; return what stands for it in the legend."""
    style = METHOD_STYLES[number]
    is_any = total > 0
    places, total, good = places[is_any], total[is_any], good[is_any]
    low, high = np.array([clopper_pearson(int(k), int(n)) for k, n in zip(good, total, strict=True)]).T
    axes.vlines(places, 100.0 * low, 100.0 * high, color=style.color, lw=1.5, alpha=0.75, zorder=2)
    return axes.plot(
        places, 100.0 * good / total, color=style.color, ls=style.line, lw=1.3, marker=style.marker, ms=6.5,
        mec="white", mew=0.7, zorder=3, clip_on=False,
    )  # fmt: skip


def _draw_numbers(axes: "Axes", totals: NDArray[Any], edges: NDArray[Any]) -> None:
    """Write how many epochs each bin holds above it: from fewest to most where methods have different epochs."""
    place: dict[str, Any] = {"transform": axes.get_xaxis_transform(), "va": "center", "fontsize": 9, "color": MUTED}
    for low, high, middle in zip(totals.min(axis=0), totals.max(axis=0), edges[:-1] + 0.5 * edges[1], strict=True):
        axes.text(middle, 1.035, f"{low}" if low == high else f"{low}–{high}", ha="center", **place)
    axes.text(-0.02 * edges[-1], 1.035, "epochs", ha="right", **place)
