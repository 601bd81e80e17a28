"""Outcome of an alignment: how far passes lie apart before and after, how sure that is, and the files that say so."""

import csv
import json
import math
import os
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon._system.regular_file import read_regular
from maxcon._system.version import __version__
from maxcon.mapping.align.passes import Passes
from maxcon.mapping.align.pose_graph import Adjusted
from maxcon.mapping.align.visits import Constraint

LARGEST_SIGMA = 0.02  # m; directions in which a constraint is less sure than this are left out of residuals
LEAST_WEIGHT = 0.2  # a constraint that weighs less contradicts the others: it is some seven sigmas off
NORMAL_MEDIAN = 0.6745  # median of the absolute value of a standard normal deviate
OPEN_RATIO = 0.5  # a pass is open along a direction in which its sigma exceeds this part of its prior's

SUMMARY = "alignment.json"
TABLES = (SUMMARY, "passes.csv", "residuals.csv", "ties.csv", "corrections.csv")
LARGEST_SUMMARY = 2**24  # bytes
AXES = ("x", "y", "z")
OF_SIZES = ("median", "95")
Row = Sequence[object]


class PairResiduals(NamedTuple):
    """How far two passes lie apart where they were matched."""

    passes: tuple[int, int]  # numbers of the two
    n_constraints: int  # matched pairs of visits
    n_contradicted: int  # how many of these contradict the others
    # median and 95 % of the distances along horizontal directions in which a constraint is sure, m; NaN without any
    horizontal_before: tuple[float, float]
    horizontal_after: tuple[float, float]
    # median and 95 % of the differences of heights, m
    height_before: tuple[float, float]
    height_after: tuple[float, float]


class PassConnectivity(NamedTuple):
    """The correction of one pass, and how well the other passes determine it."""

    name: str  # of the pass
    n_constraints: int  # constraints of its visits that the others do not contradict
    component: int  # number of its connected component in the graph of constraints; 0 is the largest one
    shift: NDArray[np.float64]  # (3,): by which its centre was moved, in the middle of its time, m
    turn: NDArray[np.float64]  # (3,): rotation vector by which it was turned there, rad
    # (3,): standard deviations of that position along x, y and z, m, relative to the mean of its component's others
    sigma: NDArray[np.float64]
    words: str  # what the constraints leave open, for the user; empty if nothing


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """The outcome of an alignment; sigmas are standard deviations along a horizontal axis, m."""

    passes: Passes
    constraints: tuple[Constraint, ...]  # matched pairs of visits that are used
    refused: Mapping[str, int]  # number of the other matched pairs, by the reason why they are not used
    adjusted: Adjusted  # corrections of the passes, and what remains
    connectivity: tuple[PassConnectivity, ...]  # one for each pass
    # how well one pass is known relative to the others, before and after
    sigma_before: float
    sigma_of_pass: float
    # how well a map of all passes is known, their mean: from the differences that remain between passes, and from the
    # mean of their drifts, which no match reveals; without `sigma_of_datum`
    sigma_of_map: float
    sigma_of_datum: float  # how far all passes together may be off: only their priors, not their matches, tell

    @classmethod
    def of(
        cls, passes: Passes, matched: Sequence[Constraint], adjusted: Adjusted, prior_sigmas: NDArray[np.float64]
    ) -> "Alignment":
        """Outcome of an adjustment to those matched pairs that have no fault."""
        constraints = tuple(each for each in matched if not each.fault)
        refused = Counter(each.fault for each in matched if each.fault)
        connectivity = tuple(connectivity_of_passes(passes, constraints, adjusted, prior_sigmas))
        before, after = remaining_sigmas(constraints, adjusted)
        n_connected = sum(each.component == 0 for each in connectivity)
        of_map = math.hypot(after, adjusted.drift_sigma) / math.sqrt(n_connected)
        datum = datum_sigma(passes, adjusted)
        return cls(passes, constraints, refused, adjusted, connectivity, before, after, of_map, datum)

    @property
    def n_contradicted(self) -> int:
        """How many constraints contradict the others."""
        return int(np.count_nonzero(is_contradicted(self.adjusted.weights)))

    @property
    def pairs(self) -> list[PairResiduals]:
        """Residuals of each pair of passes."""
        return pair_residuals(self.constraints, self.adjusted)


