"""The paper's claims, and what a study says of them."""

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from maxcon.lab.evaluation import SUCCESS_DISTANCE, SUCCESS_WORDS
from maxcon.lab.report import page_words
from maxcon.lab.report.charts import Floats
from maxcon.lab.study import MethodRows, MethodStatistics, statistics
from maxcon.lab.study.table import in_common

COUNT, HELMERT = "count-points", "helmert-points"
"""The paper's two methods: a match counts as often as its voxel has map points."""
STARTS = ("icp-plane-1m-5x5", "icp-plane-3m-5x5", "icp-point-1m-5x5", "icp-point-3m-5x5")

# "Much higher" is taken to mean half as much again, in the median.
MUCH = 1.5
# Cells whose distance is at most this many edges are neighbours, diagonal ones too.
NEIGHBOURS = 1.5

Methods = Mapping[str, MethodRows]  # rows of one prior, by the method's name


class Verdict(StrEnum):
    """Whether a study agrees with a claim."""

    AGREES = "agrees"
    PARTLY = "partly"
    DIFFERS = "differs"
    NOT_STUDIED = "not studied"


_Finding = tuple[str, Verdict]


class _NotStudiedError(Exception):
    """What a study lacks to say anything of a claim."""


@dataclass(frozen=True, slots=True)
class Claim:
    """What the paper says, in our words, beside what a study shows, in numbers; and whether they agree."""

    paper: str
    study: str
    verdict: Verdict


def paper_claims(methods: Methods, cell: float, centred: Methods | None = None) -> list[Claim]:
    """Return the claims of the paper's evaluation with what a study shows of each.

    cell: edge of a cell, m.
    centred: the same with the reference as the prior, if it was studied: kurtosis and divergence depend on where in the
        search space the peak lies, and the paper's search spaces lie around the reference.

    Epochs in which a method could not be tried do not count (`MethodStatistics.n_tried`).
    """
    found = {name: statistics(rows) for name, rows in methods.items()}
    along_ray, where = (centred, "Around the reference, ") if centred else (methods, "Around this prior, ")
    checks: dict[str, Callable[[], _Finding]] = {
        "helmert": lambda: _helmert_succeeds(found),
        "count": lambda: _count_fails(found),
        "icp": lambda: _icp_fails(found),
        "ratio": lambda: _compared(methods, "peak_ratio", "Median ratio", operator.lt),
        "kurtosis": lambda: _compared(along_ray, "kurtosis", f"{where}median kurtosis", operator.gt, factor=MUCH),
        "divergence": lambda: _compared(along_ray, "divergence", f"{where}median divergence", operator.lt),
        "spread": lambda: _spread(methods, cell),
        "precision": lambda: _precision(methods),
    }
    return [_checked(page_words()["claims"][name], check) for name, check in checks.items()]


def _checked(paper: str, check: Callable[[], _Finding]) -> Claim:
    try:
        return Claim(paper, *check())
    except _NotStudiedError as lacking:
        return Claim(paper, f"No epoch with {lacking}.", Verdict.NOT_STUDIED)


def _verdict(is_so: bool, is_partly: bool = False) -> Verdict:
    return Verdict.AGREES if is_so else Verdict.PARTLY if is_partly else Verdict.DIFFERS


def _ratio(part: int, whole: int) -> str:
    return f"{part:,} of {whole:,} ({100.0 * part / whole:.1f} %)" if whole else "none"


def _left_out(method: MethodStatistics) -> str:
    """Say how many epochs a claim leaves out."""
    n_left_out = method.n_epochs - method.n_tried
    return f" ({n_left_out:,} more could not be tried)" if n_left_out else ""


def _tried(found: Mapping[str, MethodStatistics], name: str) -> MethodStatistics:
    """Return a method that was tried in some epoch."""
    if name not in found:
        raise _NotStudiedError(name)
    if not found[name].n_tried:
        raise _NotStudiedError(f"an answer of {name}")
    return found[name]


def _paper_pair(methods: Methods) -> tuple[str, str]:
    """Return the names of Helmert's score and the count, which must both be studied."""
    if HELMERT not in methods or COUNT not in methods:
        raise _NotStudiedError(f"both {COUNT} and {HELMERT}")
    return HELMERT, COUNT


def _values_of(methods: Methods, names: tuple[str, str], column: str, *, succeed: bool = False) -> list[Floats]:
    """Values of a column by two methods in the epochs where both have one, and where both succeed if told so."""
    here = {}
    for name in names:
        rows = methods[name]
        is_here = np.isfinite(rows.numbers(column)) & ((rows.numbers("is_success") == 1.0) | (not succeed))
        here[name] = rows.where(is_here)
    return [rows.numbers(column) for rows in in_common(here).values()]


