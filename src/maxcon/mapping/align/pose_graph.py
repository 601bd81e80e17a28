# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""The pose graph: corrections from all ties and from the georeference of rounds, by robust sparse least squares."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.align.corrections import Corrections
from maxcon.mapping.align.matching import Tie
from maxcon.mapping.align.tie_equations import TieEquations

__all__ = ["Adjusted", "Georeference", "adjust", "adjust_by_evidence"]

CORRELATION_TIME = 60.0
"""s; errors of a trajectory so far apart in time correlate by 1/e."""
DRIFTS = (0.0, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2)
"""Standard deviations of the drift that are tried, m; 0: rounds are rigid."""
MARGIN = 3.0
"""A larger drift is taken if the logarithm of the evidence grows by this: it is twenty times as likely."""
FREEDOM = 4.0
"""Degrees of freedom of the Student distribution of residuals: a tie 5 sigmas off weighs a third, 20 a fortieth."""
USUAL_SQUARE = 5.348
"""Median of a chi-squared variable of six degrees of freedom."""
MOST_STEPS, AT_REST = 50, 3e-4
"""Most steps of an adjustment; it ends before when no unknown changes by more than this share of its prior's sigma."""


@dataclass(frozen=True, slots=True)
class Georeference:
    """How well each round was georeferenced before: the prior of its correction.

    Parameters
    ----------
    sigma : float
        Standard deviation of a round's position along any axis, m.
    sigma_turn : float
        The same of its roll, pitch and heading, rad.
    """

    sigma: float
    sigma_turn: float

    @property
    def sigmas(self) -> NDArray[np.float64]:
        """Standard deviations of a twist, shape (6,), m and rad."""
        return np.repeat([self.sigma, self.sigma_turn], 3)


