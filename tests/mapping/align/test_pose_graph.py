"""Passes, their corrections, and constraints of known errors: what the graph makes of them, with its covariance."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from maxcon.errors import FileError, OptionError
from maxcon.mapping.align import alignment
from maxcon.mapping.align.passes import Corrections, Pass, Passes, pose_of_twist, read_passes, survey
from maxcon.mapping.align.pose_graph import Equations, adjust, adjust_by_evidence
from maxcon.mapping.align.visits import Constraint
from maxcon.mapping.build.sources import open_headers

PRIOR = np.repeat([0.1, math.radians(0.05)], 3)
SIGMAS = np.repeat([0.003, math.radians(0.01)], 3)
TIMES = np.array([7.2, 8.9, 9.1, 100.4, 101.2, 160.0])
POINTS = np.arange(18.0).reshape(6, 3)


def campaign(seed, n_passes=4, duration=60, drift=0.0, every=4, noise=1.0):
    """Passes with the motions that would correct them, and exact or noisy constraints of all pairs along the way."""
    rng = np.random.default_rng(seed)
    passes = passes_of([duration] * n_passes, seed)
    none = Corrections.none(passes, 10.0)
    wholes = rng.normal(size=(n_passes, 6)) * PRIOR
    knots = rng.normal(size=none.knots.shape) * PRIOR * (drift / PRIOR[0])
    true = none.changed(wholes, knots)
    constraints = []
    for step in range(2, duration, every):
        place = np.array([8.0 * step, rng.normal(0.0, 8.0), 2.0])
        for one in range(n_passes):
            for other in range(one + 1, n_passes):
                times = (1000.0 * one + step, 1000.0 * other + step)
                constraints.append(constraint_of(true, place, (one, other), times, rng.normal(size=6) * SIGMAS * noise))
    return passes, none, true, constraints


def constraint_of(true, place, passes, times, error):
    """What a match of two passes would find that `true` corrects."""
    first, second = (pose_of_twist(true.twist_at(place, at, number)) for at, number in zip(times, passes, strict=True))
    pose = first.inverse @ second @ pose_of_twist(error)
    return Constraint(place, passes, times, pose, np.diag(SIGMAS**2), 0.8)


def ends_of(constraint):
    """Place, time and pass of both ends."""
    return [(constraint.place, *end) for end in zip(constraint.times, constraint.passes, strict=True)]


def spread(true, corrections, constraints):
    """How far passes that are corrected lie from where they are truly, beside each other, at constraints, m."""
    found = []
    for constraint in constraints:
        left = [(corrections.twist_at(*end) - true.twist_at(*end))[:3] for end in ends_of(constraint)]
        found.append(np.linalg.norm(left[0] - left[1]))
    return np.array(found)


def test_exact_constraints_bring_passes_together_and_residuals_are_what_they_say():
    _passes, none, true, constraints = campaign(0, noise=0.0)
    adjusted = adjust(Equations(none, constraints), PRIOR, 0.0)
    assert spread(true, none, constraints).max() > 0.1
    assert spread(true, adjusted.corrections, constraints).max() < 0.001  # the prior draws a little
    np.testing.assert_allclose(adjusted.weights, 1.0)
    # the datum is the mean of the priors: what all passes share stays where it was
    np.testing.assert_allclose(adjusted.corrections.wholes[:, :3].mean(axis=0), 0.0, atol=0.02)
    _passes, _none, true, constraints = campaign(1)
    corrections = true.changed(true.wholes + 0.01, true.knots)
    adjusted = adjust(Equations(corrections, constraints), PRIOR, 0.0)
    for constraint, residual in list(zip(constraints, adjusted.residuals, strict=True))[:20]:
        first, second = (pose_of_twist(adjusted.corrections.twist_at(*end)) for end in ends_of(constraint))
        left = first @ constraint.pose @ second.inverse
        np.testing.assert_allclose(residual[:3], left.position, atol=1e-12)
        np.testing.assert_allclose(pose_of_twist(residual).rotation, left.rotation, atol=1e-12)


def test_the_covariance_holds():
    """Normalized squared errors of positions beside each other, over campaigns, are those of chi-squared."""
    squares = []
    for seed in range(20):
        _passes, none, true, constraints = campaign(seed, n_passes=3, every=10)
        adjusted = adjust(Equations(none, constraints), PRIOR, 0.0)
        constraint = constraints[4]
        rows = [adjusted.twist_rows(*where)[:3] for where in ends_of(constraint)]
        twists = [adjusted.corrections.twist_at(*where) - true.twist_at(*where) for where in ends_of(constraint)]
        error = (twists[0] - twists[1])[:3]
        squares.append(error @ np.linalg.solve(adjusted.covariance(rows[0] - rows[1]), error))
    assert 1.8 < np.mean(squares) < 4.8  # three degrees of freedom


@pytest.mark.parametrize("drift", [0.0, 0.02])
def test_constraints_tell_whether_passes_drift(drift):
    _passes, none, true, constraints = campaign(2, drift=drift)
    adjusted = adjust_by_evidence(none, constraints, PRIOR, None)
    assert (adjusted.drift_sigma == 0.0) == (drift == 0.0)
    if drift:
        assert 0.005 <= adjusted.drift_sigma <= 0.05
        rigid = adjust_by_evidence(none, constraints, PRIOR, 0.0)
        assert np.median(spread(true, rigid.corrections, constraints)) > 0.01
    assert np.median(spread(true, adjusted.corrections, constraints)) < 0.005


def test_wrong_constraints_do_not_bend_the_graph():
    _passes, none, true, constraints = campaign(3)
    rng = np.random.default_rng(0)
    wrong = rng.choice(len(constraints), len(constraints) // 5, replace=False)
    for number in wrong.tolist():
        constraint = constraints[number]
        period = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0])  # posts of a fence
        constraints[number] = constraint_of(true, constraint.place, constraint.passes, constraint.times, period)
    adjusted = adjust(Equations(none, constraints), PRIOR, 0.0)
    assert spread(true, adjusted.corrections, constraints).max() < 0.005
    contradicted = [number for number, weight in enumerate(adjusted.weights) if alignment.is_contradicted(weight)]
    assert contradicted == sorted(wrong.tolist())
    (pair, *_) = alignment.pair_residuals(constraints, adjusted)
    assert pair.horizontal_after[1] < 0.02
    assert alignment.remaining_sigmas(constraints, adjusted)[1] < 0.004


def test_what_no_constraint_tells_stays_at_its_prior():
    passes, none, _true, constraints = campaign(4, n_passes=3)
    # a street along x, where matches are open; and a pass that nobody met
    covariance = np.diag([1.0, *SIGMAS[1:] ** 2])
    constraints = [each._replace(covariance=covariance) for each in constraints if 2 not in each.passes]
    adjusted = adjust(Equations(none, constraints), PRIOR, 0.0)
    first, _second, third = alignment.connectivity_of_passes(passes, constraints, adjusted, PRIOR)
    assert first.sigma[0] > 0.09 and first.sigma[1] < 0.004
    assert "pass 1 is not determined along 0 degrees" in first.words or "along 180 degrees" in first.words
    assert third.n_constraints == 0 and "cannot be connected to any other" in third.words
    np.testing.assert_allclose(third.shift, 0.0, atol=1e-12)
    np.testing.assert_allclose(third.sigma, 0.1, rtol=1e-6)


def test_sets_of_passes_that_never_met_are_told():
    passes, none, _true, constraints = campaign(5, n_passes=5)
    constraints = [each for each in constraints if (each.passes[0] < 3) == (each.passes[1] < 3)]
    tied = alignment.connectivity_of_passes(
        passes, constraints, adjust(Equations(none, constraints), PRIOR, 0.0), PRIOR
    )
    assert [each.component for each in tied] == [0, 0, 0, 1, 1]
    assert tied[3].words == "pass 4 is connected to pass 5 only, not to the other passes"
    assert not any(each.words for each in tied[:3])


def test_the_datum_is_the_mean_of_the_priors_and_larger_noise_makes_all_less_sure():
    passes, none, _true, constraints = campaign(6)
    mean = PRIOR[0] / math.sqrt(4)
    assert mean < alignment.datum_sigma(passes, adjust(Equations(none, constraints), PRIOR, 0.0)) < 2.0 * mean
    _passes, none, _true, constraints = campaign(7, noise=3.0)
    assert adjust(Equations(none, constraints), PRIOR, 0.0).inflation == pytest.approx(3.0, rel=0.15)


def silent(step, done, total):
    pass


def numbers(passes, headers):
    parts = [(file, part) for file, header in enumerate(headers) for part in read_passes(header)]
    return np.concatenate([passes.of_points(part.times, part.source_ids, file) for file, part in parts]).tolist()


@pytest.fixture
def headers(tmp_path, write_las):
    one = write_las(tmp_path / "b.las", POINTS[3:], TIMES[3:], source_ids=[7, 7, 3])
    other = write_las(tmp_path / "a.las", POINTS[:3], TIMES[:3], source_ids=[3, 3, 7])
    return open_headers([one, other])


def test_pauses_tell_passes_apart_in_order_of_time(headers):
    passes = survey(headers, "time", 20.0, silent)
    assert [each.name for each in passes] == ["pass 1", "pass 2", "pass 3"]
    assert [(each.start, each.end) for each in passes.passes] == [(7.0, 10.0), (100.0, 102.0), (160.0, 161.0)]
    assert numbers(passes, headers) == [1, 1, 2, 0, 0, 0] and passes.are_apart
    assert passes.at(np.array([0.0, 50.0, 60.0, 140.0, 1e6])).tolist() == [0, 0, 1, 2, 2]
    assert len(survey(headers, "time", 70.0, silent)) == 2
    first = passes.passes[0]  # a second has the mean of its points
    np.testing.assert_allclose(first.times, [7.5, 8.5, 9.5])
    np.testing.assert_allclose(first.middles - [550_000, 5_802_000, 60], POINTS[:3], atol=1e-6)
    np.testing.assert_allclose(first.centre - [550_000, 5_802_000, 60], POINTS[:3].mean(axis=0), atol=1e-6)


def test_files_and_sources_tell_passes_apart(headers):
    by_file, by_source = (survey(headers, by, 20.0, silent) for by in ("file", "source"))
    assert [each.name for each in by_file.passes] == ["a.las", "b.las"]
    assert numbers(by_file, headers) == [1, 1, 1, 0, 0, 0]
    assert [each.name for each in by_source.passes] == ["source 3", "source 7"]
    assert numbers(by_source, headers) == [1, 1, 0, 0, 0, 1] and by_file.are_apart
    assert not by_source.are_apart


def test_what_is_refused(tmp_path, headers, write_las, monkeypatch):
    untimed = open_headers([write_las(tmp_path / "c.las", POINTS, TIMES, point_format=0, version="1.2")])
    with pytest.raises(OptionError, match="--passes file"):
        survey(untimed, "time", 20.0, silent)
    assert survey(untimed, "file", 20.0, silent).passes[0].times.tolist() == [0.5]
    text = tmp_path / "a.xyz"
    text.write_text("1 2 3\n4 5 6\n")
    with pytest.raises(FileError, match="Expected LAS or LAZ"):
        survey(open_headers([text]), "file", 20.0, silent)
    with pytest.raises(OptionError, match="time, source, file"):
        survey(headers, "colour", 20.0, silent)
    not_finite = write_las(tmp_path / "nan.las", POINTS, np.where(TIMES == 9.1, np.nan, TIMES))
    with pytest.raises(FileError, match="finite times"):
        survey(open_headers([not_finite]), "time", 20.0, silent)
    monkeypatch.setattr("maxcon.mapping.align.passes.MOST_SECONDS", 4)  # times that are none fill the memory
    with pytest.raises(OptionError, match="Are these times"):
        survey(headers, "time", 20.0, silent)


def passes_of(durations, seed=0):
    """Passes of some seconds each, a hundred apart, along x."""
    rng = np.random.default_rng(seed)
    passes = []
    for number, duration in enumerate(durations):
        times = 1000.0 * number + np.arange(duration) + 0.5
        middles = np.column_stack([8.0 * np.arange(duration), rng.normal(0.0, 3.0, (duration, 2))])
        passes.append(Pass(f"pass {number + 1}", times, middles, 1000, middles.mean(axis=0)))
    return Passes("time", tuple(passes), np.zeros(len(passes), np.int64))


def some_corrections(seed, durations=(45, 3, 20), size=1.0):
    rng = np.random.default_rng(seed)
    none = Corrections.none(passes_of(durations, seed), 10.0)
    sigmas = size * np.repeat([0.1, 0.01], 3)
    return none.changed(rng.normal(size=(len(durations), 6)) * sigmas, rng.normal(size=(len(none.knots), 6)) * sigmas)


def some_points(seed, corrections, n=50):
    rng = np.random.default_rng(seed)
    passes = rng.integers(0, len(corrections.centres), n)
    times = 1000.0 * passes + rng.uniform(-5.0, 50.0, n)
    return rng.uniform(-200.0, 200.0, (n, 3)), times, passes


@given(st.integers(0, 1000))
def test_without_drift_a_pass_moves_as_one_and_without_corrections_not_at_all(seed):
    corrections = some_corrections(seed)
    points, times, passes = some_points(seed, corrections)
    none = Corrections.none(passes_of((45, 3, 20)), 10.0)
    np.testing.assert_allclose(none.moved(points, times, passes), points, atol=1e-12)
    corrections = corrections.changed(corrections.wholes, np.zeros_like(corrections.knots))
    turns = Rotation.from_rotvec(corrections.wholes[passes, 3:])
    centres = corrections.centres[passes]
    wanted = turns.apply(points - centres) + centres + corrections.wholes[passes, :3]
    np.testing.assert_allclose(corrections.moved(points, times, passes), wanted, atol=1e-9)


@given(st.integers(0, 1000))
def test_nothing_jumps_at_a_knot(seed):
    corrections = some_corrections(seed)
    points, _, _ = some_points(seed, corrections)
    at_knot = corrections.starts[0] + corrections.steps[0] * np.arange(1, 4)
    for time in at_knot:
        before, after = (
            corrections.moved(points, np.full(len(points), time + step), np.zeros(len(points), int))
            for step in (-1e-7, 1e-7)
        )
        np.testing.assert_allclose(before, after, atol=1e-6)


def test_what_adjustment_takes_for_the_derivative_is_it():
    small = some_corrections(3, size=1e-4)
    places, times, passes = some_points(3, small)
    twists = small.jacobian(places, times, passes) @ np.concatenate([small.wholes, small.knots]).ravel()
    for *where, twist in zip(places, times, passes, twists.reshape(-1, 6), strict=True):
        np.testing.assert_allclose(small.twist_at(*where), twist, atol=1e-6)