def is_contradicted(weights: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether the other constraints contradict each one of these weights, shape (n,)."""
    return np.asarray(weights < LEAST_WEIGHT)


def pair_residuals(constraints: Sequence[Constraint], adjusted: Adjusted) -> list[PairResiduals]:
    """Residuals of all pairs of passes that have constraints, in order of their numbers."""
    pairs = defaultdict[tuple[int, int], list[int]](list)
    for number, each in enumerate(constraints):
        pairs[each.passes].append(number)
    is_used, residuals = ~is_contradicted(adjusted.weights), []
    for passes, rows in sorted(pairs.items()):
        used = [row for row in rows if is_used[row]]
        residuals.append(PairResiduals(passes, len(rows), len(rows) - len(used), *_apart(constraints, adjusted, used)))
    return residuals


def remaining_sigmas(constraints: Sequence[Constraint], adjusted: Adjusted) -> tuple[float, float]:
    """Sigmas of one pass's position relative to the others, horizontally, m, before and after, from medians."""
    used = np.flatnonzero(~is_contradicted(adjusted.weights)).tolist()
    (before, _), (after, _), *_ = _apart(constraints, adjusted, used)
    return before / (NORMAL_MEDIAN * math.sqrt(2.0)), after / (NORMAL_MEDIAN * math.sqrt(2.0))


def _apart(constraints: Sequence[Constraint], adjusted: Adjusted, rows: Iterable[int]) -> list[tuple[float, float]]:
    """Median and 95 % of how far visits lie apart, m, NaN without any: horizontal before and after, then heights."""
    horizontal, heights = [np.empty((0, 2))], [np.empty((0, 2))]
    for row in rows:
        covariance = constraints[row].covariance
        shifts = np.column_stack([constraints[row].pose.position, adjusted.residuals[row, :3]])  # before and after
        variances, axes = np.linalg.eigh(covariance[:2, :2])
        horizontal.append((axes.T @ shifts[:2])[variances <= LARGEST_SIGMA**2])
        heights.append(shifts[2:][covariance[[2], [2]] <= LARGEST_SIGMA**2])
    sizes = (size for part in (horizontal, heights) for size in np.abs(np.concatenate(part)).T)
    return [(float(np.median(s)), float(np.percentile(s, 95.0))) if len(s) else (math.nan, math.nan) for s in sizes]


def connectivity_of_passes(
    passes: Passes, constraints: Sequence[Constraint], adjusted: Adjusted, prior_sigmas: NDArray[np.float64]
) -> list[PassConnectivity]:
    """Connectivity of each pass by constraints without a fault, which it was adjusted to."""
    used = list(compress(constraints, ~is_contradicted(adjusted.weights)))
    components = _components(len(passes), used)
    found = []
    for number, each in enumerate(passes):
        others = [other for other in range(len(passes)) if components[other] == components[number] and other != number]
        rows = _position_rows(passes, each.centre, number, adjusted)
        if others:  # relative to their mean
            rows = rows - np.mean([_position_rows(passes, each.centre, other, adjusted) for other in others], axis=0)
        covariance = adjusted.covariance(rows)
        if components[number] > 0 and others:
            names = ", ".join(passes.passes[other].name for other in others)
            words = f"{each.name} is connected to {names} only, not to the other passes"
        elif others:
            words = _open_direction(each.name, covariance, prior_sigmas[0])
        else:
            words = f"{each.name} ({each.n_points:,} points) cannot be connected to any other: it stays where it was"
        twist = adjusted.corrections.twist_at(each.centre, each.middle_time, number)
        n_constraints, sigma = sum(number in one.passes for one in used), np.sqrt(np.diag(covariance))
        found.append(PassConnectivity(each.name, n_constraints, components[number], twist[:3], twist[3:], sigma, words))
    return found


def _position_rows(passes: Passes, place: NDArray[np.float64], number: int, adjusted: Adjusted) -> NDArray[np.float64]:
    return adjusted.twist_rows(place, passes.passes[number].middle_time, number)[:3]


def _open_direction(name: str, covariance: NDArray[np.float64], prior_sigma: float) -> str:
    """Which direction the constraints leave open, if any, given a covariance (3, 3), m^2."""
    variances, axes = np.linalg.eigh(covariance)
    sigma = math.sqrt(variances[-1])
    if sigma <= OPEN_RATIO * prior_sigma:
        return ""
    x, y, z = axes[:, -1].tolist()
    along = "in height" if abs(z) > 0.7 else f"along {math.degrees(math.atan2(y, x)) % 180.0:.0f} degrees from +x"
    return f"{name} is not determined {along}: it stays near where it was there, to {sigma:.3f} m"


def datum_sigma(passes: Passes, adjusted: Adjusted) -> float:
    """Standard deviation of a common shift of all passes along a horizontal axis, m: only their priors limit it."""
    place = np.average([each.centre for each in passes], axis=0, weights=[each.n_points for each in passes])
    rows = np.mean([_position_rows(passes, place, number, adjusted)[:2] for number in range(len(passes))], axis=0)
    return math.sqrt(float(np.trace(adjusted.covariance(rows))) / 2.0)


def _components(n_passes: int, constraints: Sequence[Constraint]) -> list[int]:
    """Number of the connected component of each pass, the largest first."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = np.array([each.passes for each in constraints], np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n_passes, n_passes))
    _, labels = connected_components(graph, directed=False)
    order = np.argsort(-np.bincount(labels), kind="stable")
    return [int(component) for component in np.argsort(order)[labels]]


def files_there(folder: str | os.PathLike[str]) -> tuple[str, ...]:
    """Return the names of all files of the alignment in a folder, as it says itself; of its tables, if it says none."""
    try:
        named = json.loads(read_regular(Path(folder) / SUMMARY, LARGEST_SUMMARY))["files"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        named = []
    names = named if isinstance(named, list) else []
    return (*TABLES, *(name for name in names if isinstance(name, str)))


def write_tables(folder: Path, alignment: Alignment, summary: dict[str, object], files: Sequence[str]) -> None:
    """Write all tables, and the names of corrected `files`, which go when another alignment replaces this one."""
    for name, table in zip(TABLES[1:], (_passes, _pairs, _constraints, _corrections), strict=True):
        with (folder / name).open("w", encoding="utf-8", newline="") as stream:
            rows = (
                ["" if isinstance(value, float) and math.isnan(value) else value for value in row]
                for row in table(alignment)
            )
            csv.writer(stream, lineterminator="\n").writerows(rows)
    content = summary | {
        "n_passes": len(alignment.passes),
        "n_ties": len(alignment.constraints),
        "n_contradicted": alignment.n_contradicted,
        "n_refused": dict(sorted(alignment.refused.items())),
        "inflation": round(alignment.adjusted.inflation, 3),
        "sigma": {
            "of_pass_before": round(alignment.sigma_before, 5),
            "of_pass": round(alignment.sigma_of_pass, 5),
            "of_map": round(alignment.sigma_of_map, 5),
            "of_datum": round(alignment.sigma_of_datum, 5),
        },
        "words": [each.words for each in alignment.connectivity if each.words],
        "files": list(files),
    }
    text = json.dumps({"program": f"maxcon {__version__}", **content}, indent=2, allow_nan=False)
    (folder / SUMMARY).write_text(text + "\n", encoding="utf-8", newline="\n")


def _passes(alignment: Alignment) -> Iterable[Row]:
    yield [
        "pass", "name", "n_points", "start_s", "end_s", "n_ties", "group",
        *(f"{what}_{axis}" for what in ("shift", "turn_deg", "sigma") for axis in AXES), "words",
    ]  # fmt: skip
    for number, (each, found) in enumerate(zip(alignment.passes, alignment.connectivity, strict=True), 1):
        values = np.concatenate([found.shift, np.degrees(found.turn), found.sigma])
        yield [
            number, each.name, each.n_points, each.start, each.end, found.n_constraints, found.component + 1,
            *(round(value, 6) for value in values.tolist()), found.words,
        ]  # fmt: skip


def _pairs(alignment: Alignment) -> Iterable[Row]:
    sizes = ("horizontal_before", "horizontal_after", "height_before", "height_after")
    yield ["pass_a", "pass_b", "n_ties", "n_contradicted", *(f"{size}_{of}" for size in sizes for of in OF_SIZES)]
    for pair in alignment.pairs:
        values = pair.horizontal_before + pair.horizontal_after + pair.height_before + pair.height_after
        first, second = pair.passes
        yield [first + 1, second + 1, pair.n_constraints, pair.n_contradicted, *(round(value, 5) for value in values)]


def _constraints(alignment: Alignment) -> Iterable[Row]:
    yield [
        "x", "y", "pass_a", "pass_b", "time_a", "time_b", "share", "weight", "is_contradicted",
        *(f"{what}_{axis}" for what in ("before", "after", "sigma") for axis in AXES),
    ]  # fmt: skip
    weights, residuals = alignment.adjusted.weights, alignment.adjusted.residuals
    for each, residual, weight in zip(alignment.constraints, residuals, weights, strict=True):
        values = np.concatenate([each.pose.position, residual[:3], np.sqrt(np.diag(each.covariance)[:3])])
        yield [
            *(round(value, 3) for value in each.place[:2].tolist()), *(number + 1 for number in each.passes),
            *(round(time, 3) for time in each.times), round(each.ratio, 3), round(float(weight), 4),
            int(is_contradicted(weight)), *(round(value, 5) for value in values.tolist()),
        ]  # fmt: skip


def _corrections(alignment: Alignment) -> Iterable[Row]:
    """A row for each knot: how what was measured then, about there, is moved."""
    yield ["pass", "time", *(f"{what}{axis}" for what in ("", "shift_", "turn_deg_") for axis in AXES)]
    corrections = alignment.adjusted.corrections
    for number in range(len(corrections.centres)):
        first, end = corrections.firsts[number], corrections.firsts[number + 1]
        for knot in range(first, end):
            time = float(corrections.starts[number] + (knot - first) * corrections.steps[number])
            place = corrections.knot_centres[knot]
            twist = corrections.twist_at(place, time, number)
            twist[3:] = np.degrees(twist[3:])
            yield [number + 1, round(time, 3), *np.round(place, 3).tolist(), *np.round(twist, 6).tolist()]
