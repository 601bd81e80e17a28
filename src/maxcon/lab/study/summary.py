# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Statistics of each method of a study."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from maxcon.estimate import Status
from maxcon.lab.evaluation import Quantiles

if TYPE_CHECKING:
    import pyarrow

NOT_TRIED = frozenset(
    status.value for status in (Status.UNREADABLE, Status.NO_POINTS, Status.NO_PRIOR, Status.OUTSIDE_MAP)
)
"""Statuses of epochs that no method can localize."""

__all__ = ["Column", "MethodRows", "MethodStatistics", "rows_by_method", "statistics"]

Column = NDArray[np.float64]
"""One value per epoch; NaN where there is none."""


@dataclass(frozen=True)
class MethodRows:
    """The rows of one method with one prior, in order of epochs.

    prior, method: which.
    table: its rows.
    """

    prior: str
    method: str
    table: "pyarrow.Table"

    def __len__(self) -> int:
        return len(self.table)

    def numbers(self, name: str) -> Column:
        """Return a column as float64, NaN where it is null; of booleans, 1 and 0."""
        values = self.table.column(name).to_numpy(zero_copy_only=False)
        return np.asarray(values, dtype=np.float64)

    @property
    def is_tried(self) -> NDArray[np.bool_]:
        """Whether each epoch says something about the method (`MethodStatistics.n_tried`), shape (n,)."""
        could_be = np.array([word not in NOT_TRIED for word in self.words("status")], dtype=bool)
        return could_be & np.isfinite(self.numbers("reference_x"))

    def words(self, name: str) -> list[str | None]:
        """Return a column of text."""
        return list(self.table.column(name).to_pylist())


@dataclass(frozen=True, slots=True)
class MethodStatistics:
    """Statistics of one method over all its epochs.

    prior, method: which.
    n_epochs: rows.
    n_tried: epochs that say something about the method: the reference is known, the scan could be read, and the start
        lay inside the map.
    n_answers: epochs with a pose, trusted or not.
    n_success: within 0.3 m and 1 degree of the reference, trusted or not; of several starts: all.
    n_localized: epochs whose pose the method itself calls localized.
    n_false: of these, how many are no success.
    statuses: how often each status came.
    distance, along, across, heading: of the absolute errors over the answers, m, and rad for the heading; NaN without
        answers.
    peak_ratio, kurtosis, divergence, spread: medians; NaN where the method has none.
    n_starts, n_converged: over all epochs; 0 where the method has one start.
    ms, ms_95: median and 95 % of the time, ms.
    """

    prior: str
    method: str
    n_epochs: int
    n_tried: int
    n_answers: int
    n_success: int
    n_localized: int
    n_false: int
    statuses: dict[str, int]
    distance: Quantiles
    along: Quantiles
    across: Quantiles
    heading: Quantiles
    peak_ratio: float
    kurtosis: float
    divergence: float
    spread: float
    n_starts: int
    n_converged: int
    ms: float
    ms_95: float


def rows_by_method(table: "pyarrow.Table", order: Sequence[str] = ()) -> list[MethodRows]:
    """Return the table of a study method by method, prior by prior.

    table: of a study.
    order: methods in this order first, others behind them by name.
    """
    import pyarrow.compute

    pairs = set(zip(table.column("prior").to_pylist(), table.column("method").to_pylist(), strict=True))
    place = {name: number for number, name in enumerate(order)}
    found = []
    for prior, method in sorted(pairs, key=lambda pair: (pair[0], place.get(pair[1], len(place)), pair[1])):
        is_here = pyarrow.compute.and_(
            pyarrow.compute.equal(table.column("prior"), prior), pyarrow.compute.equal(table.column("method"), method)
        )
        found.append(MethodRows(prior, method, table.filter(is_here).sort_by("epoch")))
    return found


def statistics(rows: MethodRows) -> MethodStatistics:
    """Summarize the rows of a method."""
    is_localized, is_success = rows.numbers("is_localized") == 1.0, rows.numbers("is_success") == 1.0
    return MethodStatistics(
        prior=rows.prior,
        method=rows.method,
        n_epochs=len(rows),
        n_tried=int(rows.is_tried.sum()),
        n_answers=int(np.isfinite(rows.numbers("x")).sum()),
        n_success=int(is_success.sum()),
        n_localized=int(is_localized.sum()),
        n_false=int((is_localized & ~is_success & np.isfinite(rows.numbers("distance"))).sum()),
        statuses=dict(Counter(str(word) for word in rows.words("status"))),
        distance=_quantiles(rows.numbers("distance")),
        along=_quantiles(rows.numbers("along")),
        across=_quantiles(rows.numbers("across")),
        heading=_quantiles(rows.numbers("heading_error")),
        peak_ratio=_median(rows.numbers("peak_ratio")),
        kurtosis=_median(rows.numbers("kurtosis")),
        divergence=_median(rows.numbers("divergence")),
        spread=_median(rows.numbers("spread")),
        n_starts=int(np.nansum(rows.numbers("n_starts"))),
        n_converged=int(np.nansum(rows.numbers("n_converged"))),
        ms=_median(rows.numbers("ms")),
        ms_95=_quantile(rows.numbers("ms"), 0.95),
    )


def _median(values: Column) -> float:
    return _quantile(values, 0.5)


def _quantile(values: Column, share: float) -> float:
    known = values[np.isfinite(values)]
    return float(np.quantile(known, share)) if len(known) else math.nan


def _quantiles(errors: Column) -> Quantiles:
    """Quantiles of absolute errors, over the answers."""
    return Quantiles.of(errors[np.isfinite(errors)])
