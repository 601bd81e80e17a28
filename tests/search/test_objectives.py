"""What a cell is worth, for all moments; and what all searches share: rounding, cells, options, refusals, records."""

import importlib
import inspect
import pkgutil
import warnings
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from searches import SEEDS, OwnObjective

import maxcon.search
from maxcon import Count, Helmert, MaxEigenvalue, PointMap, Pose, Scan, SearchSpace
from maxcon.errors import ArrayError, OptionError, SearchSpaceError
from maxcon.search import branch_and_bound, consensus_set, exhaustive, level_of, reference
from maxcon.search.accumulator import CONTRIBUTION_STEP, ROUNDER, cells_of, check_all_fit
from maxcon.search.objectives import OBJECTIVES, Checked, as_objective

VALUES = st.floats(-1e12, 1e12) | st.sampled_from([0.0, 1e-300, -1e-300, 1e-30, 5e-324, 1.0, 2.0**-24, 1e100])
CELL = 0.06
PLACE, X = [[0.01, 0.01, 0.01]], [[1.0, 0.0, 0.0]]
POINT_MAP = PointMap.from_points(PLACE, X, CELL)
PRIOR = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
SPACE = SearchSpace(0.6, CELL, 1.0, 0.5)
FAR = PRIOR.translated([1e9, 0.0, 0.0])
NARROW = r"at most (67,108,864|100,000) cells .* got .*\. Narrow the search space"
MODULES = [f"maxcon.search.{module.name}" for module in pkgutil.iter_modules(maxcon.search.__path__)]


def moments_of(normals, weights):
    """Count, Nxx, Nxy, Nyy of matches with these normals (n, 2) and weights (n,)."""
    x, y = np.asarray(normals, float).reshape(-1, 2).T
    w = np.asarray(weights, float)
    return np.array([len(w), (w * x * x).sum(), (w * x * y).sum(), (w * y * y).sum()])


def directions(seed, n, spread=np.pi):
    angles = np.random.default_rng(seed).uniform(-spread, spread, n)
    return np.column_stack([np.cos(angles), np.sin(angles)])


@pytest.mark.parametrize(("moments", "count", "score", "eigenvalue"), [
    ([0, 0, 0, 0], 0, 0.0, 0.0), ([5, 2, 0, 3], 5, 1.2, 2.0), ([5, 3, 0, 2], 5, 1.2, 2.0),
    ([10, 5, 0, 5], 10, 2.5, 5.0), ([4, 2, 1, 2], 4, 0.75, 1.0), ([4, 2, -1, 2], 4, 0.75, 1.0),
    ([7, 7, 0, 0], 7, 0.0, 0.0), ([7, 3.5, 3.5, 3.5], 7, 0.0, 0.0), ([7, 0, 0, 0], 7, 0.0, 0.0),
])  # fmt: skip
def test_values_by_hand(moments, count, score, eigenvalue):
    moments = np.array(moments, float)
    assert Count().score(moments) == count
    assert Helmert().score(moments) == pytest.approx(score, rel=1e-12)
    assert MaxEigenvalue().score(moments) == pytest.approx(eigenvalue, rel=1e-12)


@given(SEEDS, st.integers(2, 60))
def test_they_are_what_the_paper_defines(seed, n):
    """1 / tr(Q) and 1 / max(lambda of Q), with Q the inverse of N; in the axes of N the bound is hardly more."""
    moments = moments_of(directions(seed, n), np.random.default_rng(seed).uniform(0.05, 1.0, n))
    normal_matrix = moments[[1, 2, 2, 3]].reshape(2, 2)
    least, most = np.linalg.eigvalsh(normal_matrix)
    assume(least >= 1e-5 * most)
    cofactor = np.linalg.inv(normal_matrix)
    helmert, smallest = Helmert().score(moments), MaxEigenvalue().score(moments)
    assert helmert == pytest.approx(1.0 / np.trace(cofactor), rel=1e-9)
    assert smallest == pytest.approx(1.0 / np.linalg.eigvalsh(cofactor)[1], rel=1e-9)
    assert smallest == pytest.approx(least, rel=1e-9)
    assert smallest / 2 * (1 - 1e-9) <= helmert <= smallest * (1 + 1e-9)
    assert helmert <= moments[0] / 4 + 1e-9  # all unit matches, half of them each way
    for objective, score in ((Helmert(), helmert), (MaxEigenvalue(), smallest)):
        bound = objective.bound_by_axes(np.array(least), np.array(most))
        assert score * (1.0 + 0.5e-9) <= bound <= score * (1.0 + 2e-9)


