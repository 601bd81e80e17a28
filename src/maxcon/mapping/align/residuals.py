# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Residuals: how far rounds lie apart before and after the adjustment, and the standard deviation that follows."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.align.matching import Tie
from maxcon.mapping.align.pose_graph import Adjusted

__all__ = ["PairResiduals", "is_contradicted", "pair_residuals", "remaining_sigma"]

LARGEST_SIGMA = 0.02
"""Directions in which a tie is less sure than this, m, are left out of residuals."""
LEAST_WEIGHT = 0.2
"""A tie that weighs less contradicts the others: it is some seven sigmas off."""
NORMAL_MEDIAN = 0.6745
"""Median of the absolute value of a standard normal deviate."""


@dataclass(frozen=True, slots=True)
class PairResiduals:
    """How far two rounds lie apart where they were matched.

    Parameters
    ----------
    rounds : tuple of 2 int
        Their numbers.
    n_ties : int
        Matched pairs of visits.
    n_contradicted : int
        Of these, how many contradict the others.
    horizontal_before, horizontal_after : tuple of 2 float
        Median and 95 % of the distances along horizontal directions in which a tie is sure, m; NaN without any.
    height_before, height_after : tuple of 2 float
        The same of heights, m.
    """

    rounds: tuple[int, int]
    n_ties: int
    n_contradicted: int
    horizontal_before: tuple[float, float]
    horizontal_after: tuple[float, float]
    height_before: tuple[float, float]
    height_after: tuple[float, float]


def is_contradicted(weight: float) -> bool:
    """Whether the other ties contradict one of this weight."""
    return weight < LEAST_WEIGHT


def pair_residuals(ties: Sequence[Tie], adjusted: Adjusted) -> list[PairResiduals]:
    """Residuals of all pairs of rounds that have ties, in order of their numbers."""
    numbers: dict[tuple[int, int], list[int]] = {}
    for number, tie in enumerate(ties):
        numbers.setdefault(tie.rounds, []).append(number)
    before = np.array([tie.pose.position for tie in ties]).reshape(-1, 3)
    return [
        _pair(pair, [ties[i] for i in rows], before[rows], adjusted.residuals[rows], adjusted.weights[rows])
        for pair, rows in sorted(numbers.items())
    ]


def _pair(
    rounds: tuple[int, int],
    ties: Sequence[Tie],
    before: NDArray[np.float64],
    after: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> PairResiduals:
    is_used = [not is_contradicted(weight) for weight in weights.tolist()]
    shares = [_along_sure(ties, shifts, is_used) for shifts in (before, after[:, :3])]
    return PairResiduals(
        rounds, len(ties), len(ties) - sum(is_used),
        _sizes(shares[0][0]), _sizes(shares[1][0]), _sizes(shares[0][1]), _sizes(shares[1][1]),
    )  # fmt: skip


def _along_sure(
    ties: Sequence[Tie], shifts: NDArray[np.float64], is_used: Sequence[bool]
) -> tuple[list[float], list[float]]:
    """Shifts (n, 3) of ties along those horizontal directions that each tie determines, and those of heights, m."""
    horizontal, heights = [], []
    for tie, shift, used in zip(ties, shifts, is_used, strict=True):
        if not used:
            continue
        variances, axes = np.linalg.eigh(tie.covariance[:2, :2])
        horizontal += (axes.T @ shift[:2])[variances <= LARGEST_SIGMA**2].tolist()
        if tie.covariance[2, 2] <= LARGEST_SIGMA**2:
            heights.append(float(shift[2]))
    return horizontal, heights


def _sizes(values: Sequence[float]) -> tuple[float, float]:
    """Median and 95 % of absolute values; NaN without any."""
    if not values:
        return math.nan, math.nan
    sizes = np.abs(values)
    return float(np.median(sizes)), float(np.percentile(sizes, 95.0))


def remaining_sigma(ties: Sequence[Tie], adjusted: Adjusted, *, is_after: bool) -> float:
    """Standard deviation of one round's position relative to the others, along a horizontal axis, m; NaN without ties.

    From the median difference of pairs before or after the adjustment: wrong matches hardly change a median.
    """
    shifts = adjusted.residuals[:, :3] if is_after else np.array([tie.pose.position for tie in ties]).reshape(-1, 3)
    used = [not is_contradicted(weight) for weight in adjusted.weights.tolist()]
    median, _ = _sizes(_along_sure(ties, shifts, used)[0])
    return median / (NORMAL_MEDIAN * math.sqrt(2.0))
