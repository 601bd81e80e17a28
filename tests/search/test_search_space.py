"""SearchSpace: cells, and the poses they stand for."""

import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon import MaxconError, Pose, SearchSpace
from maxcon.errors import SearchSpaceError
from maxcon.search.space import MOST_STEPS, _n_steps, rounded_up

PRIOR = Pose(458_888.42, 5_429_081.54, 115.07, 0.02, -0.03, 3.1)
VARIANCES = st.one_of(st.just(0.0), st.floats(1e-6, 400.0))
ANGLE_VARIANCES = st.one_of(st.just(0.0), st.floats(1e-8, 0.5))
FACTORS = st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9)
STEPS = st.floats(0.05, 5.0)
SMALLEST = {"smallest_half_width": 1.0, "smallest_heading_half_width_deg": 1.5, "largest_half_width": 24.0}
LARGEST = {"largest_half_width": 3.0, "largest_heading_half_width_deg": 2.2}
STEPPED = {"cell": 0.06, "heading_step_deg": 0.5}


def test_the_papers_space_headings_alone_and_one_pose_alone():
    space = SearchSpace.paper()
    assert (space.shape, space.n_cells, space.n_heights) == ((9, 100, 100), 90_000, 1)
    np.testing.assert_allclose(np.degrees(space.headings), [-2, -1.5, -1, -0.5, 0, 0.5, 1, 1.5, 2], atol=1e-12)
    assert (space.headings[4], space.offsets[50], space.heights.tolist()) == (0.0, 0.0, [0.0])
    np.testing.assert_allclose(space.offsets[[0, 49, 51, 99]], [-3.0, -0.06, 0.06, 2.94])
    np.testing.assert_allclose(np.diff(space.offsets), 0.06)
    assert space.reach == pytest.approx(3.0)
    assert space.pose((4, 50, 50), PRIOR) == space.raised(PRIOR, 0) == PRIOR
    assert space.plane == space
    with pytest.raises(FrozenInstanceError):
        space.half_width = 6.0
    space = SearchSpace(0.0, 0.06, 2.0, 0.5)
    assert (space.shape, space.offsets.tolist(), space.reach) == ((9, 1, 1), [0.0], 0.0)
    one = SearchSpace(0.0, 0.06, 0.0, 0.5)
    assert (one.n_cells, one.is_outermost(0)) == (1, False)


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
    space = SearchSpace.paper()
    cell = space.nearest_cell(Pose(x, y, 0.0, 0.0, 0.0, heading), Pose(0.0, 0.0, 0.0, 0.0, 0.0, 3.1))
    assert all(0 <= index < n for index, n in zip(cell, space.shape, strict=True))


@pytest.mark.parametrize(("n_steps", "n_at_boundary"), [(0, 0), (1, 0), (3, 6 * 6 - 4 * 4)])
def test_the_boundary_is_the_outermost_rows_and_columns_where_there_are_others(n_steps, n_at_boundary):
    space = SearchSpace(0.1 * n_steps, 0.1, 0.5, 0.5)
    _, ny, nx = space.shape
    at_boundary = {(y, x) for y in range(ny) for x in range(nx) if space.is_at_boundary((0, y, x))}
    assert len(at_boundary) == n_at_boundary and all({y, x} & {0, 5} for y, x in at_boundary)
    assert [space.is_outermost(heading) for heading in range(3)] == [True, False, True]


@pytest.mark.parametrize(("arguments", "words"), [
    ((3.0, 0.07), r"half width of the offsets to be a multiple of its step, got 3.0 m and 0.07 m\. Take 3.01 m\?"),
    ((3.0, 0.06, 2.0, 0.3), r"half width of the headings .*got 2.0 degrees and 0.3 degrees\. Take 2.1 degrees\?"),
    ((-3.0, 0.06), r"half width >= 0 and a step > 0 for the offsets, got -3.0 m and 0.06 m"),
    ((3.0, 0.0), r"a step > 0 for the offsets, got 3.0 m and 0.0 m"), ((3.0, -0.06), "a step > 0 for the offsets"),
    ((3.0, math.nan), "a step > 0 for the offsets, got 3.0 m and nan m"),
    ((math.inf, 0.06), "half width >= 0 .*got inf m"),
    ((3.0, 0.06, math.nan, 0.5), "for the headings, got nan degrees"),
    ((3.0, 0.06, 2.0, 0.0), "a step > 0 for the headings"), ((3.0, 0.06, 2.0, 0.5, 1.0), "1.02 m"),
    ((3.0, 0.06, 2.0, 0.5, -0.06), ">= 0"), ((3.0, 0.06, 2.0, 0.5, math.inf), "inf"),
    *(((value,), "half width >= 0 for the offsets") for value in (-1.0, math.nan, math.inf)),
    *(((3.0, None, value), "half width >= 0 for the headings") for value in (-1.0, math.nan, math.inf)),
    ((3000.0, 0.06, 180.0, 0.01), r"at most 68,719,476,736 cells .* got 3\.6e\+14: 36,001 headings of"),
])  # fmt: skip
def test_what_is_refused(arguments, words):
    with pytest.raises(SearchSpaceError, match=words) as caught:
        SearchSpace(*arguments)
    assert isinstance(caught.value, MaxconError) and isinstance(caught.value, ValueError)


