# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Outcome of an alignment: how far passes lie apart before and after, how sure that is, and what is left open."""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.align.passes import Passes
from maxcon.mapping.align.pose_graph import Adjusted, Georeference
from maxcon.mapping.align.visits import Constraint

LARGEST_SIGMA = 0.02
"""Directions in which a constraint is less sure than this, m, are left out of residuals."""
LEAST_WEIGHT = 0.2
"""A constraint that weighs less contradicts the others: it is some seven sigmas off."""
NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a standard normal deviate."""
OPEN_RATIO = 0.5
"""A pass is open along a direction in which the ratio of its standard deviation to its prior's exceeds this."""


@dataclass(frozen=True, slots=True)
class PairResiduals:
    """How far two passes lie apart where they were matched."""

    passes: tuple[int, int]  # Their numbers
    n_constraints: int  # Matched pairs of visits
    n_contradicted: int  # Of these, how many contradict the others
    # Median and 95 % of the distances along horizontal directions in which a constraint is sure, m; NaN without
    # any
    horizontal_before: tuple[float, float]
    horizontal_after: tuple[float, float]
    # The same of heights, m
    height_before: tuple[float, float]
    height_after: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class PassConnectivity:
    """The correction of one pass, and how well the other passes determine it."""

    name: str  # Name of the pass
    n_constraints: int  # Constraints of its visits that the others do not contradict
    component: int  # Number of its connected component in the graph of constraints; 0 is the largest one
    shift: NDArray[np.float64]  # (3,): By which its centre was moved, in the middle of its time, m
    turn: NDArray[np.float64]  # (3,): Rotation vector by which it was turned there, rad
    # (3,): Standard deviations of that position along x, y and z, m, relative to the mean of the others of its
    # component
    sigma: NDArray[np.float64]
    words: str  # What the constraints leave open, for the user; empty where it is nothing


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """The outcome of an alignment.

    passes: all passes.
    constraints: matched pairs of visits that are used.
    refused: number of the other matched pairs, by the reason why they are not used (`Constraint.fault`).
    adjusted: corrections of the passes, and what remains.
    connectivity: for each pass: its correction, how sure that is, and which passes it is connected to.
    sigma_before, sigma_of_pass: standard deviation of one pass's position relative to the others, along a horizontal
        axis, m, before and after.
    sigma_of_map: standard deviation of a map of all passes, that is of their mean, along a horizontal axis, m: from the
        differences that remain between passes and their mean drift, which no match reveals; without `sigma_of_datum`.
    sigma_of_datum: standard deviation of a shift common to all passes, m: only their priors, not their matches,
        determine it.
    """

    passes: Passes
    constraints: tuple[Constraint, ...]
    refused: Mapping[str, int]
    adjusted: Adjusted
    connectivity: tuple[PassConnectivity, ...]
    sigma_before: float
    sigma_of_pass: float
    sigma_of_map: float
    sigma_of_datum: float

    @classmethod
    def of(
        cls, passes: Passes, matched: Sequence[Constraint], adjusted: Adjusted, georeference: Georeference
    ) -> "Alignment":
        """Outcome of an adjustment to those matched pairs that have no fault."""
        constraints, refused = tuple(each for each in matched if not each.fault), defaultdict[str, int](int)
        for each in matched:
            if each.fault:
                refused[each.fault] += 1
        connectivity = tuple(connectivity_of_passes(passes, constraints, adjusted, georeference))
        before, after = (remaining_sigma(constraints, adjusted, is_after=is_after) for is_after in (False, True))
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
    is_used = ~is_contradicted(adjusted.weights)
    residuals = []
    for passes, rows in sorted(pairs.items()):
        used = [row for row in rows if is_used[row]]
        before, after = (_along_sure(constraints, shifts, used) for shifts in _shifts(constraints, adjusted))
        sizes = (before[0], after[0], before[1], after[1])
        residuals.append(PairResiduals(passes, len(rows), len(rows) - len(used), *map(_median_and_95, sizes)))
    return residuals


def remaining_sigma(constraints: Sequence[Constraint], adjusted: Adjusted, *, is_after: bool) -> float:
    """Standard deviation of one pass's position relative to the others, along a horizontal axis, m.

    NaN without constraints. From the median difference of pairs before or after the adjustment: wrong matches hardly
    change a median.
    """
    shifts, used = _shifts(constraints, adjusted)[is_after], np.flatnonzero(~is_contradicted(adjusted.weights))
    median, _ = _median_and_95(_along_sure(constraints, shifts, used.tolist())[0])
    return median / (NORMAL_MEDIAN * math.sqrt(2.0))