@dataclass(frozen=True, eq=False)
class Adjusted:
    """The outcome of an adjustment.

    Parameters
    ----------
    corrections : Corrections
        Corrections of all rounds.
    drift_sigma : float
        Standard deviation of the drift that was allowed, m; 0 for rigid rounds.
    residuals : array, shape (n, 6)
        Of each tie: the twist by which its second visit would still have to be moved onto its first.
    weights : array, shape (n,)
        Of each tie, 0 to 1: small for those that contradict the others.
    inflation : float
        Factor on the standard deviations of all ties that makes them agree with the residuals; at least 1.
    evidence : float
        Logarithm of the probability of the ties under this drift, up to a constant that is the same for all drifts.
    """

    corrections: Corrections
    drift_sigma: float
    residuals: NDArray[np.float64]
    weights: NDArray[np.float64]
    inflation: float
    evidence: float
    _graph: "_Graph"
    _factor: Any

    def covariance(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariance (k, k) of linear functions of the unknowns with these coefficients, shape (k, n_unknowns)."""
        scaled = rows * self._graph.scales
        return np.asarray(scaled @ self._factor.solve(np.ascontiguousarray(scaled.T)))

    def twist_rows(self, place: NDArray[np.float64], time: float, number: int) -> NDArray[np.float64]:
        """Derivatives (6, n_unknowns) of the twist at a place (global, m) that a round measured at a time (s)."""
        return self._graph.twist_rows(place, time, number)


def adjust_by_evidence(
    corrections: Corrections, ties: Sequence[Tie], georeference: Georeference, drift_sigma: float | None
) -> Adjusted:
    """Adjust with a given drift, or with the smallest one that explains the ties.

    Parameters
    ----------
    corrections : Corrections
        To start from.
    ties : sequence of Tie
        Without a fault.
    georeference : Georeference
        The prior.
    drift_sigma : float or None
        Standard deviation of drift, m; None to let the ties decide.

    Notes
    -----
    The evidence is the probability of the ties under a drift, with all unknowns integrated over: a larger drift fits
    better, and pays for the freedom that it has. Weights and inflation are those of the largest drift: with those of
    rigid rounds, ties that show a drift would be taken for wrong matches.
    """
    equations = TieEquations(corrections, ties)
    if drift_sigma is not None:
        return adjust(equations, georeference, drift_sigma)
    largest = adjust(equations, georeference, DRIFTS[-1])
    fixed = (largest.weights, largest.inflation)
    best = adjust(equations, georeference, DRIFTS[0], fixed)
    for drift in DRIFTS[1:]:
        other = adjust(equations, georeference, drift, fixed)
        if other.evidence > best.evidence + MARGIN:
            best = other
    return adjust(equations, georeference, best.drift_sigma)


def adjust(
    equations: TieEquations,
    georeference: Georeference,
    drift_sigma: float,
    fixed: tuple[NDArray[np.float64], float] | None = None,
) -> Adjusted:
    """Adjust the corrections of all rounds to all ties and to their prior, which is zero.

    Parameters
    ----------
    equations : TieEquations
        Of the ties, with the corrections to start from.
    georeference : Georeference
        The prior of each round as a whole.
    drift_sigma : float
        Standard deviation of drift along any axis, m; that of turns is to it as in the prior.
    fixed : tuple of array, shape (n,), and float, optional
        Weights of the ties, and their inflation; found with the corrections if None.

    Notes
    -----
    Gauss-Newton steps with sparse normal equations, reweighted: residuals are taken to follow a
    multivariate Student distribution, so that a wrong tie weighs the less the farther it is off.
    """
    from scipy.sparse.linalg import splu

    graph = _Graph(equations, georeference, drift_sigma)
    weights, inflation = fixed or (np.ones(len(equations)), 1.0)
    unknowns = graph.unknowns(equations.corrections)
    for _ in range(MOST_STEPS):
        residuals = equations.residuals(graph.corrections(unknowns))
        if fixed is None:
            weights, inflation = _reweighted(equations.whitened(residuals))
        matrix, right_side = graph.normal_equations(unknowns, residuals, weights / inflation**2)
        factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}, diag_pivot_thresh=0.0)
        step = factor.solve(right_side)
        unknowns = unknowns + step * graph.scales
        if not np.abs(step).max(initial=0.0) > AT_REST:
            break
    residuals = equations.residuals(graph.corrections(unknowns))
    squares = (equations.whitened(residuals) ** 2).sum(axis=1) @ (weights / inflation**2)
    prior = unknowns / graph.scales
    log_determinant = float(np.log(np.abs(factor.U.diagonal())).sum())
    evidence = 0.5 * (graph.log_prior - squares - float(prior @ (graph.prior @ prior)) - log_determinant)
    return Adjusted(
        graph.corrections(unknowns), drift_sigma, residuals, weights, inflation, float(evidence), graph, factor
    )


def _reweighted(whitened: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Weights of ties (n,) and their inflation, from whitened residuals (n, 6)."""
    squares = (whitened**2).sum(axis=1)
    inflation = max(1.0, math.sqrt(float(np.median(squares)) / USUAL_SQUARE)) if len(squares) else 1.0
    weights = (FREEDOM + 6.0) / (FREEDOM + squares / inflation**2)
    return np.minimum(weights, 1.0), inflation


class _Graph:
    """Ties and priors as sparse equations in unknowns divided by `scales`, the standard deviations of their priors.

    Rigid rounds have no unknowns of knots.
    """

    def __init__(self, equations: TieEquations, georeference: Georeference, drift_sigma: float) -> None:
        self._equations = equations
        self._has_drift = drift_sigma > 0.0
        self._corrections = corrections = equations.corrections
        n_knots = len(corrections.knots) if self._has_drift else 0
        drifts = georeference.sigmas * (drift_sigma / georeference.sigma)
        self.scales = np.concatenate([np.tile(georeference.sigmas, corrections.n_rounds), np.tile(drifts, n_knots)])
        self.n_unknowns = len(self.scales)
        self._design = equations.design(self.scales)

    def unknowns(self, corrections: Corrections) -> NDArray[np.float64]:
        """Return the unknowns of corrections, m and rad."""
        knots = corrections.knots.ravel() if self._has_drift else np.empty(0)
        return np.concatenate([corrections.wholes.ravel(), knots])

    def corrections(self, unknowns: NDArray[np.float64]) -> Corrections:
        """Return the corrections of unknowns."""
        start, n_whole = self._corrections, self._equations.n_whole
        knots = unknowns[n_whole:].reshape(-1, 6) if self._has_drift else np.zeros_like(start.knots)
        return start.changed(unknowns[:n_whole].reshape(-1, 6), knots)

    def twist_rows(self, place: NDArray[np.float64], time: float, number: int) -> NDArray[np.float64]:
        """See `Adjusted.twist_rows`."""
        rows = np.zeros((6, self.n_unknowns))
        for column, block in self._equations.blocks(place, time, number):
            if column < self.n_unknowns:
                rows[:, column : column + 6] += block
        return rows

    @cached_property
    def prior(self) -> Any:
        """Inverse covariance of the scaled unknowns a priori, sparse: a drift is a Gauss-Markov process."""
        from scipy.sparse import block_diag, eye_array, kron

        parts = [eye_array(self._equations.n_whole)]
        if self._has_drift:
            for step, n in zip(self._corrections.steps, np.diff(self._corrections.firsts), strict=True):
                parts.append(kron(_gauss_markov(int(n), step), eye_array(6)))
        return block_diag(parts, format="csc")

    @property
    def log_prior(self) -> float:
        """Logarithm of the determinant of `prior`."""
        if not self._has_drift:
            return 0.0
        total = 0.0
        for step, n in zip(self._corrections.steps, np.diff(self._corrections.firsts), strict=True):
            total -= 6.0 * (int(n) - 1) * math.log(1.0 - math.exp(-2.0 * step / CORRELATION_TIME))
        return total

    def normal_equations(
        self, unknowns: NDArray[np.float64], residuals: NDArray[np.float64], weights: NDArray[np.float64]
    ) -> tuple[Any, NDArray[np.float64]]:
        """Matrix and right side of a Gauss-Newton step in scaled unknowns, from residuals (n, 6) and weights (n,)."""
        from scipy.sparse import csc_array, diags_array

        weighted = diags_array(np.repeat(weights, 6)) @ self._design
        right_side = weighted.T @ self._equations.whitened(residuals).ravel() - self.prior @ (unknowns / self.scales)
        return csc_array(self._design.T @ weighted + self.prior), right_side


def _gauss_markov(n: int, step: float) -> Any:
    """Inverse covariance of n values of a Gauss-Markov process of variance 1, `step` seconds apart, sparse."""
    from scipy.sparse import diags_array

    kept = math.exp(-step / CORRELATION_TIME)
    diagonal = np.full(n, (1.0 + kept * kept) / (1.0 - kept * kept))
    diagonal[[0, -1]] = 1.0 / (1.0 - kept * kept)
    beside = np.full(n - 1, -kept / (1.0 - kept * kept))
    return diags_array([beside, diagonal, beside], offsets=[-1, 0, 1])
