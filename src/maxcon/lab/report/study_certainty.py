# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Certainty on a study's page: coverage, protection levels, risk."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.lab.evaluation import (
    ALERT_LIMIT,
    PROMISED,
    PROMISED_PLANE,
    Coverage,
    MeanSquare,
    ProtectionCounts,
    RiskCoverage,
    least_to_prove,
)
from maxcon.lab.report import Picture
from maxcon.lab.report.certainty_plots import plot_risk_coverage, plot_sigmas, plot_stanford
from maxcon.lab.report.study_statistics import NAMES, own_methods, shown_methods
from maxcon.lab.report.timeline import ErrorRow, plot_timeline
from maxcon.lab.study import MethodRows

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
    folder: Path,
    by_prior: Mapping[str, Mapping[str, MethodRows]],
    prior: str,
    configured: Mapping[str, Mapping[str, object]],
) -> dict[str, Any]:
    """Return tables and pictures of how certain methods are, for the page; pictures are drawn into a folder, as SVG.

    by_prior: rows by prior and by method.
    prior: the prior of the pictures; the timelines are of all of them.
    configured: configuration of each method by its name, as the study saved it.

    The pictures that need a covariance are of one method: the first that has one, the user's own before others.
    """
    methods = by_prior[prior]
    coverage, protection = [], []
    for name, found in by_prior.items():
        for method in _predicting(found):
            rows, words = found[method], f"{method}, prior “{name}”"
            coverage.append(_coverage(f"Errors within predicted sigmas: {words}", rows))
            if _has(rows, "protection_along"):
                risk = _risk(configured, method)
                protection.append(_protection(f"Errors within protection levels: {words}", rows, risk))
    pictures = _risk_coverage(folder / "risk-coverage.svg", methods)
    for number, (name, found) in enumerate({prior: methods, **by_prior}.items(), 1):
        path = folder / ("timeline.svg" if number == 1 else f"timeline-{number}.svg")
        pictures.append(_timeline(path, name, found[(_predicting(found) or shown_methods(found))[0]]))
    notes, sigmas, stanford = [], [], []
    for method in _predicting(methods)[:1]:
        sigmas.append(_sigmas(folder / "sigmas.svg", methods[method]))
        if _has(methods[method], "protection_along"):
            stanford.append(_stanford(folder / "stanford.svg", methods[method]))
        else:
            notes.append(f"No Stanford diagram: {method} gives no protection levels.")
    if not sigmas:
        notes.append(
            "No errors against predicted sigmas, no protection levels: no method predicts its errors here, with the"
            f" prior “{prior}”. The method “maxcon” does: maxcon study --methods maxcon."
        )
    return {
        "coverage": coverage, "protection": protection, "alert_limit": ALERT_LIMIT, "coverage_pictures": sigmas,
        "protection_pictures": stanford, "status_pictures": pictures, "notes": notes,
    }  # fmt: skip


def _has(rows: MethodRows, column: str) -> bool:
    """Whether any row has a value in a column."""
    return bool(np.isfinite(rows.numbers(column)).any())


def _predicting(methods: Mapping[str, MethodRows]) -> list[str]:
    """Methods that predict their errors, the user's own first."""
    own = own_methods(methods)
    names = [name for name, rows in methods.items() if _has(rows, "nees")]
    return sorted(names, key=lambda name: name not in own)


def _risk(configured: Mapping[str, Mapping[str, object]], name: str) -> float | None:
    """How often a method says that its protection levels are exceeded, 0 to 1; None if it is not configured."""
    method = configured.get(name, {}).get("method")
    risk = method.get("risk") if isinstance(method, dict) else None
    return float(risk) if isinstance(risk, float) and 0.0 < risk < 1.0 else None


def _coverage(title: str, rows: MethodRows) -> dict[str, Any]:
    """How many errors of a method lie within their sigmas, for each kind of error, and for x and y together."""
    squares = rows.numbers("nees")
    found = [
        _coverage_row(name, Coverage.of(rows.numbers(error), rows.numbers(sigma)))
        for name, (error, sigma) in KINDS.items()
    ]
    found.append(_coverage_row("x and y", Coverage.of(np.sqrt(squares), np.ones(len(squares))), n_errors=2))
    return {"title": title, "rows": found, "squares": MeanSquare.of(squares)}


def _coverage_row(name: str, coverage: Coverage, n_errors: int = 1) -> dict[str, Any]:
    """A row of a table of coverage, of `n_errors` errors taken together, with what is expected if the sigmas hold."""
    promised = PROMISED if n_errors == 1 else PROMISED_PLANE
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
    """How many epochs lie in each region of the Stanford diagram, along, across, and by the worse of both.

    risk: how often the method says that its levels are exceeded, 0 to 1, if it says so.
    """
    errors, levels = (np.column_stack(list(found.values())) for found in _errors_and_levels(rows))
    counts = {name: ProtectionCounts.of(errors[:, number], levels[:, number]) for number, name in enumerate(DIRECTIONS)}
    return {
        "title": title,
        "counts": counts | {"either": ProtectionCounts.of(errors, levels)},
        "risk": risk,
        "n_to_prove": None if risk is None else least_to_prove(risk),
    }


def _errors_and_levels(rows: MethodRows) -> list[dict[str, NDArray[np.float64]]]:
    """Errors and protection levels of the epochs that were tried, m, by direction."""
    return [{name: rows.numbers(f"{of}{name}")[rows.is_tried] for name in DIRECTIONS} for of in ("", "protection_")]


def _sigmas(path: Path, rows: MethodRows) -> Picture:
    plot_sigmas(path, _error_rows(rows), title=f"Error against predicted sigma: {rows.method}")
    return Picture.of("sigmas", path)


def _stanford(path: Path, rows: MethodRows) -> Picture:
    plot_stanford(path, *_errors_and_levels(rows), title=f"Protection level against true error: {rows.method}")
    return Picture.of("stanford", path)


def _risk_coverage(path: Path, methods: Mapping[str, MethodRows]) -> list[Picture]:
    found = {}
    for name in shown_methods(methods):
        rows = methods[name]
        tried = rows.is_tried
        if tried.any():
            found[NAMES.get(name, name)] = RiskCoverage.of(
                rows.numbers("is_success")[tried] == 1.0,
                np.isfinite(rows.numbers("x"))[tried],
                rows.numbers("is_localized")[tried] == 1.0,
                rows.numbers("runner_up")[tried],
            )
    if not found:
        return []
    plot_risk_coverage(path, found)
    return [Picture.of("risk-coverage", path)]


def _error_rows(rows: MethodRows) -> list[ErrorRow]:
    """Errors, predicted sigmas and protection levels of the kinds that are drawn."""
    found = []
    for name, (unit, factor) in UNITS.items():
        error, sigma = (factor * rows.numbers(column) for column in KINDS[name])
        level = rows.numbers(f"protection_{name}") if name in DIRECTIONS else np.full(len(error), np.nan)
        found.append(ErrorRow(name, unit, error, sigma, factor * level))
    return found


def _timeline(path: Path, prior: str, rows: MethodRows) -> Picture:
    plot_timeline(
        path,
        rows.numbers("epoch"),
        [str(word) for word in rows.words("status")],
        rows.numbers("is_success") == 0.0,
        _error_rows(rows),
        title=f"The drive, epoch by epoch: {rows.method}, prior “{prior}”",
    )
    return Picture.of("timeline", path, prior=prior)