def _full(factors, variances):
    """A covariance with these variances, correlated as the product of a matrix of factors with its transpose."""
    factors = np.reshape(factors, (3, 3)) + 0.01 * np.eye(3)
    product = factors @ factors.T
    scales = np.sqrt(variances / np.diag(product))
    return product * scales * scales[:, None]


@given(
    FACTORS, st.tuples(VARIANCES, VARIANCES, ANGLE_VARIANCES), st.floats(0.5, 6.0), STEPS, STEPS, st.floats(0.0, 3.0),
    st.tuples(*[st.floats(-1.0, 1.0)] * 3),
)  # fmt: skip
def test_every_pose_within_k_sigma_lies_in_the_space(factors, variances, k, cell, step_deg, smallest, parts):
    covariance = _full(factors, np.array(variances))
    space = SearchSpace.from_covariance(covariance, k=k, cell=cell, heading_step_deg=step_deg)
    for part in (parts, np.sign(parts)):  # also where it ends
        dx, dy, turn = k * np.sqrt(variances) * part
        pose = Pose(PRIOR.x + dx, PRIOR.y + dy, 0.0, 0.0, 0.0, PRIOR.heading + turn)
        found = space.pose(space.nearest_cell(pose, PRIOR), PRIOR)
        assert max(abs(found.x - pose.x), abs(found.y - pose.y)) <= 0.5 * cell + 1e-6
        between = math.remainder(found.heading - pose.heading, math.tau)
        assert abs(math.degrees(between)) <= 0.5 * step_deg + 1e-6
    is_open = SearchSpace.from_covariance(
        covariance, k=k, smallest_half_width=smallest, smallest_heading_half_width_deg=smallest
    )
    dx, dy, turn = np.abs(k * np.sqrt(variances) * parts)
    for each in (is_open, is_open.at(0.06)):  # also once it has cells
        assert max(dx, dy) <= each.half_width + 1e-6
        assert min(math.degrees(turn), 180.0) <= each.heading_half_width_deg + 1e-6
        assert min(each.half_width, each.heading_half_width_deg) >= smallest - 1e-6


@given(VARIANCES, VARIANCES, ANGLE_VARIANCES, st.floats(0.5, 6.0), STEPS, STEPS)
def test_half_widths_of_a_covariance_are_rounded_up_and_no_wider(xx, yy, hh, k, cell, step_deg):
    space = SearchSpace.from_covariance(np.diag([xx, yy, hh]), k=k, cell=cell, heading_step_deg=step_deg)
    wanted = k * math.sqrt(max(xx, yy))
    assert wanted <= space.half_width <= wanted + 1.5 * cell + 1e-6
    turn_deg = min(k * math.degrees(math.sqrt(hh)), 180.0)
    assert turn_deg - 1e-6 <= space.heading_half_width_deg <= turn_deg + step_deg + 1e-6
    assert (space.half_width == 0.0) == (max(xx, yy) == 0.0)
    assert (space.heading_half_width_deg == 0.0) == (hh == 0.0)


@pytest.mark.parametrize(("variances", "options", "half_width", "turn_deg"), [
    ([4e-4, 1e-4, 1e-6], SMALLEST, 1.0, 1.5),
    ([0.25, 4.0, math.radians(1.0) ** 2], SMALLEST, 6.0, 3.0),
    ([1e4, 1.0, 1e2], SMALLEST, 24.0, 180.0),
    ([1.0, 1.0, 0.0], {"smallest_half_width": 9.0, "largest_half_width": 2.0}, 2.0, 0.0),
    ([4.0, 1.0, 0.01], LARGEST, 3.0, 2.2),
    ([4.0, 1.0, 0.01], {**LARGEST, **STEPPED}, 3.0, 2.0),
    ([4.0, 1.0, 0.01], {"largest_half_width": 0.0, "largest_heading_half_width_deg": 0.1, **STEPPED}, 0.0, 0.0),
    ([4.0, 1.0, 0.01], {"largest_half_width": 100.0, "largest_heading_half_width_deg": 100.0}, 6.0, 17.188734),
    ([1e12, 1.0, 0.0], {"largest_half_width": 3.0}, 3.0, 0.0),
    *(  # whole steps do not reach beyond a limit that is none of them
        ([0.0, 0.0, 100.0], {"heading_step_deg": step, "largest_heading_half_width_deg": 180.0}, 0.0, turn)
        for step, turn in ((0.7, 179.9), (0.5, 180.0), (7.0, 175.0), (400.0, 0.0))
    ),
])  # fmt: skip
def test_a_space_of_a_covariance_lies_between_the_smallest_and_the_largest(variances, options, half_width, turn_deg):
    space = SearchSpace.from_covariance(np.diag(variances), **options)
    assert (space.half_width, space.heading_half_width_deg) == (pytest.approx(half_width), pytest.approx(turn_deg))
    assert space.is_open == ("cell" not in options and "heading_step_deg" not in options)


