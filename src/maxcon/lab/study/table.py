"""The table of a study: read, written, and summarized by method."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from maxcon._system.resumable import ResumableTable
from maxcon.estimate import Status
from maxcon.lab.evaluation import Quantiles, upper_bound

if TYPE_CHECKING:
    import pyarrow

Row = Mapping[str, Any]  # values by the names of `COLUMNS`; what is left out is null

KEY = ("prior", "method", "epoch")  # columns that name a row; rows are in their order

Key = tuple[str, str, int]

COLUMNS: dict[str, tuple[str, str]] = {
    "prior": ("string", "name of the prior in the dataset"),
    "method": ("string", "name of the method"),
    "epoch": ("int32", "number of the scan in its folder, from 0"),
    "time": ("float64", "s"),
    "scan": ("string", "name of the scan's file"),
    "n_points": ("int32", "points of the scan within the range limits"),
    "status": ("string", "the method's own word on its answer"),
    "reason": ("string", "why there is no answer, or what casts doubt on it, where the status does not say all"),
    "is_localized": ("bool", "whether the status says that the pose may be used"),
    "is_success": ("bool", "within 0.3 m and 1 degree of the reference, trusted or not; of several starts: all"),
    "x": ("float64", "answer, global, m; null without one; given whether trusted or not"),
    "y": ("float64", "m"),
    "z": ("float64", "m"),
    "roll": ("float64", "rad"),
    "pitch": ("float64", "rad"),
    "heading": ("float64", "rad"),
    "reference_x": ("float64", "reference pose, global, m"),
    "reference_y": ("float64", "m"),
    "reference_z": ("float64", "m"),
    "reference_heading": ("float64", "rad"),
    "prior_distance": ("float64", "of the prior from the reference in x and y, m"),
    "prior_heading_error": ("float64", "rad"),
    "distance": ("float64", "of the answer from the reference in x and y, m"),
    "along": ("float64", "error in the reference's heading, m"),
    "across": ("float64", "error to the left of it, m"),
    "heading_error": ("float64", "rad"),
    "height_error": ("float64", "m"),
    "sigma_along": ("float64", "predicted standard deviation in the reference's heading, m; null without a covariance"),
    "sigma_across": ("float64", "predicted, to the left of it, m"),
    "sigma_z": ("float64", "predicted, m"),
    "sigma_heading": ("float64", "predicted, rad"),
    "nees": ("float64", "normalized squared error of x and y: 2 in the mean where the covariance holds"),
    "protection_along": ("float64", "error along that is exceeded with at most the method's risk, m"),
    "protection_across": ("float64", "the same across, m"),
    "was_widened": ("bool", "whether the answer was in doubt and searched for farther around"),
    "score": ("float64", "in units of the method"),
    "share": ("float64", "of the scan's points that match, 0 to 1"),
    "runner_up": ("float64", "Helmert's score beyond 0.5 m over that of the answer"),
    "peak_ratio": ("float64", "second highest over highest score, beyond 0.3 m"),
    "kurtosis": ("float64", "of the scores along the significant ray"),
    "divergence": ("float64", "Kullback-Leibler, of the same from a Laplace distribution"),
    "spread": ("float64", "farthest cell that reaches 90 % of the highest score, m"),
    "n_starts": ("int32", "starts of a method with several"),
    "n_converged": ("int32", "of these, how many ended within 0.3 m and 1 degree of the reference"),
    "ms": ("float64", "from points in memory to the pose, scan normals included where used"),
}  # fmt: skip
"""Type and meaning of each column."""


def table_schema() -> "pyarrow.Schema":
    """Arrow schema of the table, the meaning of each column with it."""
    import pyarrow

    return pyarrow.schema(
        pyarrow.field(name, pyarrow.type_for_alias(kind), metadata={"meaning": meaning})
        for name, (kind, meaning) in COLUMNS.items()
    )


def table_of(folder: Path) -> ResumableTable:
    """Return the table of a study's folder: `table.parquet` and, while it grows, the files in `parts/`."""
    return ResumableTable(folder / "table.parquet", folder / "parts", table_schema(), KEY, "a part of a study's table")


def keys_of(table: "pyarrow.Table") -> Iterable[Key]:
    """(prior, method, epoch) of each row."""
    return zip(*(table.column(name).to_pylist() for name in KEY), strict=True)


NOT_TRIED = frozenset(
    status.value for status in (Status.UNREADABLE, Status.NO_POINTS, Status.NO_PRIOR, Status.OUTSIDE_MAP)
)
"""Statuses of epochs that no method can localize."""


