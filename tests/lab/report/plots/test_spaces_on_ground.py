# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import maxcon
from maxcon.lab.report.plots.search_spaces import apart, highest_of_blocks, window_around
from maxcon.plotting.canvas.from_above import Window

# 6 m by 6 m, as the paper's, in few cells.
SPACE = maxcon.SearchSpace(half_width=3.0, cell=0.5, heading_half_width_deg=0.0)
EVERYWHERE = Window.around(0.0, 0.0, 1000.0)


def at(x, y=0.0, space=SPACE):
    pose = maxcon.Pose(x, y, 0.0, 0.0, 0.0, 0.0)
    return maxcon.Accumulator(np.zeros((*space.shape, 4)), space, pose)


def test_an_epoch_alone_is_drawn_75_m_wide_and_flat():
    assert window_around(at(10.0, 20.0), []) == pytest.approx((-27.5, 47.5, -6.25, 46.25))


def test_drives_to_the_north_make_the_window_higher_up_to_a_square():
    assert window_around(at(0.0), [at(0.0, 30.0)]) == pytest.approx((-37.5, 37.5, -34.5, 34.5))
    assert window_around(at(0.0), [at(0.0, -34.0), at(5.0)]) == pytest.approx((-37.5, 37.5, -37.5, 37.5))
    assert window_around(at(0.0), [at(30.0, 8.0)]) == pytest.approx((-37.5, 37.5, -26.25, 26.25))


def test_epochs_out_of_sight_change_nothing():
    assert window_around(at(0.0), [at(0.0, 100.0), at(60.0, 30.0)]) == window_around(at(0.0), [])


def test_the_window_grows_with_the_search_space_and_is_never_nothing():
    wide = maxcon.SearchSpace(half_width=6.0, cell=0.5, heading_half_width_deg=0.0)
    one_cell = maxcon.SearchSpace(half_width=0.0, cell=0.5, heading_half_width_deg=0.0)
    assert window_around(at(0.0, space=wide), []).size == pytest.approx((150.0, 105.0))
    assert window_around(at(0.0, space=one_cell), []).size == pytest.approx((10.0, 7.0))


def test_spaces_that_would_lie_on_or_close_to_a_nearer_one_are_left_out():
    # Edges are 6 m, and there is a gap of a tenth of that: 6 m is too near to 0, 13 m too near to 7.
    others = [at(13.0), at(7.0), at(6.0), at(14.0), at(0.0, 6.5), at(0.0, -6.7)]
    assert apart(at(0.0), others, EVERYWHERE) == [1, 3, 5]


def test_an_epoch_is_not_drawn_beside_itself():
    assert apart(at(3.0, 4.0), [at(3.0, 4.0)], EVERYWHERE) == []


def test_spaces_that_do_not_lie_in_the_window_whole_are_left_out():
    # Cells are centred on the offsets: the ground reaches 3.25 m to the west and 2.75 m to the east.
    window = Window(-20.0, 20.0, -10.0, 10.0)
    others = [at(17.2), at(17.3), at(-16.7), at(-16.8), at(0.0, 7.3)]
    assert apart(at(0.0), others, window) == [0, 2]


# Half metres: none is at the very edge of what is near enough.
HALVES = st.integers(-80, 80).map(lambda number: 0.5 * number)


@given(st.lists(st.tuples(HALVES, HALVES), max_size=12))
def test_spaces_that_are_drawn_never_touch_and_the_rest_would(places):
    this, others = at(0.0), [at(x, y) for x, y in places]
    kept = apart(this, others, EVERYWHERE)
    drawn = [(0.0, 0.0), *(places[number] for number in kept)]

    def is_clear(one, other):
        return max(abs(one[0] - other[0]), abs(one[1] - other[1])) >= 6.6

    assert all(is_clear(one, other) for n, one in enumerate(drawn) for other in drawn[:n])
    left_out = [place for number, place in enumerate(places) if number not in kept]
    assert not any(all(is_clear(place, one) for one in drawn) for place in left_out)


def test_blocks_hold_their_highest_score_also_where_they_are_cut():
    scores = np.array([[1.0, 2.0, 9.0], [0.0, 5.0, 3.0], [4.0, -np.inf, 7.0]])
    np.testing.assert_array_equal(highest_of_blocks(scores, 2), [[5.0, 9.0], [4.0, 7.0]])
    np.testing.assert_array_equal(highest_of_blocks(scores, 1), scores)
    np.testing.assert_array_equal(highest_of_blocks(scores, 5), [[9.0]])
