# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""SearchSpace: cells, and the poses they stand for."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import MaxconError, Pose, SearchSpace
from maxcon.errors import SearchSpaceError

PRIOR = Pose(458_888.42, 5_429_081.54, 115.07, 0.02, -0.03, 3.1)


def test_the_papers_space_is_the_default():
    space = SearchSpace()
    assert space.shape == (9, 100, 100)
    assert space.n_cells == 90_000
    np.testing.assert_allclose(
        np.degrees(space.headings), [-2, -1.5, -1, -0.5, 0, 0.5, 1, 1.5, 2], atol=1e-12
    )
    assert (space.headings[4], space.offsets[50]) == (0.0, 0.0)
    np.testing.assert_allclose(space.offsets[[0, 49, 51, 99]], [-3.0, -0.06, 0.06, 2.94])
    np.testing.assert_allclose(np.diff(space.offsets), 0.06)
    assert space.reach == pytest.approx(3.0)


def test_the_prior_is_a_cell():
    pose = SearchSpace().pose((4, 50, 50), PRIOR)
    assert pose == PRIOR


def test_index_order_is_heading_y_x():
    space = SearchSpace()
    prior = Pose(1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    pose = space.pose((6, 53, 49), prior)
    np.testing.assert_allclose(pose.position, [1.0 - 0.06, 2.0 + 0.18, 3.0])
    np.testing.assert_allclose([pose.roll, pose.pitch, pose.heading], [0.1, 0.2, 0.3 + math.radians(1.0)])


@given(
    st.integers(0, 200), st.floats(0.01, 2.0), st.integers(0, 30), st.floats(0.05, 5.0),
    st.floats(-math.pi, math.pi), st.data(),
)  # fmt: skip
def test_the_nearest_cell_of_a_cells_pose_is_the_cell(n_steps, cell, n_turns, step_deg, heading, data):
    space = SearchSpace(n_steps * cell, cell, n_turns * step_deg, step_deg)
    n_headings, ny, nx = space.shape
    assert (n_headings, ny, nx) == (2 * n_turns + 1, max(1, 2 * n_steps), max(1, 2 * n_steps))
    wanted = tuple(data.draw(st.integers(0, n - 1)) for n in space.shape)
    prior = Pose(1000.0, -2000.0, 5.0, 0.1, 0.0, heading)
    pose = space.pose(wanted, prior)
    if n_turns * step_deg < 180.0:  # beyond, two cells are one heading
        assert space.nearest_cell(pose, prior) == wanted
        nudged = Pose(pose.x + 0.4 * cell, pose.y - 0.4 * cell, 0.0, 0.0, 0.0, pose.heading)
        assert space.nearest_cell(nudged, prior) == wanted


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-20, 20))
def test_the_nearest_cell_lies_in_the_space(x, y, heading):
    space = SearchSpace()
    cell = space.nearest_cell(Pose(x, y, 0.0, 0.0, 0.0, heading), Pose(0.0, 0.0, 0.0, 0.0, 0.0, 3.1))
    assert all(0 <= index < n for index, n in zip(cell, space.shape, strict=True))


def test_headings_wrap_between_pose_and_prior():
    space, prior = SearchSpace(), Pose(0.0, 0.0, 0.0, 0.0, 0.0, math.pi - 0.001)
    pose = space.pose((8, 50, 50), prior)
    assert -math.pi <= pose.heading < 0.0
    assert space.nearest_cell(pose, prior) == (8, 50, 50)


def test_the_rim_is_the_outermost_rows_and_columns():
    space = SearchSpace(0.3, 0.1, 0.5, 0.5)  # 6 x 6 cells
    n_rim = sum(space.is_at_rim((1, iy, ix)) for iy in range(6) for ix in range(6))
    assert n_rim == 6 * 6 - 4 * 4
    assert not space.is_at_rim((0, 3, 3))  # the outermost heading is no rim of offsets
    for cell in ((1, 0, 3), (1, 5, 3), (1, 3, 0), (1, 3, 5)):
        assert space.is_at_rim(cell)


def test_headings_alone_or_one_pose_alone():
    space = SearchSpace(0.0, 0.06, 2.0, 0.5)
    assert space.shape == (9, 1, 1)
    np.testing.assert_array_equal(space.offsets, [0.0])
    assert not space.is_at_rim((4, 0, 0))
    assert SearchSpace(0.0, 0.06, 0.0, 0.5).n_cells == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            (3.0, 0.07),
            r"half width of the offsets to be a multiple of its step, got 3.0 m and 0.07 m\. Take 3.01 m\?",
        ),
        (
            (3.0, 0.06, 2.0, 0.3),
            r"half width of the headings .*got 2.0 degrees and 0.3 degrees\. Take 2.1 degrees\?",
        ),
        ((-3.0, 0.06), r"half width >= 0 and a step > 0 for the offsets, got -3.0 m and 0.06 m"),
        ((3.0, 0.0), r"a step > 0 for the offsets, got 3.0 m and 0.0 m"),
        ((3.0, -0.06), "a step > 0 for the offsets"),
        ((3.0, math.nan), "a step > 0 for the offsets, got 3.0 m and nan m"),
        ((math.inf, 0.06), "half width >= 0 .*got inf m"),
        ((3.0, 0.06, math.nan, 0.5), "for the headings, got nan degrees"),
        ((3.0, 0.06, 2.0, 0.0), "a step > 0 for the headings"),
    ],
)
def test_what_is_refused(arguments, words):
    with pytest.raises(SearchSpaceError, match=words) as caught:
        SearchSpace(*arguments)
    assert isinstance(caught.value, MaxconError)
    assert isinstance(caught.value, ValueError)


def test_the_suggestion_is_accepted():
    assert SearchSpace(3.01, 0.07).shape[1] == 86


@pytest.mark.parametrize(
    ("half_width", "cell"), [(3.0, 0.06), (0.3, 0.1), (2.1, 0.7), (4.2, 0.06), (100.0, 0.05)]
)
def test_rounding_refuses_no_multiple(half_width, cell):
    assert SearchSpace(half_width, cell).shape[1] == 2 * round(half_width / cell)
