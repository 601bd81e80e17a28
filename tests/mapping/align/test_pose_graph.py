# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Constraints of known errors: what the graph makes of them, and whether its covariance holds."""

import math

import numpy as np
import pytest
from test_corrections import passes_of

from maxcon.mapping.align.alignment import (
    connectivity_of_passes,
    datum_sigma,
    is_contradicted,
    pair_residuals,
    remaining_sigmas,
)
from maxcon.mapping.align.passes import Corrections, pose_of_twist
from maxcon.mapping.align.pose_graph import Equations, adjust, adjust_by_evidence
from maxcon.mapping.align.visits import Constraint

PRIOR = np.repeat([0.1, math.radians(0.05)], 3)
SIGMAS = np.repeat([0.003, math.radians(0.01)], 3)


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


def test_exact_constraints_bring_rigid_passes_together():
    _passes, none, true, constraints = campaign(0, noise=0.0)
    adjusted = adjust(Equations(none, constraints), PRIOR, 0.0)
    assert spread(true, none, constraints).max() > 0.1
    assert spread(true, adjusted.corrections, constraints).max() < 0.001  # the prior draws a little
    np.testing.assert_allclose(adjusted.weights, 1.0)
    # the datum is the mean of the priors: what all passes share stays where it was
    np.testing.assert_allclose(adjusted.corrections.wholes[:, :3].mean(axis=0), 0.0, atol=0.02)


def test_residuals_are_what_constraints_say_of_corrected_passes():
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
    contradicted = [number for number, weight in enumerate(adjusted.weights) if is_contradicted(weight)]
    assert contradicted == sorted(wrong.tolist())
    (pair, *_) = pair_residuals(constraints, adjusted)
    assert pair.horizontal_after[1] < 0.02
    assert remaining_sigmas(constraints, adjusted)[1] < 0.004


def test_what_no_constraint_tells_stays_at_its_prior():
    passes, none, _true, constraints = campaign(4, n_passes=3)
    # a street along x, where matches are open; and a pass that nobody met
    covariance = np.diag([1.0, *SIGMAS[1:] ** 2])
    constraints = [each._replace(covariance=covariance) for each in constraints if 2 not in each.passes]
    adjusted = adjust(Equations(none, constraints), PRIOR, 0.0)
    first, _second, third = connectivity_of_passes(passes, constraints, adjusted, PRIOR)
    assert first.sigma[0] > 0.09
    assert first.sigma[1] < 0.004
    assert "pass 1 is not determined along 0 degrees" in first.words or "along 180 degrees" in first.words
    assert third.n_constraints == 0
    assert "cannot be connected to any other" in third.words
    np.testing.assert_allclose(third.shift, 0.0, atol=1e-12)
    np.testing.assert_allclose(third.sigma, 0.1, rtol=1e-6)


def test_sets_of_passes_that_never_met_are_told():
    passes, none, _true, constraints = campaign(5, n_passes=5)
    constraints = [each for each in constraints if (each.passes[0] < 3) == (each.passes[1] < 3)]
    tied = connectivity_of_passes(passes, constraints, adjust(Equations(none, constraints), PRIOR, 0.0), PRIOR)
    assert [each.component for each in tied] == [0, 0, 0, 1, 1]
    assert tied[3].words == "pass 4 is connected to pass 5 only, not to the other passes"
    assert not any(each.words for each in tied[:3])


def test_the_datum_is_the_mean_of_the_priors_and_larger_noise_makes_all_less_sure():
    passes, none, _true, constraints = campaign(6)
    mean = PRIOR[0] / math.sqrt(4)
    assert mean < datum_sigma(passes, adjust(Equations(none, constraints), PRIOR, 0.0)) < 2.0 * mean
    _passes, none, _true, constraints = campaign(7, noise=3.0)
    assert adjust(Equations(none, constraints), PRIOR, 0.0).inflation == pytest.approx(3.0, rel=0.15)
