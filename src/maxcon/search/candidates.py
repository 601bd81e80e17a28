# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Candidates: cells that may be looked for, and what each scores at most."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.objectives import Scores

__all__ = ["Candidates"]


@dataclass(frozen=True, slots=True)
class Candidates:
    """Cells that may be looked for, shape (n, 3), and what they score at most, (n,)."""

    cells: NDArray[np.int64]
    upper: Scores

    @classmethod
    def none(cls) -> "Candidates":
        """No cell."""
        return cls(np.empty((0, 3), np.int64), np.empty(0))

    def joined(self, other: "Candidates") -> "Candidates":
        """These and others."""
        return Candidates(
            np.concatenate([self.cells, other.cells]), np.concatenate([self.upper, other.upper])
        )

    def below(self, upper: Scores) -> "Candidates":
        """The same cells, also bounded by this."""
        return Candidates(self.cells, np.minimum(self.upper, upper))

    def __len__(self) -> int:
        return len(self.cells)

    def __getitem__(self, which: slice | NDArray[np.bool_] | NDArray[np.int64]) -> "Candidates":
        return Candidates(self.cells[which], self.upper[which])
