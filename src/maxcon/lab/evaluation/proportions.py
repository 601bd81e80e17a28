# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What a sample of epochs proves of the rate of an event: intervals that hold for small samples, too."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import OptionError

__all__ = ["clopper_pearson", "least_to_prove", "upper_bound", "wilson_interval"]

CONFIDENCE = 0.95
NORMAL_QUANTILE_975 = 1.959963984540054


def clopper_pearson(n_found: int, n_epochs: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the ends, 0 to 1, of Clopper and Pearson's confidence interval of a rate; (0, 1) where there is no epoch.

    n_found, n_epochs: in how many of how many epochs the event was found.
    confidence: above 0, below 1: at least so often the interval holds the true rate.

    It holds the rates at which finding at most `n_found`, and finding at least `n_found`, both have a probability of
    (1 - confidence) / 2 or more (Clopper and Pearson, 1934): its ends are quantiles of beta distributions. Epochs are
    taken for independent.
    """
    _check(n_found, n_epochs, confidence)
    from scipy.special import betaincinv

    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if n_found == 0 else float(betaincinv(n_found, n_epochs - n_found + 1, tail))
    high = 1.0 if n_found == n_epochs else float(betaincinv(n_found + 1, n_epochs - n_found, 1.0 - tail))
    return low, high


def upper_bound(n_found: int, n_epochs: int, confidence: float = CONFIDENCE) -> float:
    """Return the one-sided upper limit, 0 to 1, of the rate of an event found in `n_found` of `n_epochs`.

    With 95 % about 3 / n_epochs where it was never found. The upper end of `clopper_pearson`, with 1 - confidence
    beyond it and not half of that.
    """
    if not 0.5 < confidence < 1.0:
        raise OptionError(
            f"Expected `confidence` above 0.5 and below 1, got {confidence}. The default is {CONFIDENCE}."
        )
    return clopper_pearson(n_found, n_epochs, 2.0 * confidence - 1.0)[1]


def wilson_interval(
    n_successes: ArrayLike, n_trials: ArrayLike, quantile: float = NORMAL_QUANTILE_975
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower and upper ends of Wilson's interval of a success rate, 0 to 1.

    n_successes, n_trials: shape (m,); successes and trials of each rate.
    quantile: z of the normal distribution; the default makes it an interval of 95 %.
    Returns low, high: shape (m,); NaN where there was no trial.

    (p + z^2 / 2n -+ z sqrt(p (1 - p) / n + z^2 / 4n^2)) / (1 + z^2 / n), p = successes / n (Wilson, 1927). Unlike
    p -+ z sqrt(p (1 - p) / n) it does not shrink to nothing where all epochs succeed. It is
    narrower than `clopper_pearson`: it holds the true rate that often on average over the rates, not for each.
    """
    n = np.asarray(n_trials, dtype=np.float64)
    n = np.where(n > 0.0, n, np.nan)
    rate = np.asarray(n_successes, dtype=np.float64) / n
    z2 = quantile * quantile
    center = rate + z2 / (2.0 * n)
    half = quantile * np.sqrt(rate * (1.0 - rate) / n + z2 / (4.0 * n * n))
    low, high = (center - half) / (1.0 + z2 / n), (center + half) / (1.0 + z2 / n)
    return np.clip(low, 0.0, 1.0), np.clip(high, 0.0, 1.0)


def least_to_prove(rate: float, confidence: float = CONFIDENCE) -> int:
    """Return how many epochs, none of them bad, prove that the rate of bad ones is at most `rate`, 0 to 1."""
    if not 0.0 < rate < 1.0:
        raise OptionError(f"Expected `rate` above 0 and below 1, got {rate}. None proves a rate of 0.")
    return math.ceil(math.log(1.0 - confidence) / math.log1p(-rate))


def _check(n_found: int, n_epochs: int, confidence: float) -> None:
    if not 0 <= n_found <= n_epochs:
        raise OptionError(f"Expected from 0 to {n_epochs} of {n_epochs} epochs, got {n_found}.")
    if not 0.0 < confidence < 1.0:
        raise OptionError(f"Expected `confidence` above 0 and below 1, got {confidence}. The default is 0.95.")
