# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Windows are rectangles of the cells of a space, and bands part them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from maxcon import SearchSpace
from maxcon.search.window import Window


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
        assert ny * nx <= most_cells or ny == 1
