# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What so many epochs can prove of a rate: intervals that hold for small samples too."""

import math

from maxcon.errors import OptionError

__all__ = ["clopper_pearson", "least_to_prove", "upper_bound"]

CONFIDENCE = 0.95


def clopper_pearson(n_found: int, n_epochs: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the ends of Clopper and Pearson's interval of a rate, 0 to 1; 0 and 1 where there is no epoch.

    Parameters
    ----------
    n_found, n_epochs : int
        The rate is the one over the other.
    confidence : float
        Above 0, below 1: the interval holds the true rate at least so often.

    Notes
    -----
    The rates at which at most `n_found`, and at least so many, each have a probability of no less than
    (1 - confidence) / 2 (Clopper and Pearson, 1934): quantiles of beta distributions. Epochs count as independent.
    """
    _check(n_found, n_epochs, confidence)
    from scipy.special import betaincinv

    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if n_found == 0 else float(betaincinv(n_found, n_epochs - n_found + 1, tail))
    high = 1.0 if n_found == n_epochs else float(betaincinv(n_found + 1, n_epochs - n_found, 1.0 - tail))
    return low, high


def upper_bound(n_found: int, n_epochs: int, confidence: float = CONFIDENCE) -> float:
    """Return the largest rate, 0 to 1, that so many of so many epochs leave possible; about 3 / n for none of n.

    The upper end of `clopper_pearson` with all that is left of the confidence on its side.
    """
    return clopper_pearson(n_found, n_epochs, 2.0 * confidence - 1.0)[1]


def least_to_prove(rate: float, confidence: float = CONFIDENCE) -> int:
    """Return how many epochs, none of them bad, prove that bad ones are no more frequent than a rate, 0 to 1."""
    if not 0.0 < rate < 1.0:
        raise OptionError(f"Expected `rate` above 0 and below 1, got {rate}. None proves a rate of 0.")
    return math.ceil(math.log(1.0 - confidence) / math.log1p(-rate))


def _check(n_found: int, n_epochs: int, confidence: float) -> None:
    if not 0 <= n_found <= n_epochs:
        raise OptionError(f"Expected from 0 to {n_epochs} of {n_epochs} epochs, got {n_found}.")
    if not 0.0 < confidence < 1.0:
        raise OptionError(
            f"Expected `confidence` above 0 and below 1, got {confidence}. The default is 0.95."
        )
