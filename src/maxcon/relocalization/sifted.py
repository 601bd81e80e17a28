# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Sifted: the large cells of a map that the sieve leaves."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["HEADINGS", "STEP_DEG", "Sifted"]

STEP_DEG = 2.0
HEADINGS = np.radians(np.arange(-180.0, 180.0, STEP_DEG))
"""Headings that are tried, rad."""


@dataclass(frozen=True, slots=True)
class Sifted:
    """Cells in which a scan may have been taken.

    Parameters
    ----------
    cells : array, shape (n, 3), int64
        (heading, y, x): number in `HEADINGS`, index of the cell in the local frame. The highest count comes first, the
        first in index order where counts are the same.
    counts : array, shape (n,), int64
        Points that match.
    left_out : float
        Share of the highest count that none of the other cells reaches.
    n_counted : int
        Counts that this took, of cells and of bounds.
    """

    cells: NDArray[np.int64]
    counts: NDArray[np.int64]
    left_out: float
    n_counted: int = 0

    @classmethod
    def of(cls, cells: NDArray[np.int64], counts: NDArray[np.int64], left_out: float, n_counted: int = 0) -> "Sifted":
        """Put cells in order."""
        order = np.lexsort((cells[:, 2], cells[:, 1], cells[:, 0], -counts))
        return cls(cells[order], counts[order], left_out, n_counted)

    def __len__(self) -> int:
        return len(self.cells)
