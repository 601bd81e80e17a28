# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""A grid has the numbers of its cells under their indices in the space."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from maxcon import SearchSpace
from maxcon.search.cell_grid import CellGrid
from maxcon.search.window import Window

SPACE = SearchSpace(0.6, 0.1, 2.0, 0.5)


def some_grid(seed, n_values, dtype):
    """Numbers of all cells of the space, and the grid of a window at some headings."""
    rng = np.random.default_rng(seed)
    numbers = rng.integers(-n_values, n_values, SPACE.shape, endpoint=True).astype(dtype)
    headings = np.flatnonzero(rng.random(SPACE.shape[0]) < 0.5)
    headings = headings if len(headings) else np.array([3])
    window = Window.around(rng.integers(0, SPACE.shape, (2, 3)), SPACE)
    (y, x), (ny, nx) = window.first_cell(SPACE), window.shape
    part = numbers[headings, y : y + ny, x : x + nx]
    cells = np.array([(h, y + j, x + i) for h in headings for j in range(ny) for i in range(nx)])
    return numbers, CellGrid.of(SPACE, headings, window, part), cells


@given(st.integers(0, 2**32), st.sampled_from([0, 1, 30]), st.sampled_from([np.int32, np.int64, np.float64]))
def test_numbers_have_the_indices_of_their_cells(seed, n_values, dtype):
    numbers, grid, cells = some_grid(seed, n_values, dtype)
    of_cells = numbers[tuple(cells.T)]
    assert (grid.at(cells) == of_cells).all()
    assert grid.first_highest().tolist() == [cells[np.argmax(of_cells)].tolist()]
    for least in (-n_values - 1, 0, 0.5, n_values, n_values + 1):
        reached, highest = grid.reaching(least)
        assert (reached == cells[of_cells >= least]).all()
        others = of_cells[of_cells < least]
        assert highest == (others.max() if len(others) else None)
    for n_cells in (1, 5, len(cells), len(cells) + 1):
        found = grid.highest(n_cells)
        assert len(np.unique(found, axis=0)) == min(n_cells, len(cells))
        assert (np.sort(grid.at(found)) == np.sort(of_cells)[-n_cells:]).all()
