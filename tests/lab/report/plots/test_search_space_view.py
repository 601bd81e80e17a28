# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import numpy as np
import pytest

import maxcon
from maxcon.plotting.search_space_view import SearchSpaceView, chosen_headings


class MyObjective:
    def score(self, moments):
        return moments[..., 0] - 3.0


@pytest.mark.parametrize("n_headings", [1, 3, 5, 9])
def test_few_headings_are_all_drawn(n_headings):
    for best in range(n_headings):
        assert chosen_headings(n_headings, best) == list(range(n_headings))


@pytest.mark.parametrize("n_headings", [11, 13, 17, 61, 181])
def test_of_many_headings_nine_are_drawn_in_even_steps_with_the_best(n_headings):
    for best in range(n_headings):
        chosen = chosen_headings(n_headings, best)
        assert len(chosen) == 9
        assert best in chosen
        assert len(set(np.diff(chosen))) == 1
        assert min(chosen) >= 0 and max(chosen) < n_headings


def test_colours_run_from_nothing_to_the_best(epoch, space):
    view = SearchSpaceView(epoch.accumulate(space), maxcon.Helmert())
    assert view.limits == (0.0, view.scores[view.best])
    assert SearchSpaceView(view.accumulator, MyObjective()).limits[0] < 0.0
    empty = SearchSpaceView(maxcon.Accumulator(np.zeros((*space.shape, 4)), space, epoch.prior), maxcon.Count())
    assert empty.limits == (0.0, 1.0)
    assert not empty.has_best


def test_reference_is_marked_at_its_offset_in_the_nearest_heading(epoch, space):
    view = SearchSpaceView(epoch.accumulate(space), maxcon.Helmert())
    assert view.offset(epoch.reference) == pytest.approx((0.18, -0.24))
    assert view.heading_nearest(epoch.reference, range(5)) == 3
    assert view.best == space.nearest_cell(epoch.reference, epoch.prior)
