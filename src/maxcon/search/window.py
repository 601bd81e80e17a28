# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Window: which offsets of a search space are searched at a time."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from maxcon.search_space import SearchSpace

__all__ = ["Window"]


class Window(NamedTuple):
    """A rectangle of cells, the same at all headings, by the offsets of its first and last ones.

    Parameters
    ----------
    x_first, x_last, y_first, y_last : int
        Offsets, in voxels of the map; the last ones belong to it.
    """

    x_first: int
    x_last: int
    y_first: int
    y_last: int

    @classmethod
    def of(cls, space: SearchSpace) -> "Window":
        """All offsets of a space."""
        _, ny, nx = space.shape
        return cls(-(nx // 2), nx - 1 - nx // 2, -(ny // 2), ny - 1 - ny // 2)

    @classmethod
    def around(cls, cells: NDArray[np.int64], space: SearchSpace) -> "Window":
        """Return the smallest window that holds some cells (n, 3) of a space."""
        whole = cls.of(space)
        (y_first, x_first), (y_last, x_last) = cells[:, 1:].min(axis=0), cells[:, 1:].max(axis=0)
        return cls(
            whole.x_first + int(x_first),
            whole.x_first + int(x_last),
            whole.y_first + int(y_first),
            whole.y_first + int(y_last),
        )

    @property
    def shape(self) -> tuple[int, int]:
        """How many cells there are, (ny, nx)."""
        return self.y_last - self.y_first + 1, self.x_last - self.x_first + 1

    def first_cell(self, space: SearchSpace) -> tuple[int, int]:
        """Index (y, x) of its first cell in a space."""
        whole = Window.of(space)
        return self.y_first - whole.y_first, self.x_first - whole.x_first

    def bands(self, most_cells: int) -> Iterator["Window"]:
        """Yield bands of whole rows that make up this window, in order, each of at most `most_cells` or of one row."""
        _, nx = self.shape
        n_rows = max(1, most_cells // nx)
        for y_first in range(self.y_first, self.y_last + 1, n_rows):
            yield self._replace(y_first=y_first, y_last=min(y_first + n_rows - 1, self.y_last))
