# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Windows are rectangles of cells, which bands part; a grid has the numbers of its cells under their indices."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from searches import SEEDS

from maxcon import SearchSpace
from maxcon.search.scored_cells import Candidates, CellGrid
from maxcon.search.space import Window


def cells_of(window, space):
    """(y, x) of the cells of a window, by their offsets."""
    steps = np.rint(space.offsets / space.cell).astype(int)
    is_x = (steps >= window.x_first) & (steps <= window.x_last)
    is_y = (steps >= window.y_first) & (steps <= window.y_last)
    return [(y, x) for y in np.flatnonzero(is_y) for x in np.flatnonzero(is_x)]


SPACES = st.integers(0, 12).map(lambda n: SearchSpace(n * 0.1, 0.1, 1.0, 0.5))


@given(SPACES)
def test_the_window_of_a_space_has_all_its_cells(space):
    window = Window.of(space)
    assert window.shape == space.shape[1:]
    assert window.first_cell(space) == (0, 0)
    assert len(cells_of(window, space)) == space.n_cells // space.shape[0]


@given(SPACES, st.lists(st.tuples(st.floats(0.0, 0.999), st.floats(0.0, 0.999)), min_size=1, max_size=5))
def test_the_window_around_cells_is_the_smallest(space, places):
    cells = np.array([(0, int(y * space.shape[1]), int(x * space.shape[2])) for y, x in places])
    window = Window.around(cells, space)
    got = np.array(cells_of(window, space))
    assert (got.min(axis=0) == cells[:, 1:].min(axis=0)).all()
    assert (got.max(axis=0) == cells[:, 1:].max(axis=0)).all()
    assert window.first_cell(space) == tuple(got[0])
    assert window.shape == tuple(np.ptp(got, axis=0) + 1)


@given(SPACES, st.integers(1, 700))
def test_bands_part_a_window(space, most_cells):
    window = Window.of(space)
    bands = list(window.bands(most_cells))
    assert [cell for band in bands for cell in cells_of(band, space)] == cells_of(window, space)
    for band in bands:
        ny, nx = band.shape
        assert ny == 1 or (ny > 1 and ny * nx <= most_cells)


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
    return numbers, CellGrid(headings, window.first_cell(SPACE), part), cells


@given(SEEDS, st.sampled_from([0, 1, 30]), st.sampled_from([np.int32, np.int64, np.float64]))
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


def test_candidates_join_and_keep_the_lower_of_two_bounds():
    some = Candidates(np.array([[0, 1, 2], [3, 4, 5]]), np.array([7.0, 8.0]))
    joined = Candidates.none().joined(some).joined(Candidates.none())
    assert (joined.cells.tolist(), joined.upper.tolist()) == (some.cells.tolist(), some.upper.tolist())
    assert (len(Candidates.none()), len(joined), joined.cells.dtype) == (0, 2, np.int64)
    lower = some.below(np.array([9.0, 6.0]))
    assert (lower.cells.tolist(), lower.upper.tolist()) == (some.cells.tolist(), [7.0, 6.0])
    second = some[some.upper > 7.0]
    assert (second.cells.tolist(), second.upper.tolist()) == ([[3, 4, 5]], [8.0])
