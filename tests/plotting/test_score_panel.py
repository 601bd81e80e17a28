# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
import numpy as np
import pytest

import maxcon
from drawn_figures import SPACE, BelowZero, parts, yard
from maxcon.plotting.score_panel import (
    SearchSpaceView,
    chosen_headings,
    draw_scores,
    ground_of,
    score_words,
    title_of,
    unit_of,
)  # fmt: skip


def test_scores_lie_on_their_ground_and_the_axes_keep_their_limits():
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    axes = Figure().add_axes((0.0, 0.0, 1.0, 1.0), xlim=(-7.0, 9.0), ylim=(-3.0, 4.0))
    scores = np.array([[0.0, 1.0], [-np.inf, 3.0]])
    image = draw_scores(axes, scores, ground_of(maxcon.SearchSpace(1.0, 1.0), 5.0, 1.0), Normalize(0.0, 3.0))
    assert image.get_extent() == [3.5, 5.5, -0.5, 1.5]  # half a cell beyond the outermost offsets
    assert image.origin == "lower"
    np.testing.assert_array_equal(image.get_array().mask, [[False, False], [True, False]])
    assert axes.get_xlim() == (-7.0, 9.0) and axes.get_ylim() == (-3.0, 4.0)


@pytest.mark.parametrize(
    ("score", "words"), [(190.34, "190.3"), (15287.4, "15,287"), (0.012344, "0.01234"), (-3.0, "−3"), (0.0, "0")]
)
def test_scores_are_written_with_four_digits(score, words):
    assert score_words(score) == words


def test_objectives_have_names_and_a_users_own_has_its_classs():
    assert unit_of(maxcon.Helmert()) == "1/tr Q"
    assert (title_of(maxcon.Count()), unit_of(maxcon.Count())) == ("Count", "matches")
    assert (title_of(BelowZero()), unit_of(BelowZero())) == ("BelowZero", "score")


@pytest.mark.parametrize("n_headings", [1, 9, 11, 17, 181])
def test_few_headings_are_all_drawn_and_of_many_nine_in_even_steps_with_the_best(n_headings):
    for best in range(n_headings):
        chosen = chosen_headings(n_headings, best)
        assert len(chosen) == min(n_headings, 9) and best in chosen
        assert len(set(np.diff(chosen))) <= 1
        assert min(chosen) >= 0 and max(chosen) < n_headings


def test_colours_run_from_nothing_to_the_best():
    view = SearchSpaceView(parts()["accumulator"], maxcon.Helmert())
    assert view.limits == (0.0, view.scores[view.best])
    assert SearchSpaceView(view.accumulator, BelowZero()).limits[0] < 0.0
    empty = SearchSpaceView(maxcon.Accumulator(np.zeros((*SPACE.shape, 4)), SPACE, yard().prior), maxcon.Count())
    assert empty.limits == (0.0, 1.0)
    assert not empty.has_best


def test_reference_is_marked_at_its_offset_in_the_nearest_heading():
    view = SearchSpaceView(parts()["accumulator"], maxcon.Helmert())
    assert view.offset(yard().reference) == pytest.approx((0.18, -0.24))
    assert view.heading_nearest(yard().reference, range(5)) == 3
    assert view.best == SPACE.nearest_cell(yard().reference, yard().prior)