@given(SEEDS, st.integers(0, 30), st.integers(0, 30))
def test_more_matches_never_lower_a_score(seed, n, n_more):
    """N grows in the Loewner order (design, section 3, fact 1)."""
    rng = np.random.default_rng(seed)
    normals, weights = directions(seed, n + n_more), rng.uniform(0.0, 1.0, n + n_more)
    fewer, more = moments_of(normals[:n], weights[:n]), moments_of(normals, weights)
    for objective in OBJECTIVES:
        assert objective.score(more) >= objective.score(fewer) * (1.0 - 1e-9) - 2e-6 * (n + n_more)


@given(SEEDS, st.floats(-np.pi, np.pi), st.integers(1, 100_000))
def test_one_direction_however_often_scores_nothing(seed, angle, n):
    """Summed as the search sums: float32 products, rounded to multiples of 2^-24."""
    x, y = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    weights = np.random.default_rng(seed).uniform(0.0, 1.0, n).astype(np.float32).astype(np.float64)
    sums = [(np.rint(weights * float(p) * 2.0**24) / 2.0**24).sum() for p in (x * x, x * y, y * y)]
    moments = np.array([n, *sums])
    if moments[1] + moments[3] < 0.1:
        return  # a few hundred-thousandths of a match: rounding alone
    assert Helmert().score(moments) == 0.0 and MaxEigenvalue().score(moments) == 0.0


@given(hnp.arrays(np.float64, hnp.array_shapes(max_dims=2, max_side=6).map(lambda s: (*s, 4)), elements=VALUES))
def test_never_nan_and_never_a_warning(moments):
    """Count, Nxx and Nyy are sums of what is never negative; Nxy may be anything."""
    moments = np.where([True, True, False, True], np.abs(moments), moments)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for objective in OBJECTIVES:
            scores = objective.score(moments)
            assert scores.shape == moments.shape[:-1] and scores.dtype == np.float64
            assert not np.isnan(scores).any() and (scores >= 0.0).all()


@given(
    SEEDS, st.integers(0, 60), st.none() | st.floats(-np.pi, np.pi),
    st.sampled_from([0.0, 1e-3]) | st.floats(0.0, np.pi),
)  # fmt: skip
def test_bounds_hold_for_scores_as_they_are_computed_in_any_axes(seed, n, azimuth, spread):
    """Nearly singular, where the rounding of scores is at its largest, and in the axes of N, the tightest, too."""
    moments = moments_of(directions(seed, n, spread), np.random.default_rng(seed).uniform(0.0, 1.0, n))
    _, xx, xy, yy = moments
    azimuth = 0.5 * np.arctan2(2.0 * xy, xx - yy) if azimuth is None else azimuth
    c, s = np.cos(azimuth), np.sin(azimuth)
    along, across = c * c * xx + 2 * c * s * xy + s * s * yy, s * s * xx - 2 * c * s * xy + c * c * yy
    along, across = max(along, 0.0), max(across, 0.0)  # sums of what is never negative, but for rounding
    for objective in (Helmert(), MaxEigenvalue()):
        with np.errstate(divide="raise", invalid="raise"):
            bound = objective.bound_by_axes(np.array([along]), np.array([across]))
        assert bound >= objective.score(moments)
        never_lower = bound * (1.0 - 1e-12)  # but for the last bits, of which the bound has more to spare
        assert objective.bound_by_axes(np.array([1.5 * along]), np.array([across])) >= never_lower
        assert objective.bound_by_axes(np.array([along]), np.array([1.5 * across])) >= never_lower
    assert Count().bound_by_count(moments[:1]) == Count().score(moments)


@pytest.mark.parametrize("objective", [Count(), Helmert(), MaxEigenvalue()])
def test_objectives_are_told_by_name_and_two_of_a_kind_are_the_same(objective):
    assert as_objective(objective.name) == objective == type(objective)()
    assert as_objective(objective) is objective and {objective: 1}[type(objective)()] == 1


@pytest.mark.parametrize("wrong", ["Helmert", "", "helmert ", 3, None, Helmert])
def test_what_is_no_objective_is_refused(wrong):
    with pytest.raises(OptionError, match=r"'count', 'helmert', 'max-eigenvalue' or an object with `score"):
        as_objective(wrong)
    with pytest.raises(OptionError, match="`objective`"):
        maxcon.MaximumConsensus(objective=wrong)


