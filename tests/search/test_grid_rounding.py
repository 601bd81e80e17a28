# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Half widths in whole steps: where rounding is forgiven, and where it is not."""

import pytest

from maxcon.errors import SearchSpaceError
from maxcon.search.grid_rounding import MOST_STEPS, n_steps, rounded_up


@pytest.mark.parametrize(
    ("half_width", "n"),
    [(0.0, 0), (0.9e-6, 0), (1.0 + 0.9e-6, 1), (50_000.0 * (1.0 + 0.9e-6), 50_000), (1.0 * MOST_STEPS, MOST_STEPS)],
)  # fmt: skip
def test_a_millionth_is_forgiven_of_a_step_or_of_all_of_them(half_width, n):
    assert n_steps(half_width, 1.0, "offsets", "m") == n


@pytest.mark.parametrize("half_width", [1.1e-6, 1.0 + 1.1e-6, 50_000.0 * (1.0 + 1.1e-6), 0.5])
def test_more_is_not_forgiven(half_width):
    with pytest.raises(SearchSpaceError, match="a multiple of its step"):
        n_steps(half_width, 1.0, "offsets", "m")


def test_so_many_steps_and_no_more():
    with pytest.raises(SearchSpaceError, match="at most 100,000 cells in the half width of the offsets"):
        n_steps(MOST_STEPS + 1.0, 1.0, "offsets", "m")


@pytest.mark.parametrize(
    ("reach", "held"),
    [
        (0.0, 0.0),
        (1.0, 1.0),
        (1.0 + 0.9e-9, 1.0),
        (1.0 + 1.5e-9, 2.0),
        (50_000.0 * (1.0 + 0.5e-9), 50_000.0),
        (50_000.0 * (1.0 + 1.5e-9), 50_001.0),
    ],
)
def test_what_is_reached_is_held_up_to_a_billionth(reach, held):
    assert rounded_up(reach, 1.0) == held


def test_half_a_step_more_where_there_is_a_rim():
    assert rounded_up(1.0, 1.0, rim=0.5) == 2.0
    assert rounded_up(0.0, 1.0, rim=0.5) == 0.0
    assert rounded_up(MOST_STEPS - 0.5, 1.0, rim=0.5) == MOST_STEPS


def test_what_cannot_be_held_is_left_for_the_space_to_refuse():
    assert rounded_up(2.5 * MOST_STEPS, 1.0) == 2.5 * MOST_STEPS
    assert rounded_up(2.5 * MOST_STEPS, 1.0, 1.5 * MOST_STEPS) == 1.5 * MOST_STEPS
    assert rounded_up(2.5 * MOST_STEPS, 1.0, 10.5) == 10.0
