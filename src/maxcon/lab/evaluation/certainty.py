# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Whether stated certainty holds: coverage of sigmas, protection levels, risk against coverage, what samples prove."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError, OptionError

CONFIDENCE = 0.95


def clopper_pearson(n_found: int, n_epochs: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the ends, 0 to 1, of Clopper and Pearson's interval of the rate of an event; (0, 1) without epochs.

    At least as often as `confidence` (0 to 1) it holds the true rate, if epochs are independent (Clopper and Pearson,
    1934). OptionError for impossible counts.
    """
    if not 0 <= n_found <= n_epochs:
        raise OptionError(f"Expected from 0 to {n_epochs} of {n_epochs} epochs, got {n_found}.")
    if not 0.0 < confidence < 1.0:
        raise OptionError(f"Expected `confidence` above 0 and below 1, got {confidence}. The default is {CONFIDENCE}.")
    if n_epochs == 0:
        return 0.0, 1.0
    from scipy.stats import binomtest

    interval = binomtest(n_found, n_epochs).proportion_ci(confidence, method="exact")
    return float(interval.low), float(interval.high)


def upper_bound(n_found: int, n_epochs: int, confidence: float = CONFIDENCE) -> float:
    """Return the one-sided upper limit, 0 to 1, of the rate of an event found in `n_found` of `n_epochs`.

    With 95 % about 3 / n_epochs where it was never found: the upper end of `clopper_pearson`, with 1 - confidence
    beyond it and not half of that.
    """
    if not 0.5 < confidence < 1.0:
        raise OptionError(
            f"Expected `confidence` above 0.5 and below 1, got {confidence}. The default is {CONFIDENCE}."
        )
    return clopper_pearson(n_found, n_epochs, 2.0 * confidence - 1.0)[1]


def wilson_interval(
    n_successes: ArrayLike, n_trials: ArrayLike, confidence: float = CONFIDENCE
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower and upper ends, 0 to 1, of Wilson's intervals of success rates (Wilson, 1927).

    Successes and trials, shape (m,); NaN without trials. It is narrower than that of `clopper_pearson`: it holds the
    true rate that often on average over the rates, not for each.
    """
    from scipy.stats import binomtest

    ends = [
        binomtest(int(k), int(n)).proportion_ci(confidence, method="wilson") if n else (math.nan, math.nan)
        for k, n in zip(np.atleast_1d(n_successes), np.atleast_1d(n_trials), strict=True)
    ]
    low, high = np.array(ends, dtype=np.float64).reshape(-1, 2).T
    return low, high


def least_to_prove(rate: float, confidence: float = CONFIDENCE) -> int:
    """Return how many epochs, none of them bad, prove that at most a fraction `rate` is bad."""
    if not 0.0 < rate < 1.0:
        raise OptionError(f"Expected `rate` above 0 and below 1, got {rate}. None proves a rate of 0.")
    return math.ceil(math.log(1.0 - confidence) / math.log1p(-rate))


SIGMAS = (1.0, 2.0, 3.0)
PROMISED = tuple(math.erf(k / math.sqrt(2.0)) for k in SIGMAS)
"""Fractions of normally distributed errors within 1, 2 and 3 sigma: 68.3, 95.4 and 99.7 %."""
PROMISED_PLANE = tuple(1.0 - math.exp(-0.5 * k * k) for k in SIGMAS)
"""The same for two errors together, within ellipses of 1, 2 and 3 sigma: 39.3, 86.5 and 98.9 %."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """How many errors lie within 1, 2 and 3 of their predicted sigmas.

    n_epochs: how many errors have a predicted sigma.
    n_within: of these, how many are at most 1, 2 and 3 sigma.
    rms: of errors over sigmas: 1 where the sigmas hold; one gross error makes it large. NaN without errors.
    median: of absolute errors over sigmas: 0.67 where the sigmas hold, 1.18 for the length of two errors together.
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
        """Fractions of the errors within 1, 2 and 3 sigma, 0 to 1; NaN without epochs."""
        return tuple(n / self.n_epochs if self.n_epochs else math.nan for n in self.n_within)

    @property
    def intervals(self) -> tuple[tuple[float, float], ...]:
        """Ends of the 95 % interval of each fraction (`clopper_pearson`)."""
        return tuple(clopper_pearson(n, self.n_epochs) for n in self.n_within)


@dataclass(frozen=True, slots=True)
class MeanSquare:
    """Normalized squared errors of x and y (NEES, e' P^-1 e) over a drive, halved: 1 where the covariances P hold.

    n_epochs: how many epochs have a NEES.
    mean: of NEES / 2: above 1 where errors are larger than predicted; one gross error makes it large.
    median: of NEES over the one expected, 2 ln 2: 1 where most covariances hold.
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
        from scipy.stats import chi2

        low, high = chi2.interval(0.95, 2 * n)  # of the sum of the squares of n times two errors
        low, high = float(low) / (2 * n), float(high) / (2 * n)
        return cls(n, float(values.mean()) / 2.0, float(np.median(values)) / (2.0 * math.log(2.0)), low, high)


ALERT_LIMIT = 0.29
"""Largest error along and across that a car may have on local streets, m (Reid et al., arXiv 1906.01061)."""


@dataclass(frozen=True, slots=True)
class ProtectionCounts:
    """How many epochs lie in each region of the Stanford diagram.

    n_nominal: error <= protection level <= alert limit: used, and rightly so.
    n_misleading: level < error <= alert limit: used, although the error exceeds its level.
    n_hazardous: level <= alert limit < error: used, and nobody was warned.
    n_large: alert limit < level: not to be used, as the method itself says.
    n_withheld: there is no level: the answer is not trusted, or there is no answer.
    """

    n_nominal: int
    n_misleading: int
    n_hazardous: int
    n_large: int
    n_withheld: int

    @classmethod
    def of(cls, errors: ArrayLike, levels: ArrayLike, alert_limit: float = ALERT_LIMIT) -> "ProtectionCounts":
        """Count the epochs in each region, each by its worst direction.

        errors, levels: shape (n,) or (n, k), of each epoch in k directions, m; a level is NaN where there is none.
        alert_limit: largest error that is not dangerous, m.
        """
        wrong = np.abs(np.asarray(errors, dtype=np.float64))
        level = np.asarray(levels, dtype=np.float64)
        if wrong.shape != level.shape or wrong.ndim not in (1, 2):
            raise ArrayError(
                f"Expected errors and levels of one shape (n,) or (n, m), got {wrong.shape} and {level.shape}."
            )
        if not 0.0 < alert_limit < np.inf:
            raise OptionError(f"Expected `alert_limit` above 0 m, got {alert_limit}. The default is {ALERT_LIMIT}.")
        wrong, level = (values[:, None] if values.ndim == 1 else values for values in (wrong, level))
        has_level = np.asarray((np.isfinite(level) & np.isfinite(wrong)).all(axis=1))
        is_used = has_level & (np.where(has_level[:, None], level, np.inf) <= alert_limit).all(axis=1)
        is_hazardous = is_used & (wrong > alert_limit).any(axis=1)
        is_misleading = is_used & (wrong > level).any(axis=1) & ~is_hazardous
        return cls(
            n_nominal=int((is_used & ~is_misleading & ~is_hazardous).sum()),
            n_misleading=int(is_misleading.sum()),
            n_hazardous=int(is_hazardous.sum()),
            n_large=int((has_level & ~is_used).sum()),
            n_withheld=int((~has_level).sum()),
        )

    @property
    def n_epochs(self) -> int:
        """All epochs, used or not."""
        return self.n_used + self.n_unavailable

    @property
    def n_used(self) -> int:
        """Epochs whose protection level is within the alert limit."""
        return self.n_nominal + self.n_exceeded

    @property
    def n_unavailable(self) -> int:
        """Epochs that are not used: no level, or one beyond the alert limit."""
        return self.n_large + self.n_withheld

    @property
    def n_exceeded(self) -> int:
        """Epochs that are used and whose error exceeds the level, hazardous or not."""
        return self.n_misleading + self.n_hazardous

    @property
    def exceeded_bound(self) -> float:
        """Upper limit, with 95 % confidence, of the rate of exceeded levels among used epochs, 0 to 1."""
        return upper_bound(self.n_exceeded, self.n_used)

    @property
    def hazardous_bound(self) -> float:
        """Upper limit, with 95 % confidence, of the rate of hazardous epochs among used ones, 0 to 1."""
        return upper_bound(self.n_hazardous, self.n_used)


@dataclass(frozen=True, slots=True, eq=False)
class RiskCoverage:
    """How many answers are wrong among the k most trusted, for every k: the risk-coverage curve.

    n_epochs: all epochs, those without an answer too.
    n_accepted, n_wrong: shape (k,); how many answers are accepted, those of equal trust together, and how many of these
        are wrong.
    n_trusted, n_trusted_wrong: how many answers may be used as the method itself says, and how many of these are wrong.
    """

    n_epochs: int
    n_accepted: NDArray[np.int64]
    n_wrong: NDArray[np.int64]
    n_trusted: int
    n_trusted_wrong: int

    @classmethod
    def of(
        cls, is_right: ArrayLike, is_answer: ArrayLike, is_trusted: ArrayLike, runner_up: ArrayLike
    ) -> "RiskCoverage":
        """Sort answers by trust: first those that the method trusts, then the others, both by their second best.

        is_right, is_answer, is_trusted: shape (n,); whether an epoch is a success, has a pose, and may be used as the
            method says.
        runner_up: shape (n,); second best score over the best: lower is more trusted, NaN least.
        """
        right, answered, trusted = (np.asarray(each, dtype=bool) for each in (is_right, is_answer, is_trusted))
        rivals = np.asarray(runner_up, dtype=np.float64)
        if not right.shape == answered.shape == trusted.shape == rivals.shape or right.ndim != 1:
            raise ArrayError(
                f"Expected four arrays of one shape (n,), got {right.shape}, {answered.shape}, {trusted.shape}"
                f" and {rivals.shape}. Give one value per epoch."
            )
        doubt = np.column_stack([~trusted, np.where(np.isnan(rivals), np.inf, rivals)])[answered]
        order = np.lexsort((doubt[:, 1], doubt[:, 0]))
        is_last = np.ones(len(order), dtype=bool)
        is_last[:-1] = (doubt[order][1:] != doubt[order][:-1]).any(axis=1)
        trusted = trusted & answered
        return cls(
            n_epochs=len(right),
            n_accepted=(np.flatnonzero(is_last) + 1).astype(np.int64),
            n_wrong=np.cumsum(~right[answered][order])[is_last].astype(np.int64),
            n_trusted=int(trusted.sum()),
            n_trusted_wrong=int((trusted & ~right).sum()),
        )

    @property
    def shares(self) -> NDArray[np.float64]:
        """Accepted answers over all epochs, shape (k,), 0 to 1: the coverage."""
        return self.n_accepted / self.n_epochs

    @property
    def rates(self) -> NDArray[np.float64]:
        """Wrong answers over accepted ones, shape (k,), 0 to 1: the risk."""
        return self.n_wrong / self.n_accepted

    @property
    def trusted_interval(self) -> tuple[float, float]:
        """Ends of the 95 % interval of the rate of wrong answers among those trusted, 0 to 1."""
        return clopper_pearson(self.n_trusted_wrong, self.n_trusted)