@given(FACTORS, st.floats(1e-4, 9.0), st.floats(1e-6, 0.1))
def test_correlations_do_not_matter_and_the_larger_variance_counts(factors, variance, angle_variance):
    space = SearchSpace.from_covariance(np.diag([variance, variance, angle_variance]))
    for variances in ((variance, variance), (variance, 0.3 * variance), (0.0, variance)):
        full = _full(factors, np.array([*variances, angle_variance]))
        full[np.diag_indices(3)] = [*variances, angle_variance]
        assert SearchSpace.from_covariance(full) == space


@given(st.floats(0.0, 400.0), st.floats(0.0, 0.5), STEPS, STEPS, st.floats(0.0, 30.0), st.floats(0.0, 180.0))
def test_no_space_of_a_covariance_exceeds_its_limits(variance, angle_variance, cell, step_deg, most, most_deg):
    space = SearchSpace.from_covariance(
        np.diag([variance, 0.0, angle_variance]), cell=cell, heading_step_deg=step_deg,
        largest_half_width=most, largest_heading_half_width_deg=most_deg,
    )  # fmt: skip
    assert space.half_width <= most + 1e-6 * cell
    assert space.heading_half_width_deg <= most_deg + 1e-6 * step_deg
    free = SearchSpace.from_covariance(np.diag([variance, 0.0, angle_variance]), cell=cell, heading_step_deg=step_deg)
    assert space.half_width >= min(free.half_width, most - cell)
    assert space.heading_half_width_deg >= min(free.heading_half_width_deg, most_deg - step_deg)


def test_a_covariance_printed_with_few_digits_is_taken():
    full = _full([0.3, 0.3, 0.3, -0.3, -0.3, -0.3, 0.3, 0.3, 0.3], np.array([0.7, 0.2, 3e-4]))
    printed = np.array([[float(f"{value:.8g}") for value in row] for row in full])
    printed[0, 1] *= 1.0 + 1e-7
    assert SearchSpace.from_covariance(printed) == SearchSpace.from_covariance(np.diag(np.diag(printed)))


@pytest.mark.parametrize(("options", "words"), [
    ({"covariance": np.eye(2)}, r"shape \(3, 3\), got \(2, 2\)\. Take its rows"),
    ({"covariance": "exact"}, r"numbers of shape \(3, 3\)"),
    ({"covariance": np.diag([1.0, np.nan, 0.1])}, "finite, symmetric and positive semidefinite, got .*nan"),
    ({"covariance": [[1.0, 0.0, 2e-3], [0.0, 1.0, 0.0], [2e-3, 0.0, 1e-6]]}, "positive semidefinite"),
    ({"k": 0.0}, "`k` > 0 standard deviations, got 0.0. The default is 3"),
    ({"k": math.inf}, "`k` > 0"),
    ({"cell": 0.0}, "a step > 0 for the offsets, got 0.0 m and 0.0 m"),
    ({"heading_step_deg": -1.0}, "a step > 0 for the headings"),
    ({"smallest_half_width": math.inf}, "`smallest_half_width` >= 0, got inf"),
    ({"largest_half_width": -1.0}, "`largest_half_width` >= 0, got -1.0"),
    ({"largest_heading_half_width_deg": math.nan}, "`largest_heading_half_width_deg` >= 0, got nan"),
    ({"k": 1e5, "cell": 0.06}, "at most 100,000 cells in the half width of the offsets, got 100000 m"),
    ({"heading_step_deg": 1e-6}, "at most 100,000 cells in the half width of the headings"),
])  # fmt: skip
def test_covariances_that_are_none_and_numbers_that_make_no_space_of_one(options, words):
    with pytest.raises(SearchSpaceError, match=words):
        SearchSpace.from_covariance(**{"covariance": np.diag([1.0, 1.0, 0.01]), **options})


