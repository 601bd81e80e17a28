# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""What all searches share: exact rounding, cells that are voxels of the map or of a level of it, options, refusals."""

import inspect

import numpy as np
import pytest

from maxcon import Count, PointMap, Pose, Scan, SearchSpace
from maxcon.errors import ArrayError, OptionError, SearchSpaceError
from maxcon.search import branch_and_bound, consensus_set, exhaustive, level_of, reference
from maxcon.search.accumulator import CONTRIBUTION_STEP, ROUNDER, cells_of, check_all_fit

CELL = 0.06
PLACE, X = [[0.01, 0.01, 0.01]], [[1.0, 0.0, 0.0]]
POINT_MAP = PointMap.from_points(PLACE, X, CELL)
PRIOR = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
SPACE = SearchSpace(0.6, CELL, 1.0, 0.5)


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


@pytest.mark.parametrize("off", [0.0, 0.9e-9, -0.9e-9])
def test_cells_are_voxels_of_the_map_or_of_a_level_of_it_up_to_rounding(off):
    for factor in (1, 2, 4, 8, 16, 32):
        space = SearchSpace(0.0, factor * CELL * (1.0 + off), 0.0, 0.5)
        assert level_of(POINT_MAP, space) is POINT_MAP.level(factor)
        assert cells_of(space, POINT_MAP.level(factor)) == space
    assert cells_of(SearchSpace(3.0), POINT_MAP) == SearchSpace(3.0).at(CELL)


@pytest.mark.parametrize("factor", [0.5, 3, 64, 1.0 + 3e-9, 1.0 - 3e-9, 2.0 * (1.0 - 3e-9)])
def test_other_cells_are_refused(factor):
    space = SearchSpace(0.0, CELL * factor, 0.0, 0.5)
    with pytest.raises(SearchSpaceError, match=r"voxel edge, 0\.06 m, or 2, 4, \.\.\. 32"):
        level_of(POINT_MAP, space)
    with pytest.raises(SearchSpaceError, match=r"the map's voxel edge, 0\.06 m"):
        cells_of(space, POINT_MAP)


# --- what every search refuses ------------------------------------------------------------------------


def bounded(*arguments, **options):
    return branch_and_bound(*arguments, Count(), **options)


def matched(*arguments):
    return consensus_set(*arguments, (0, 0, 0))


FAR = PRIOR.translated([1e9, 0.0, 0.0])
NARROW = r"at most (67,108,864|100,000) cells .* got .*\. Narrow the search space"


@pytest.mark.parametrize(
    ("searches", "prior", "space", "options", "error", "words"),
    [
        ("evbm", PRIOR, SearchSpace(1.0, 0.05), {}, SearchSpaceError, r"0\.06 m, got 0\.05 m\. Search in a level"),
        ("ev", PRIOR, SearchSpace(0.6, CELL, 0.0, 0.5, CELL), {}, SearchSpaceError, "one height, got 3"),
        ("e", PRIOR, lambda: SearchSpace(600.0, CELL), {}, SearchSpaceError, NARROW),
        ("e", PRIOR, lambda: SearchSpace(60_000.0, CELL), {}, SearchSpaceError, NARROW),
        ("evb", FAR, SPACE, {}, ArrayError, "of the local origin"),
        ("evb", PRIOR, SPACE, {"multiplicity": "all"}, OptionError, "'occupied' or 'points', got 'all'"),
        ("evb", PRIOR, SPACE, {"weighting": "two"}, OptionError, "'cosine', 'published' or 'one', got 'two'"),
        ("evb", PRIOR, SPACE, {"weighting": 1}, OptionError, "'cosine', 'published' or 'one', got 1"),
        ("eb", PRIOR, SPACE, {"n_threads": 0}, OptionError, "Expected `n_threads` to be 1 or more, got 0"),
        ("eb", PRIOR, SPACE, {"n_threads": -1}, OptionError, "1 or more, got -1"),
    ],
)  # fmt: skip
def test_what_searches_refuse(searches, prior, space, options, error, words):
    for name in searches:
        search = {"e": exhaustive, "v": reference.voxels, "b": bounded, "m": matched}[name]
        with pytest.raises(error, match=words):
            search(Scan(PLACE, X), POINT_MAP, prior, space() if callable(space) else space, **options)


def test_so_many_cells_fit_and_no_more():
    check_all_fit(SearchSpace(4096 * CELL, CELL, 0.0, 0.5))  # 2^26
    with pytest.raises(SearchSpaceError, match=r"at most 67,108,864 cells .*, got 67,141,636\."):
        check_all_fit(SearchSpace(4097 * CELL, CELL, 0.0, 0.5))


@pytest.mark.parametrize(
    ("search", "names"),
    [
        (exhaustive, "scan point_map prior space"),
        (reference.voxels, "scan point_map prior space"),
        (reference.pairs, "scan points_map normals_map prior space"),
        (branch_and_bound, "scan point_map prior space objective"),
    ],
)
def test_what_is_searched_goes_by_position_or_by_name_and_options_by_name_alone(search, names):
    kinds = [(name, each.kind.name) for name, each in inspect.signature(search).parameters.items()]
    n = len(names.split())
    assert kinds[:n] == [(name, "POSITIONAL_OR_KEYWORD") for name in names.split()]
    assert {kind for _, kind in kinds[n:]} == {"KEYWORD_ONLY"}