@dataclass(frozen=True, slots=True)
class MethodRows:
    """The rows of one method with one prior, in order of epochs."""

    prior: str
    method: str
    table: "pyarrow.Table"

    def __len__(self) -> int:
        return len(self.table)

    def numbers(self, name: str) -> NDArray[np.float64]:
        """Return a column as float64, NaN where it is null; of booleans, 1 and 0."""
        values = self.table.column(name).to_numpy(zero_copy_only=False)
        return np.asarray(values, dtype=np.float64)

    @property
    def is_tried(self) -> NDArray[np.bool_]:
        """Whether each epoch says something about the method (`MethodStatistics.n_tried`), shape (n,)."""
        could_be = np.array([word not in NOT_TRIED for word in self.words("status")], dtype=bool)
        return could_be & np.isfinite(self.numbers("reference_x"))

    def has(self, name: str) -> bool:
        """Whether any row has a value in a column of numbers."""
        return bool(np.isfinite(self.numbers(name)).any())

    def where(self, is_kept: NDArray[np.bool_]) -> "MethodRows":
        """Return some of the rows; shape (n,)."""
        return MethodRows(self.prior, self.method, self.table.filter(is_kept))

    def words(self, name: str) -> list[str | None]:
        """Return a column of text."""
        return list(self.table.column(name).to_pylist())


@dataclass(frozen=True, slots=True)
class MethodStatistics:
    """Statistics of one method with one prior; quantiles of the absolute values of the columns, or NaN."""

    prior: str
    method: str
    n_epochs: int
    n_tried: int  # that say something of the method: reference known, scan read, start inside the map
    n_success: int  # within 0.3 m and 1 degree of the reference, trusted or not; of several starts: all
    n_localized: int  # whose pose the method itself calls localized
    n_false: int  # of these, how many are no success
    statuses: dict[str, int]  # how often each came
    n_starts: int  # over all epochs; 0 where the method has one start
    n_converged: int
    distance: Quantiles
    along: Quantiles
    across: Quantiles
    heading_error: Quantiles
    peak_ratio: Quantiles
    kurtosis: Quantiles
    divergence: Quantiles
    spread: Quantiles
    ms: Quantiles

    @property
    def false_bound(self) -> float:
        """Upper limit, with 95 % confidence, of the rate of wrong answers among those called localized, 0 to 1."""
        return upper_bound(self.n_false, self.n_localized)


def rows_by_method(table: "pyarrow.Table", order: Sequence[str] = ()) -> list[MethodRows]:
    """Return a study's table prior by prior and method by method: those of `order` first, others by name."""
    import pyarrow.compute as compute

    pairs = set(zip(table.column("prior").to_pylist(), table.column("method").to_pylist(), strict=True))
    place = {name: number for number, name in enumerate(order)}
    found = []
    for prior, method in sorted(pairs, key=lambda pair: (pair[0], place.get(pair[1], len(place)), pair[1])):
        is_here = (compute.field("prior") == prior) & (compute.field("method") == method)
        found.append(MethodRows(prior, method, table.filter(is_here).sort_by("epoch")))
    return found


def in_common(found: Mapping[str, MethodRows]) -> dict[str, MethodRows]:
    """Return the rows of at least one method in the epochs that all of them have."""
    epochs = reduce(np.intersect1d, [rows.numbers("epoch") for rows in found.values()])
    return {name: rows.where(np.isin(rows.numbers("epoch"), epochs)) for name, rows in found.items()}


def statistics(rows: MethodRows) -> MethodStatistics:
    """Summarize the rows of a method."""
    is_localized, is_success = rows.numbers("is_localized") == 1.0, rows.numbers("is_success") == 1.0
    measured = [field.name for field in fields(MethodStatistics) if field.type is Quantiles]
    known = {name: values[np.isfinite(values)] for name in measured for values in (rows.numbers(name),)}
    return MethodStatistics(
        prior=rows.prior, method=rows.method, n_epochs=len(rows), n_tried=int(rows.is_tried.sum()),
        n_success=int(is_success.sum()), n_localized=int(is_localized.sum()),
        n_false=int((is_localized & ~is_success & np.isfinite(rows.numbers("distance"))).sum()),
        statuses=dict(Counter(str(word) for word in rows.words("status"))),
        n_starts=int(np.nansum(rows.numbers("n_starts"))), n_converged=int(np.nansum(rows.numbers("n_converged"))),
        **{name: Quantiles.of(values) for name, values in known.items()},
    )  # fmt: skip
