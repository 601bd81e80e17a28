# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Whether errors are as large as they were predicted to be."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maxcon.errors import ArrayError
from maxcon.lab.evaluation.proportions import clopper_pearson

__all__ = ["PROMISED", "PROMISED_PLANE", "Coverage", "MeanSquare"]

SIGMAS = (1.0, 2.0, 3.0)
PROMISED = tuple(math.erf(k / math.sqrt(2.0)) for k in SIGMAS)
"""Shares of normally distributed errors within 1, 2 and 3 sigma: 68.3, 95.4 and 99.7 %."""
PROMISED_PLANE = tuple(1.0 - math.exp(-0.5 * k * k) for k in SIGMAS)
"""The same for two errors together, within ellipses of 1, 2 and 3 sigma: 39.3, 86.5 and 98.9 %."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """How many errors lie within 1, 2 and 3 of their predicted sigmas.

    n_epochs: how many errors have a predicted sigma.
    n_within: of these, how many are at most 1, 2 and 3 sigma.
    rms: root of the mean square of errors over sigmas: 1 where the sigmas hold; one gross error makes it large. NaN
        without errors.
    median: median of absolute errors over sigmas: 0.67 where the sigmas hold, 1.18 for the length of two errors
        together. NaN without errors.
    """

    n_epochs: int
    n_within: tuple[int, ...]
    rms: float
    median: float

    @classmethod
    def of(cls, errors: ArrayLike, sigmas: ArrayLike) -> "Coverage":
        """Count errors, shape (n,), within their sigmas, shape (n,), same unit; NaN in either is left out."""
        wrong, predicted = np.asarray(errors, dtype=np.float64), np.asarray(sigmas, dtype=np.float64)
        if wrong.shape != predicted.shape or wrong.ndim != 1:
            raise ArrayError(f"Expected errors and sigmas of one shape (n,), got {wrong.shape} and {predicted.shape}.")
        is_known = np.isfinite(wrong) & np.isfinite(predicted)
        if (predicted[is_known] <= 0.0).any():
            raise ArrayError(
                f"Expected sigmas above 0, got {predicted[is_known].min():g}. Use NaN where none is known."
            )
        ratios = np.abs(wrong[is_known]) / predicted[is_known]
        if len(ratios) == 0:
            return cls(0, (0,) * len(SIGMAS), math.nan, math.nan)
        n_within = tuple(int((ratios <= k).sum()) for k in SIGMAS)
        return cls(len(ratios), n_within, float(np.sqrt((ratios**2).mean())), float(np.median(ratios)))

    @property
    def shares(self) -> tuple[float, ...]:
        """Shares of the errors within 1, 2 and 3 sigma, 0 to 1; NaN without epochs."""
        return tuple(n / self.n_epochs if self.n_epochs else math.nan for n in self.n_within)

    @property
    def intervals(self) -> tuple[tuple[float, float], ...]:
        """Ends of the 95 % interval of each share (`clopper_pearson`)."""
        return tuple(clopper_pearson(n, self.n_epochs) for n in self.n_within)


@dataclass(frozen=True, slots=True)
class MeanSquare:
    """Normalized squared errors of x and y (NEES, e' P^-1 e) over a drive, halved: 1 where the covariances P hold.

    n_epochs: how many epochs have a NEES.
    mean: mean of NEES / 2: above 1 where errors are larger than predicted; one gross error makes it large. NaN without
        epochs.
    median: median of NEES over the one expected, 2 ln 2: 1 where most covariances hold. NaN without epochs.
    low, high: if the covariances held, 95 % of the means over so many epochs would lie between these.
    """

    n_epochs: int
    mean: float
    median: float
    low: float
    high: float

    @classmethod
    def of(cls, squares: ArrayLike) -> "MeanSquare":
        """Summarize normalized squared errors of x and y, shape (n,); NaN is left out."""
        values = np.asarray(squares, dtype=np.float64)
        values = values[np.isfinite(values)]
        n = len(values)
        if n == 0:
            return cls(0, math.nan, math.nan, math.nan, math.nan)
        from scipy.special import chdtri

        # The sum of n squares of two errors has a chi-square distribution of 2 n degrees of freedom.
        low, high = (float(chdtri(2 * n, above)) / (2 * n) for above in (0.975, 0.025))
        return cls(n, float(values.mean()) / 2.0, float(np.median(values)) / (2.0 * math.log(2.0)), low, high)
