# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What matches add is rounded so that sums are exact; cells are voxels of the map or of a level of it."""

import numpy as np
import pytest

from maxcon import PointMap, SearchSpace
from maxcon.errors import OptionError, SearchSpaceError
from maxcon.search import level_of
from maxcon.search.accumulator import (
    CONTRIBUTION_STEP,
    ROUNDER,
    cells_of,
    check_all_fit,
    check_one_height,
    check_threads,
)

CELL = 0.06
POINT_MAP = PointMap.from_points([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]], CELL)


def test_half_a_billion_matches_add_up_exactly():
    n_matches = 2.0**29
    assert np.spacing(n_matches - 1.0) == CONTRIBUTION_STEP


def test_the_rounder_rounds_to_whole_steps_with_ties_to_even():
    rng = np.random.default_rng(0)
    most = 2.0**27
    values = np.concatenate([rng.uniform(-most, most, 10_000), rng.uniform(-1.0, 1.0, 10_000), [-most, 0.0, most]])
    ties = (rng.integers(-(2**40), 2**40, 10_000) + 0.5) * CONTRIBUTION_STEP
    for some in (values, ties):
        wanted = np.rint(some / CONTRIBUTION_STEP) * CONTRIBUTION_STEP
        assert ((some + ROUNDER) - ROUNDER == wanted).all()


def test_the_level_of_a_space_has_its_cells_up_to_rounding():
    for factor in (1, 2, 4, 8, 16, 32):
        for off in (0.0, 0.9e-9, -0.9e-9):
            space = SearchSpace(0.0, factor * CELL * (1.0 + off), 0.0, 0.5)
            assert level_of(POINT_MAP, space) is POINT_MAP.level(factor)
    for cell in (0.5 * CELL, 3 * CELL, 64 * CELL, CELL * (1.0 + 3e-9), 2 * CELL * (1.0 - 3e-9)):
        with pytest.raises(SearchSpaceError, match=r"voxel edge, 0\.06 m, or 2, 4, \.\.\. 32"):
            level_of(POINT_MAP, SearchSpace(0.0, cell, 0.0, 0.5))


def test_a_space_without_cells_gets_the_voxels_of_the_map_and_others_are_compared_up_to_rounding():
    assert cells_of(SearchSpace(3.0), POINT_MAP) == SearchSpace(3.0).at(CELL)
    for off in (0.0, 0.9e-9, -0.9e-9):
        space = SearchSpace(0.0, CELL * (1.0 + off), 0.0, 0.5)
        assert cells_of(space, POINT_MAP) == space
    for off in (3e-9, -3e-9, 1.0):
        with pytest.raises(SearchSpaceError, match=r"the map's voxel edge, 0\.06 m"):
            cells_of(SearchSpace(0.0, CELL * (1.0 + off), 0.0, 0.5), POINT_MAP)


def test_what_a_search_of_all_cells_refuses():
    one, three = SearchSpace(0.6, CELL, 1.0, 0.5), SearchSpace(0.6, CELL, 1.0, 0.5, CELL)
    check_one_height(one)
    with pytest.raises(SearchSpaceError, match="one height, got 3"):
        check_one_height(three)
    check_all_fit(SearchSpace(4096 * CELL, CELL, 0.0, 0.5))  # 2^26
    with pytest.raises(SearchSpaceError, match=r"at most 67,108,864 cells .*, got 67,141,636\."):
        check_all_fit(SearchSpace(4097 * CELL, CELL, 0.0, 0.5))
    check_threads(1)
    for n_threads in (0, -1):
        with pytest.raises(OptionError, match=f"1 or more, got {n_threads}"):
            check_threads(n_threads)