def test_heights_lie_around_the_prior_in_whole_cells():
    space = SearchSpace(3.0, 0.06, 2.0, height_half_width=0.18)
    assert space.n_heights == 7
    np.testing.assert_allclose(space.heights, [-0.18, -0.12, -0.06, 0.0, 0.06, 0.12, 0.18])
    assert space.shape == SearchSpace.paper().shape and space.n_cells == 7 * 90_000
    assert space.plane == SearchSpace.paper()
    assert [pose.z for pose in space.priors(PRIOR)] == (PRIOR.z + space.heights).tolist()
    raised = space.raised(PRIOR, 5)
    assert raised.z == pytest.approx(PRIOR.z + 0.12)
    assert (raised.x, raised.roll, raised.heading) == (PRIOR.x, PRIOR.roll, PRIOR.heading)


# --- open spaces ---
def test_an_open_space_has_no_cells_before_it_is_given_some_and_what_is_given_is_obeyed():
    space = SearchSpace()
    assert (space.half_width, space.heading_half_width_deg, space.is_open) == (12.0, 10.0, True)
    for ask in ("shape", "n_cells", "offsets", "headings", "heights", "reach", "cell_edge", "step_deg"):
        with pytest.raises(SearchSpaceError, match=r"Give it cells: `space\.at\(point_map\.cell\)`"):
            getattr(space, ask)
    assert SearchSpace(3.0, 0.12, 2.0) == SearchSpace(3.0, 0.12, 2.0, 0.5)
    stepped = SearchSpace(3.0, heading_half_width_deg=2.0, heading_step_deg=0.25)
    assert not stepped.is_open and stepped.at(0.06) == SearchSpace(3.0, 0.06, 2.0, 0.25)
    assert SearchSpace.paper() == SearchSpace(3.0, 0.06, 2.0, 0.5)


@given(st.floats(0.0, 100.0), st.floats(0.0, 180.0), st.sampled_from([0.06, 0.12, 0.48]), st.sampled_from([0.5, 2.0]))
def test_cells_hold_the_half_widths_of_an_open_space(half_width, turn_deg, cell, step_deg):
    space = SearchSpace(half_width, heading_half_width_deg=turn_deg).at(cell, step_deg)
    assert half_width - 1e-6 <= space.half_width < half_width + cell
    assert turn_deg - 1e-6 <= space.heading_half_width_deg < turn_deg + step_deg
    assert (space.cell, space.heading_step_deg, space.is_open) == (cell, step_deg, False)
    assert space.at(1.0, 1.0) == space


# --- rounding to whole steps ---
def test_a_millionth_is_forgiven_of_a_step_or_of_all_of_them_and_no_more():
    all_but, beyond = 50_000.0 * (1.0 + 0.9e-6), 50_000.0 * (1.0 + 1.1e-6)
    for half_width, n in ((0.0, 0), (0.9e-6, 0), (1.0 + 0.9e-6, 1), (all_but, 50_000), (1.0 * MOST_STEPS, MOST_STEPS)):
        assert _n_steps(half_width, 1.0, "offsets", "m") == n
    for half_width in (1.1e-6, 1.0 + 1.1e-6, beyond, 0.5):
        with pytest.raises(SearchSpaceError, match="a multiple of its step"):
            _n_steps(half_width, 1.0, "offsets", "m")
    with pytest.raises(SearchSpaceError, match="at most 100,000 cells in the half width of the offsets"):
        _n_steps(MOST_STEPS + 1.0, 1.0, "offsets", "m")


@pytest.mark.parametrize(("reach", "options", "held"), [
    (0.0, {}, 0.0),
    (1.0, {}, 1.0),
    (1.0 + 0.9e-9, {}, 1.0),
    (1.0 + 1.5e-9, {}, 2.0),
    (50_000.0 * (1.0 + 0.5e-9), {}, 50_000.0),
    (50_000.0 * (1.0 + 1.5e-9), {}, 50_001.0),
    (1.0, {"margin": 0.5}, 2.0),
    (0.0, {"margin": 0.5}, 0.0),
    (MOST_STEPS - 0.5, {"margin": 0.5}, MOST_STEPS),
    (2.5 * MOST_STEPS, {}, 2.5 * MOST_STEPS),  # too many steps: left for the space to refuse
    (2.5 * MOST_STEPS, {"largest": 1.5 * MOST_STEPS}, 1.5 * MOST_STEPS),
    (2.5 * MOST_STEPS, {"largest": 10.5}, 10.0),
])  # fmt: skip
def test_what_is_reached_is_held_up_to_a_billionth(reach, options, held):
    assert rounded_up(reach, 1.0, **options) == held
