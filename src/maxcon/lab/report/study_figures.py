"""Figures and tables over all epochs of a study: distinctness, success, errors, and how certain the answers are."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from maxcon.lab import evaluation
from maxcon.lab.distinctness import GUARD_RADIUS
from maxcon.lab.report import Picture
from maxcon.lab.report.certainty_plots import ErrorRow, plot_stanford, plot_timeline
from maxcon.lab.report.charts import METHOD_STYLES, Floats, plot_error_distributions
from maxcon.lab.report.claims import COUNT, HELMERT, Methods
from maxcon.lab.report.paper_figures import MEASURES, plot_distinctness, plot_kurtosis_map
from maxcon.lab.report.prior_error import levels_of_distance, plot_prior_error
from maxcon.lab.study import MethodRows, known_methods
from maxcon.lab.study.table import in_common
from maxcon.map import PointMap
from maxcon.search.space import SearchSpace

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


def own_methods(methods: Iterable[str]) -> list[str]:
    """Names of the methods that are the user's own."""
    known = known_methods(SearchSpace.paper())
    return [name for name in methods if name not in known]


def shown_methods(methods: Methods) -> list[str]:
    """Names of the methods that are drawn together in one picture, at most 8: the user's own first."""
    named = [*own_methods(methods), *(name for name in SHOWN if name in methods)]
    return (named or list(methods))[:MOST_SHOWN]


def common_rows(methods: Methods, names: Sequence[str]) -> dict[str, MethodRows]:
    """Return the rows of these methods in the epochs that all of them have, by the names that are drawn."""
    return in_common({NAMES.get(name, name): methods[name] for name in names})


def draw_statistics(folder: Path, methods: Methods, point_map: PointMap | None) -> list[Picture]:
    """Draw the figures, the trajectory over a map if given, into a folder, as SVG; return them with their captions."""
    measured = {stem: pair for stem, pair in PAIRS.items() if _have(methods, pair, "kurtosis")}
    own = [name for name in own_methods(methods) if _have(methods, [name, *PAIRS["occupied"]], "kurtosis")]
    groups = measured | ({"occupied": (*own[: MOST_SHOWN - 2], *PAIRS["occupied"])} if own else {})
    pictures = [_distinctness(folder, stem, common_rows(methods, group)) for stem, group in groups.items()]
    placed = [stem for stem, pair in measured.items() if _have(methods, pair, "reference_x")]
    pictures += [_kurtosis(folder, stem, common_rows(methods, PAIRS[stem]), point_map) for stem in placed[:1]]
    shown = shown_methods(methods)
    if levels := levels_of_distance({NAMES.get(name, name): methods[name] for name in shown}):
        plot_prior_error(folder / "success.svg", {f"prior “{methods[shown[0]].prior}”": levels})
        pictures.append(Picture.of("success", folder / "success.svg", success=evaluation.SUCCESS_WORDS))
    errors = {name: rows.numbers("distance") for name, rows in common_rows(methods, shown).items()}
    if len(next(iter(errors.values()))):
        pictures.append(plot_error_distributions(folder / "errors.svg", errors))
    return pictures


def _have(methods: Methods, names: Sequence[str], column: str) -> bool:
    """Whether each of these methods has, in epochs common to all, some value in a column."""
    if not all(name in methods for name in names):
        return False
    return all(rows.has(column) for rows in common_rows(methods, names).values())


def _distinctness(folder: Path, stem: str, rows: Methods) -> Picture:
    path, words = folder / f"distinctness-{stem}.svg", "as published" if stem == "points" else "by our defaults"
    values = {name: {field: found.numbers(field) for field in MEASURES} for name, found in rows.items()}
    plot_distinctness(path, values, title=f"How distinct the answers are: {words}")
    return Picture.of("distinctness", path, words=words, guard=GUARD_RADIUS)


def _kurtosis(folder: Path, stem: str, rows: Methods, point_map: PointMap | None) -> Picture:
    path, (small, large) = folder / f"kurtosis-{stem}.svg", rows
    positions = np.column_stack([rows[small].numbers(f"reference_{axis}") for axis in "xyz"])
    is_known = np.isfinite(positions).all(axis=1)
    local = positions[is_known]
    local = local - local.min(axis=0) if point_map is None else point_map.frame.to_local(local)
    circles = [(name, found.numbers("kurtosis")[is_known]) for name, found in rows.items()]
    plot_kurtosis_map(path, local[:, :2], *circles, point_map=point_map, title="Kurtosis along the drive")
    return Picture.of("kurtosis", path, small=small, large=large)


KINDS = {
    "along": ("along", "sigma_along"),
    "across": ("across", "sigma_across"),
    "height": ("height_error", "sigma_z"),
    "heading": ("heading_error", "sigma_heading"),
}
"""Columns of error and predicted sigma in the table of a study, by kind of error."""
DIRECTIONS = ("along", "across")
UNITS = {"along": ("cm", 100.0), "across": ("cm", 100.0), "heading": ("°", np.degrees(1.0))}
"""Kinds of error that are drawn, the unit in which they are, and its factor."""