def _helmert_succeeds(found: Mapping[str, MethodStatistics]) -> _Finding:
    method = _tried(found, HELMERT)
    words = f"{_ratio(method.n_success, method.n_tried)} epochs within {SUCCESS_WORDS}"
    if other := found.get("helmert-occupied"):
        words += f"; {_ratio(other.n_success, other.n_tried)} by our defaults"
    verdict = _verdict(method.n_success == method.n_tried, method.n_success >= 0.99 * method.n_tried)
    return f"{words}{_left_out(method)}.", verdict


def _count_fails(found: Mapping[str, MethodStatistics]) -> _Finding:
    method = _tried(found, COUNT)
    n_failed = method.n_tried - method.n_success
    words = f"The count fails in {_ratio(n_failed, method.n_tried)} epochs"
    words += f", by up to {method.distance.worst:.2f} m" if method.distance.worst > SUCCESS_DISTANCE else ""
    if other := found.get("count-occupied"):
        words += f"; in {_ratio(other.n_tried - other.n_success, other.n_tried)} by our defaults"
    return f"{words}{_left_out(method)}.", _verdict(n_failed > 0)


def _icp_fails(found: Mapping[str, MethodStatistics]) -> _Finding:
    studied = [found[name] for name in STARTS if name in found and found[name].n_tried]
    if not studied:
        raise _NotStudiedError(" or ".join(STARTS[:2]))
    exceeds = [1.0 - method.n_success / method.n_tried > 0.2 for method in studied]
    words = "; ".join(
        f"{method.method}: fails in {_ratio(method.n_tried - method.n_success, method.n_tried)} epochs"
        for method in studied
    )
    return f"{words}{_left_out(studied[0])}.", _verdict(all(exceeds), any(exceeds))


def _compared(
    methods: Methods, column: str, words: str, is_better: Callable[[Any, Any], Any], factor: float = 1.0
) -> _Finding:
    """Check whether a measure is better for Helmert's score than for the count; `words` begin the sentence on it."""
    # The claim holds if the median, by `factor` if above 1, and nine tenths of the epochs are; partly if the median is.
    helmert, count = _values_of(methods, _paper_pair(methods), column)
    if not len(helmert):
        raise _NotStudiedError(f"{column} of both")
    medians = float(np.median(helmert)), float(np.median(count))
    n_better = int(is_better(helmert, count).sum())
    is_so, is_general = is_better(*medians), n_better >= 0.9 * len(helmert)
    is_general &= medians[0] >= factor * medians[1] if factor > 1.0 else True
    study = (
        f"{words} of Helmert's score {medians[0]:.3g}, of the count {medians[1]:.3g}; Helmert's is the more"
        f" distinct in {_ratio(n_better, len(helmert))} epochs."
    )
    return study, _verdict(is_so and is_general, is_so)


def _spread(methods: Methods, cell: float) -> _Finding:
    spreads = [methods[name].numbers("spread") for name in _paper_pair(methods)]
    spreads = [values[np.isfinite(values)] for values in spreads]
    if not all(map(len, spreads)):
        raise _NotStudiedError("a spread of both")
    n_near = [int((values <= NEIGHBOURS * cell).sum()) for values in spreads]
    words = " ".join(
        f"{name}: only neighbours in {_ratio(near, len(values))} epochs, 95 % of the spreads below"
        f" {np.quantile(values, 0.95):.2f} m, largest {values.max():.2f} m."
        for name, near, values in zip(("Helmert's score", "The count"), n_near, spreads, strict=True)
    )
    shares = [near / len(values) for near, values in zip(n_near, spreads, strict=True)]
    return words, _verdict(shares[0] == 1.0 and shares[1] < 1.0, shares[0] > shares[1])


def _precision(methods: Methods) -> _Finding:
    name = next((name for name in ("icp-plane-1m", "icp-plane-3m") if name in methods), None)
    if HELMERT not in methods or name is None:
        raise _NotStudiedError(f"both {HELMERT} and icp-plane-1m or icp-plane-3m")
    icp, helmert = _values_of(methods, (name, HELMERT), "distance", succeed=True)
    if not len(icp):
        raise _NotStudiedError(f"success of both {HELMERT} and {name}")
    medians = float(np.median(icp)), float(np.median(helmert))
    words = f"Where both succeed ({len(icp):,} epochs), median error of {name} {medians[0]:.3f} m, of {HELMERT}"
    return f"{words} {medians[1]:.3f} m.", _verdict(medians[0] < medians[1])
