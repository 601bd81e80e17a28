# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What is gained by leaving out the answers that are trusted the least."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maxcon.errors import ArrayError
from maxcon.lab.evaluation.proportions import clopper_pearson

__all__ = ["RiskCoverage"]


@dataclass(frozen=True)
class RiskCoverage:
    """How many answers are wrong among the k most trusted, for every k: the risk-coverage curve.

    n_epochs: all epochs, those without an answer too.
    n_accepted: shape (k,); int64, rising: how many answers are accepted, one step per degree of trust; those of equal
        trust are accepted together.
    n_wrong: shape (k,); int64: how many of the accepted ones are wrong.
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
        """Sort answers by trust: first those that the method trusts, then the others, both by their runner-up.

        is_right, is_answer, is_trusted: shape (n,); bool: whether each epoch is a success, has a pose, and whether the
            method says that it may be used.
        runner_up: shape (n,); score of the next best place over that of the answer: lower is more trusted. NaN, where a
            method has none, is trusted less than any number.
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
