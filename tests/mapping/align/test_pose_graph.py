# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Ties of known errors: what the graph makes of them, and whether its covariance holds."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_corrections import rounds_of

from maxcon.geometry import Pose
from maxcon.mapping.align.corrections import Corrections, rotated
from maxcon.mapping.align.matching import Tie
from maxcon.mapping.align.pose_graph import Georeference, adjust, adjust_by_evidence
from maxcon.mapping.align.residuals import is_contradicted, pair_residuals, remaining_sigma
from maxcon.mapping.align.tie_equations import TieEquations
from maxcon.mapping.align.tied import datum_sigma, tied_rounds

PRIOR = Georeference(0.1, math.radians(0.05))
SIGMAS = np.repeat([0.003, math.radians(0.01)], 3)


def pose_of(twist):
    return Pose.from_rotation(twist[:3], Rotation.from_rotvec(twist[3:]).as_matrix())


def campaign(seed, n_rounds=4, duration=60, drift=0.0, every=4, noise=1.0):
    """Rounds with the motions that would correct them, and exact or noisy ties of all pairs along the way."""
    rng = np.random.default_rng(seed)
    rounds = rounds_of([duration] * n_rounds, seed)
    none = Corrections.none(rounds, 10.0)
    wholes = rng.normal(size=(n_rounds, 6)) * PRIOR.sigmas
    knots = rng.normal(size=none.knots.shape) * PRIOR.sigmas * (drift / PRIOR.sigma)
    true = none.changed(wholes, knots)
    ties = []
    for step in range(2, duration, every):
        place = np.array([8.0 * step, rng.normal(0.0, 8.0), 2.0])
        for one in range(n_rounds):
            for other in range(one + 1, n_rounds):
                times = (1000.0 * one + step, 1000.0 * other + step)
                ties.append(tie_of(true, place, (one, other), times, rng.normal(size=6) * SIGMAS * noise))
    return rounds, none, true, ties


def tie_of(true, place, rounds, times, error):
    """What a match of two rounds would find that `true` corrects."""
    first, second = (pose_of(true.twist_at(place, time, number)) for time, number in zip(times, rounds, strict=True))
    pose = first.inverse @ second @ pose_of(error)
    return Tie(place, rounds, times, pose, np.diag(SIGMAS**2), 0.8)


def spread(true, corrections, ties):
    """How far rounds that are corrected lie from where they are truly, beside each other, at ties, m."""
    found = []
    for tie in ties:
        left = [
            corrections.twist_at(tie.place, time, number)[:3] - true.twist_at(tie.place, time, number)[:3]
            for time, number in zip(tie.times, tie.rounds, strict=True)
        ]
        found.append(np.linalg.norm(left[0] - left[1]))
    return np.array(found)


def test_exact_ties_bring_rigid_rounds_together():
    _rounds, none, true, ties = campaign(0, noise=0.0)
    adjusted = adjust(TieEquations(none, ties), PRIOR, 0.0)
    assert spread(true, none, ties).max() > 0.1
    assert spread(true, adjusted.corrections, ties).max() < 0.001  # the prior draws a little
    np.testing.assert_allclose(adjusted.weights, 1.0)
    # the datum is the mean of the priors: what all rounds share stays where it was
    np.testing.assert_allclose(adjusted.corrections.wholes[:, :3].mean(axis=0), 0.0, atol=0.02)


def test_residuals_are_what_ties_say_of_corrected_rounds():
    _rounds, _none, true, ties = campaign(1)
    corrections = true.changed(true.wholes + 0.01, true.knots)
    adjusted = adjust(TieEquations(corrections, ties), PRIOR, 0.0)
    for tie, residual in list(zip(ties, adjusted.residuals, strict=True))[:20]:
        first, second = (
            pose_of(adjusted.corrections.twist_at(tie.place, time, number))
            for time, number in zip(tie.times, tie.rounds, strict=True)
        )
        left = first @ tie.pose @ second.inverse
        np.testing.assert_allclose(residual[:3], left.position, atol=1e-12)
        np.testing.assert_allclose(rotated(np.eye(3), np.tile(residual[3:], (3, 1))).T, left.rotation, atol=1e-12)


