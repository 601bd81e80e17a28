# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Protection levels against true errors: the regions of the Stanford diagram."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from maxcon.errors import ArrayError, OptionError
from maxcon.lab.evaluation.proportions import upper_bound

__all__ = ["ALERT_LIMIT", "ProtectionCounts"]

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
        """Count the epochs in each region.

        errors: shape (n,) or (n, k); of each epoch, in k directions, in metres; the sign does not matter. An epoch
            counts by its worst direction.
        levels: shape as errors; protection levels, in metres; NaN where there is none.
        alert_limit: largest error that is not dangerous, in metres.
        """
        wrong = np.abs(np.asarray(errors, dtype=np.float64))
        level = np.asarray(levels, dtype=np.float64)
        if wrong.shape != level.shape or wrong.ndim not in (1, 2):
            raise ArrayError(
                f"Expected errors and levels of one shape (n,) or (n, m), got {wrong.shape} and {level.shape}."
            )
        if not 0.0 < alert_limit < np.inf:
            raise OptionError(f"Expected `alert_limit` above 0 m, got {alert_limit}. The default is {ALERT_LIMIT}.")
        if wrong.ndim == 1:
            wrong, level = wrong[:, None], level[:, None]
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