def _shifts(constraints: Sequence[Constraint], adjusted: Adjusted) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shifts between visits before and after the adjustment, (n, 3) each, m."""
    return np.array([each.pose.position for each in constraints]).reshape(-1, 3), adjusted.residuals[:, :3]


def _along_sure(
    constraints: Sequence[Constraint], shifts: NDArray[np.float64], rows: Iterable[int]
) -> tuple[list[float], list[float]]:
    """Shifts of some rows along those horizontal directions that each constraint determines, and of heights, m."""
    horizontal, heights = [], []
    for row in rows:
        covariance, shift = constraints[row].covariance, shifts[row]
        variances, axes = np.linalg.eigh(covariance[:2, :2])
        horizontal += (axes.T @ shift[:2])[variances <= LARGEST_SIGMA**2].tolist()
        if covariance[2, 2] <= LARGEST_SIGMA**2:
            heights.append(float(shift[2]))
    return horizontal, heights


def _median_and_95(values: Sequence[float]) -> tuple[float, float]:
    """Median and 95 % of absolute values; NaN without any."""
    if not values:
        return math.nan, math.nan
    sizes = np.abs(values)
    return float(np.median(sizes)), float(np.percentile(sizes, 95.0))


def connectivity_of_passes(
    passes: Passes, constraints: Sequence[Constraint], adjusted: Adjusted, georeference: Georeference
) -> list[PassConnectivity]:
    """Connectivity of each pass by constraints without a fault, which it was adjusted to."""
    is_used = ~is_contradicted(adjusted.weights)
    used = [each for each, use in zip(constraints, is_used.tolist(), strict=True) if use]
    components = _components(len(passes), used)
    found = []
    for number, each in enumerate(passes):
        others = [other for other, component in enumerate(components) if component == components[number]]
        others.remove(number)
        rows = adjusted.twist_rows(each.centre, each.middle_time, number)[:3]
        if others:  # relative to their mean
            rows = rows - np.mean([_rows_of_other(passes, each.centre, other, adjusted) for other in others], axis=0)
        covariance = adjusted.covariance(rows)
        if components[number] > 0 and others:
            names = ", ".join(passes.passes[other].name for other in others)
            words = f"{each.name} is connected to {names} only, not to the other passes"
        elif others:
            words = _open_direction(each.name, covariance, georeference)
        else:
            words = f"{each.name} ({each.n_points:,} points) cannot be connected to any other: it stays where it was"
        twist = adjusted.corrections.twist_at(each.centre, each.middle_time, number)
        n_constraints, sigma = sum(number in one.passes for one in used), np.sqrt(np.diag(covariance))
        found.append(PassConnectivity(each.name, n_constraints, components[number], twist[:3], twist[3:], sigma, words))
    return found


def _rows_of_other(passes: Passes, place: NDArray[np.float64], other: int, adjusted: Adjusted) -> NDArray[np.float64]:
    return adjusted.twist_rows(place, passes.passes[other].middle_time, other)[:3]


def _open_direction(name: str, covariance: NDArray[np.float64], georeference: Georeference) -> str:
    """Which direction the constraints leave open, if any, given a covariance (3, 3), m^2."""
    variances, axes = np.linalg.eigh(covariance)
    sigma = math.sqrt(variances[-1])
    if sigma <= OPEN_RATIO * georeference.sigma:
        return ""
    x, y, z = axes[:, -1].tolist()
    along = "in height" if abs(z) > 0.7 else f"along {math.degrees(math.atan2(y, x)) % 180.0:.0f} degrees from +x"
    return f"{name} is not determined {along}: it stays near where it was there, to {sigma:.3f} m"


def datum_sigma(passes: Passes, adjusted: Adjusted) -> float:
    """Standard deviation of a common shift of all passes along a horizontal axis, m: only their priors limit it."""
    place = np.average([each.centre for each in passes], axis=0, weights=[each.n_points for each in passes])
    rows = np.mean([_rows_of_other(passes, place, number, adjusted)[:2] for number in range(len(passes))], axis=0)
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