def test_the_covariance_holds():
    """Normalized squared errors of positions beside each other, over campaigns, are those of chi-squared."""
    squares = []
    for seed in range(30):
        _rounds, none, true, ties = campaign(seed, n_rounds=3, every=10)
        adjusted = adjust(TieEquations(none, ties), PRIOR, 0.0)
        tie = ties[4]
        rows = [
            adjusted.twist_rows(tie.place, time, number)[:3] for time, number in zip(tie.times, tie.rounds, strict=True)
        ]
        twists = [
            adjusted.corrections.twist_at(tie.place, time, number) - true.twist_at(tie.place, time, number)
            for time, number in zip(tie.times, tie.rounds, strict=True)
        ]
        error = (twists[0] - twists[1])[:3]
        squares.append(error @ np.linalg.solve(adjusted.covariance(rows[0] - rows[1]), error))
    assert 1.8 < np.mean(squares) < 4.8  # three degrees of freedom


@pytest.mark.parametrize("drift", [0.0, 0.02])
def test_ties_tell_whether_rounds_drift(drift):
    _rounds, none, true, ties = campaign(2, drift=drift)
    adjusted = adjust_by_evidence(none, ties, PRIOR, None)
    assert (adjusted.drift_sigma == 0.0) == (drift == 0.0)
    if drift:
        assert 0.005 <= adjusted.drift_sigma <= 0.05
        rigid = adjust_by_evidence(none, ties, PRIOR, 0.0)
        assert np.median(spread(true, rigid.corrections, ties)) > 0.01
    assert np.median(spread(true, adjusted.corrections, ties)) < 0.005


def test_wrong_ties_do_not_bend_the_graph():
    _rounds, none, true, ties = campaign(3)
    rng = np.random.default_rng(0)
    wrong = rng.choice(len(ties), len(ties) // 5, replace=False)
    for number in wrong.tolist():
        tie = ties[number]
        period = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0])  # posts of a fence
        ties[number] = tie_of(true, tie.place, tie.rounds, tie.times, period)
    adjusted = adjust(TieEquations(none, ties), PRIOR, 0.0)
    assert spread(true, adjusted.corrections, ties).max() < 0.005
    contradicted = [number for number, weight in enumerate(adjusted.weights) if is_contradicted(weight)]
    assert contradicted == sorted(wrong.tolist())
    (pair, *_) = pair_residuals(ties, adjusted)
    assert pair.horizontal_after[1] < 0.02
    assert remaining_sigma(ties, adjusted, is_after=True) < 0.004


def test_what_no_tie_tells_stays_at_its_prior():
    rounds, none, _true, ties = campaign(4, n_rounds=3)
    # a street along x, where matches are open; and a round that nobody met
    covariance = np.diag(SIGMAS**2)
    covariance[0, 0] = 1.0
    ties = [Tie(tie.place, tie.rounds, tie.times, tie.pose, covariance, 0.8) for tie in ties if 2 not in tie.rounds]
    adjusted = adjust(TieEquations(none, ties), PRIOR, 0.0)
    first, _second, third = tied_rounds(rounds, ties, adjusted, PRIOR)
    assert first.sigma[0] > 0.09
    assert first.sigma[1] < 0.004
    assert "round 1 is not tied along 0 degrees" in first.words or "along 180 degrees" in first.words
    assert third.n_ties == 0
    assert "cannot be tied to any other" in third.words
    np.testing.assert_allclose(third.shift, 0.0, atol=1e-12)
    np.testing.assert_allclose(third.sigma, 0.1, rtol=1e-6)


def test_sets_of_rounds_that_never_met_are_told():
    rounds, none, _true, ties = campaign(5, n_rounds=5)
    ties = [tie for tie in ties if (tie.rounds[0] < 3) == (tie.rounds[1] < 3)]
    tied = tied_rounds(rounds, ties, adjust(TieEquations(none, ties), PRIOR, 0.0), PRIOR)
    assert [each.group for each in tied] == [0, 0, 0, 1, 1]
    assert tied[3].words == "round 4 is tied to round 5 only, not to the other rounds"
    assert not any(each.words for each in tied[:3])


def test_the_datum_is_known_as_the_mean_of_the_priors():
    rounds, none, _true, ties = campaign(6, n_rounds=4)
    adjusted = adjust(TieEquations(none, ties), PRIOR, 0.0)
    assert datum_sigma(rounds, adjusted) > 0.1 / math.sqrt(4)
    assert datum_sigma(rounds, adjusted) < 2.0 * 0.1 / math.sqrt(4)


def test_noise_larger_than_said_makes_all_of_it_less_sure():
    _rounds, none, _true, ties = campaign(7, noise=3.0)
    assert adjust(TieEquations(none, ties), PRIOR, 0.0).inflation == pytest.approx(3.0, rel=0.15)