def certainty_of(
    folder: Path, by_prior: Mapping[str, Methods], prior: str, configured: Mapping[str, Mapping[str, object]]
) -> dict[str, Any]:
    """Return tables and pictures of how certain methods are, for the page; pictures are drawn into a folder, as SVG.

    They are of one prior, timelines of all; `configured` is as the study saved it. The Stanford diagram is of the first
    method that has a covariance, the user's own before others.
    """
    methods = by_prior[prior]
    coverage, protection = [], []
    for name, found in by_prior.items():
        for method in _predicting(found):
            rows, words = found[method], f"{method}, prior “{name}”"
            coverage.append(_coverage(f"Errors within predicted sigmas: {words}", rows))
            if rows.has("protection_along"):
                risk = _risk(configured, method)
                protection.append(_protection(f"Errors within protection levels: {words}", rows, risk))
    pictures = []
    for number, (name, found) in enumerate({prior: methods, **by_prior}.items(), 1):
        path = folder / ("timeline.svg" if number == 1 else f"timeline-{number}.svg")
        pictures.append(_timeline(path, name, found[(_predicting(found) or shown_methods(found))[0]]))
    notes, stanford = [], []
    for method in _predicting(methods)[:1]:
        if methods[method].has("protection_along"):
            title = f"Protection level against true error: {method}"
            plot_stanford(folder / "stanford.svg", *_errors_and_levels(methods[method]), title=title)
            stanford.append(Picture.of("stanford", folder / "stanford.svg"))
        else:
            notes.append(f"No Stanford diagram: {method} gives no protection levels.")
    if not _predicting(methods):
        notes.append(
            "No errors against predicted sigmas, no protection levels: no method predicts its errors here, with the"
            f" prior “{prior}”. The method “maxcon” does: maxcon study --methods maxcon."
        )
    return {
        "coverage": coverage, "protection": protection, "alert_limit": evaluation.ALERT_LIMIT,
        "protection_pictures": stanford, "status_pictures": pictures, "notes": notes,
    }  # fmt: skip


def _predicting(methods: Methods) -> list[str]:
    """Methods that predict their errors, the user's own first."""
    own = own_methods(methods)
    return sorted((name for name, rows in methods.items() if rows.has("nees")), key=lambda name: name not in own)


def _risk(configured: Mapping[str, Mapping[str, object]], name: str) -> float | None:
    """How often a method says that its protection levels are exceeded, 0 to 1; None if it is not configured."""
    method = configured.get(name, {}).get("method")
    risk = method.get("risk") if isinstance(method, dict) else None
    return float(risk) if isinstance(risk, float) and 0.0 < risk < 1.0 else None


def _coverage(title: str, rows: MethodRows) -> dict[str, Any]:
    """How many errors of a method lie within their sigmas, for each kind of error, and for x and y together."""
    roots = np.sqrt(rows.numbers("nees"))
    found = [
        _coverage_row(name, evaluation.Coverage.of(rows.numbers(error), rows.numbers(sigma)))
        for name, (error, sigma) in KINDS.items()
    ]
    of_both = _coverage_row("x and y", evaluation.Coverage.of(roots, np.ones(len(roots))), 2)
    return {"title": title, "rows": [*found, of_both]}


def _coverage_row(name: str, coverage: evaluation.Coverage, n_errors: int = 1) -> dict[str, Any]:
    """A row of a table of coverage, of `n_errors` errors taken together, with what is expected if the sigmas hold."""
    promised = evaluation.PROMISED if n_errors == 1 else evaluation.PROMISED_PLANE
    verdict = "as promised"
    for (low, high), fraction in zip(coverage.intervals, promised, strict=True):
        if high < fraction:
            verdict = "too small"
        elif low > fraction and verdict != "too small":
            verdict = "too large"
    return {
        "name": name, "coverage": coverage, "n_errors": n_errors, "promised": promised,
        "promised_rms": math.sqrt(n_errors), "verdict": verdict,
    }  # fmt: skip


def _protection(title: str, rows: MethodRows, risk: float | None) -> dict[str, Any]:
    """How many epochs lie in each region of the Stanford diagram, along, across, and by the worse of both."""
    errors, levels = _errors_and_levels(rows)
    counts = {name: evaluation.ProtectionCounts.of(errors[name], levels[name]) for name in DIRECTIONS}
    both = evaluation.ProtectionCounts.of(*(np.column_stack(list(found.values())) for found in (errors, levels)))
    n_to_prove = None if risk is None else evaluation.least_to_prove(risk)
    return {"title": title, "counts": counts | {"either": both}, "risk": risk, "n_to_prove": n_to_prove}


def _errors_and_levels(rows: MethodRows) -> list[dict[str, Floats]]:
    """Errors and protection levels of the epochs that were tried, m, by direction."""
    return [{name: rows.numbers(f"{of}{name}")[rows.is_tried] for name in DIRECTIONS} for of in ("", "protection_")]


def _timeline(path: Path, prior: str, rows: MethodRows) -> Picture:
    kinds = []
    for name, (unit, factor) in UNITS.items():
        error, sigma = (factor * rows.numbers(column) for column in KINDS[name])
        level = rows.numbers(f"protection_{name}") if name in DIRECTIONS else np.full(len(error), np.nan)
        kinds.append(ErrorRow(name, unit, error, sigma, factor * level))
    statuses, is_wrong = [str(word) for word in rows.words("status")], rows.numbers("is_success") == 0.0
    title = f"The drive, epoch by epoch: {rows.method}, prior “{prior}”"
    plot_timeline(path, rows.numbers("epoch"), statuses, is_wrong, kinds, title=title)
    return Picture.of("timeline", path, prior=prior)