@pytest.mark.parametrize(("score", "words"), [
    (lambda moments: moments, r"shape \(2, 3\), got \(2, 3, 4\)"),
    (lambda moments: moments.sum(), r"\.OwnObjective to return scores of shape \(2, 3\), got \(\) of float64"),
    (lambda moments: np.where([[1, 1, 1], [1, 0, 1]], 1.0, np.nan), "numbers, got NaN"),
    (lambda moments: np.full((2, 3), -1e-300), r"0 or more .* got -1e-300\. Let the objective return 0"),
    (lambda moments: np.array([[5, 4, 3], [2, 1, -7]]), "0 or more .* got -7"),
])  # fmt: skip
def test_scores_that_are_not_are_refused(score, words):
    with pytest.raises(ArrayError, match=words):
        Checked(OwnObjective(score)).score(np.ones((2, 3, 4)))


def test_matches_are_rounded_to_whole_steps_and_half_a_billion_add_up_exactly():
    n_matches = 2.0**29
    assert np.spacing(n_matches - 1.0) == CONTRIBUTION_STEP
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


# --- what every search refuses ---
SEARCHES = {
    "e": exhaustive, "v": reference.voxels, "b": lambda *given, **options: branch_and_bound(*given, Count(), **options),
    "m": lambda *given: consensus_set(*given, (0, 0, 0)),
}  # fmt: skip


@pytest.mark.parametrize(("searches", "prior", "space", "options", "error", "words"), [
    ("evbm", PRIOR, SearchSpace(1.0, 0.05), {}, SearchSpaceError, r"0\.06 m, got 0\.05 m\. Search in a level"),
    ("ev", PRIOR, SearchSpace(0.6, CELL, 0.0, 0.5, CELL), {}, SearchSpaceError, "one height, got 3"),
    ("e", PRIOR, lambda: SearchSpace(600.0, CELL), {}, SearchSpaceError, NARROW),
    ("e", PRIOR, lambda: SearchSpace(60_000.0, CELL), {}, SearchSpaceError, NARROW),
    ("evb", FAR, SPACE, {}, ArrayError, "of the local origin"),
    ("evb", PRIOR, SPACE, {"multiplicity": "all"}, OptionError, "'occupied' or 'points', got 'all'"),
    ("evb", PRIOR, SPACE, {"weighting": "two"}, OptionError, "'cosine', 'published' or 'one', got 'two'"),
    ("eb", PRIOR, SPACE, {"n_threads": 0}, OptionError, "Expected `n_threads` to be 1 or more, got 0"),
])  # fmt: skip
def test_what_searches_refuse(searches, prior, space, options, error, words):
    for name in searches:
        with pytest.raises(error, match=words):
            SEARCHES[name](Scan(PLACE, X), POINT_MAP, prior, space() if callable(space) else space, **options)


def test_so_many_cells_fit_and_no_more():
    check_all_fit(SearchSpace(4096 * CELL, CELL, 0.0, 0.5))  # 2^26
    with pytest.raises(SearchSpaceError, match=r"at most 67,108,864 cells .*, got 67,141,636\."):
        check_all_fit(SearchSpace(4097 * CELL, CELL, 0.0, 0.5))


@pytest.mark.parametrize(("search", "names"), [
    (exhaustive, "scan point_map prior space"),
    (reference.voxels, "scan point_map prior space"),
    (reference.pairs, "scan points_map normals_map prior space"),
    (branch_and_bound, "scan point_map prior space objective"),
])  # fmt: skip
def test_what_is_searched_goes_by_position_or_by_name_and_options_by_name_alone(search, names):
    kinds = [(name, each.kind.name) for name, each in inspect.signature(search).parameters.items()]
    n = len(names.split())
    assert kinds[:n] == [(name, "POSITIONAL_OR_KEYWORD") for name in names.split()]
    assert {kind for _, kind in kinds[n:]} == {"KEYWORD_ONLY"}


def test_answers_can_be_compared():
    pose, space = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), SearchSpace(0.6, 0.06, 0.0)
    for make in (
        lambda: maxcon.Estimate(pose, 1.0, None, maxcon.Status.LOCALIZED, np.eye(2)),
        lambda: maxcon.Accumulator(np.zeros((1, 20, 20, 4)), space, pose),
    ):
        one = make()
        assert one == one and one != make()


@pytest.mark.parametrize("name", [*MODULES, "maxcon.cell_search", "maxcon.estimate", "maxcon.integrity"])
def test_records_are_frozen_and_those_of_arrays_have_no_generated_equality(name):
    classes = [kind for _, kind in inspect.getmembers(importlib.import_module(name), inspect.isclass)]
    classes = [kind for kind in classes if is_dataclass(kind) and kind.__module__ == name]
    assert [kind for kind in classes if not kind.__dataclass_params__.frozen] == []
    arrays = ("NDArray", "Moments", "Scores")
    of_arrays = [kind for kind in classes if any(word in str(each.type) for each in fields(kind) for word in arrays)]
    assert [kind for kind in of_arrays if kind.__dataclass_params__.eq] == []
