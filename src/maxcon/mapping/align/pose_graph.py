"""Pose graph: corrections from all constraints and from the georeference of passes, by robust sparse least squares."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.align.passes import Corrections
from maxcon.mapping.align.visits import Constraint

CORRELATION_TIME = 60.0  # s; errors of a trajectory so far apart in time correlate by 1/e
DRIFTS = (0.0, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2)  # m, sigmas of the drift that are tried; 0: passes are rigid
MARGIN = 3.0  # of the logarithm of the evidence for a larger drift: it is twenty times as likely
FREEDOM = 4.0  # degrees of a Student distribution of residuals: one of 5 sigmas weighs a third, of 20 a fortieth
USUAL_SQUARE = 5.348  # median of a chi-squared variable of six degrees of freedom
# Most steps of an adjustment; it ends before when no unknown changes by more than this part of its prior's sigma.
MOST_STEPS, AT_REST = 50, 3e-4


class Equations:
    """Residuals of constraints, and their derivatives by the twists of passes and knots, from `corrections` on."""

    def __init__(self, corrections: Corrections, constraints: Sequence[Constraint]) -> None:
        from scipy.sparse import block_diag
        from scipy.spatial.transform import Rotation

        self.corrections = corrections
        self._times = np.array([each.times for each in constraints])
        self._passes = np.array([each.passes for each in constraints], np.int64)
        self._places = np.array([each.place for each in constraints])
        self._positions = np.array([each.pose.position for each in constraints])
        self._turns = Rotation.from_matrix(np.array([each.pose.rotation for each in constraints]))
        self._roots = np.linalg.inv(np.linalg.cholesky(np.array([each.covariance for each in constraints])))
        one, other = (corrections.jacobian(self._places, self._times[:, k], self._passes[:, k]) for k in range(2))
        self._design = (block_diag(self._roots) @ (other - one)).tocsc()

    def __len__(self) -> int:
        return len(self._places)

    def residuals(self, corrections: Corrections) -> NDArray[np.float64]:
        """Twists by which each second visit would still have to be moved onto the first, shape (n, 6), m and rad."""
        from scipy.spatial.transform import Rotation

        shifts, turns = [], []
        for side in range(2):
            about, moved, vectors = corrections.motions(self._times[:, side], self._passes[:, side])
            turn, arms = Rotation.from_rotvec(vectors), self._places - about
            shifts.append(moved + turn.apply(arms) - arms)
            turns.append(turn)
        # first @ pose @ second.inverse: where it takes the origin, and how it turns
        at = self._turns.apply(turns[1].apply(-shifts[1], inverse=True)) + self._positions
        together = turns[0] * self._turns * turns[1].inv()
        return np.column_stack([turns[0].apply(at) + shifts[0], together.as_rotvec()])

    def whitened(self, residuals: NDArray[np.float64]) -> NDArray[np.float64]:
        """Residuals (n, 6) in units of the constraints' standard deviations, uncorrelated, shape (n, 6)."""
        return np.asarray(np.einsum("nij,nj->ni", self._roots, residuals))

    def design(self, scales: NDArray[np.float64]) -> Any:
        """Negative derivatives of whitened residuals by the first k unknowns, each divided by its scale, (6 n, k)."""
        from scipy.sparse import diags_array

        return (self._design[:, : len(scales)] @ diags_array(scales)).tocsr()


@dataclass(frozen=True, eq=False)
class Adjusted:
    """The outcome of an adjustment."""

    corrections: Corrections  # Corrections of all passes
    drift_sigma: float  # Standard deviation of the drift that was allowed, m; 0 for rigid passes
    # (n, 6): Of each constraint: the twist by which its second visit would still have to be moved onto its first
    residuals: NDArray[np.float64]
    weights: NDArray[np.float64]  # (n,): Of each constraint, 0 to 1: small for those that contradict the others
    inflation: float  # Factor on the sigmas of all constraints that makes them agree with the residuals; at least 1
    evidence: float  # Logarithm of the probability of the constraints under this drift, up to a common constant
    _scales: NDArray[np.float64]
    _factor: Any

    def covariance(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariance (k, k) of linear functions of the unknowns with these coefficients, shape (k, n_unknowns)."""
        scaled = rows * self._scales
        return np.asarray(scaled @ self._factor.solve(np.ascontiguousarray(scaled.T)))

    def twist_rows(self, place: NDArray[np.float64], time: float, number: int) -> NDArray[np.float64]:
        """Derivatives (6, n_unknowns) of the twist at a place (global, m) that a pass measured at a time (s)."""
        rows = self.corrections.jacobian(place[None], np.array([time]), np.array([number]))
        return np.asarray(rows.toarray()[:, : len(self._scales)])


def adjust_by_evidence(
    corrections: Corrections, constraints: Sequence[Constraint], prior_sigmas: NDArray[np.float64],
    drift_sigma: float | None,
) -> Adjusted:  # fmt: skip
    """Adjust with a given drift (m), or with the smallest one that explains the constraints.

    The evidence is the probability of the constraints under a drift, with all unknowns integrated over: a larger drift
    fits better, and pays for its freedom. Weights and inflation are those of the largest drift: with those of rigid
    passes, constraints that show a drift would be taken for wrong matches.
    """
    equations = Equations(corrections, constraints)
    if drift_sigma is not None:
        return adjust(equations, prior_sigmas, drift_sigma)
    largest = adjust(equations, prior_sigmas, DRIFTS[-1])
    fixed = (largest.weights, largest.inflation)
    best = adjust(equations, prior_sigmas, DRIFTS[0], fixed)
    for drift in DRIFTS[1:]:
        other = adjust(equations, prior_sigmas, drift, fixed)
        if other.evidence > best.evidence + MARGIN:
            best = other
    return adjust(equations, prior_sigmas, best.drift_sigma)


def adjust(
    equations: Equations, prior_sigmas: NDArray[np.float64], drift_sigma: float,
    fixed: tuple[NDArray[np.float64], float] | None = None,
) -> Adjusted:  # fmt: skip
    """Adjust the corrections of all passes to all constraints and to their prior, which is zero.

    Gauss-Newton steps with sparse normal equations, reweighted: residuals follow a multivariate Student distribution,
    so that a wrong constraint weighs the less the farther it is off, unless weights and inflation are `fixed`.
    Unknowns are divided by the sigmas of their priors, of whole passes (6,); without drift knots do not move.
    """
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import splu

    start = equations.corrections
    n_wholes, n_knots = len(start.centres), len(start.knots) if drift_sigma > 0.0 else 0
    drifts = prior_sigmas * (drift_sigma / prior_sigmas[0])
    scales = np.concatenate([np.tile(prior_sigmas, n_wholes), np.tile(drifts, n_knots)])
    design, prior, log_prior = equations.design(scales), *_prior(start, has_drift=n_knots > 0)

    def corrected(unknowns: NDArray[np.float64]) -> Corrections:
        wholes, knots = np.split(unknowns.reshape(-1, 6), [n_wholes])
        return start.changed(wholes, knots if n_knots else np.zeros_like(start.knots))

    weights, inflation = fixed or (np.ones(len(equations)), 1.0)
    unknowns = np.concatenate([start.wholes, start.knots[:n_knots]]).ravel()
    for _ in range(MOST_STEPS):
        whitened = equations.whitened(equations.residuals(corrected(unknowns)))
        if fixed is None:
            weights, inflation = _reweighted(whitened)
        weighted = diags_array(np.repeat(weights / inflation**2, 6)) @ design
        factor = splu(
            csc_array(design.T @ weighted + prior), permc_spec="MMD_AT_PLUS_A",
            options={"SymmetricMode": True}, diag_pivot_thresh=0.0,
        )  # fmt: skip
        step = factor.solve(weighted.T @ whitened.ravel() - prior @ (unknowns / scales))
        unknowns = unknowns + step * scales
        if not np.abs(step).max(initial=0.0) > AT_REST:
            break
    residuals, scaled = equations.residuals(corrected(unknowns)), unknowns / scales
    squares = (equations.whitened(residuals) ** 2).sum(axis=1) @ (weights / inflation**2)
    log_determinant = float(np.log(np.abs(factor.U.diagonal())).sum())
    evidence = 0.5 * (log_prior - squares - float(scaled @ (prior @ scaled)) - log_determinant)
    return Adjusted(corrected(unknowns), drift_sigma, residuals, weights, inflation, float(evidence), scales, factor)


def _reweighted(whitened: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Weights of constraints (n,) and their inflation, from whitened residuals (n, 6)."""
    squares = (whitened**2).sum(axis=1)
    inflation = max(1.0, math.sqrt(float(np.median(squares)) / USUAL_SQUARE))
    weights = (FREEDOM + 6.0) / (FREEDOM + squares / inflation**2)
    return np.minimum(weights, 1.0), inflation


def _prior(corrections: Corrections, *, has_drift: bool) -> tuple[Any, float]:
    """Inverse covariance of the scaled unknowns a priori, its log determinant; drifts are Gauss-Markov processes."""
    from scipy.sparse import block_diag, diags_array, eye_array, kron

    parts, log_determinant = [eye_array(6 * len(corrections.centres))], 0.0
    for step, n in zip(corrections.steps, np.diff(corrections.firsts).tolist(), strict=True):
        if has_drift:
            correlation = math.exp(-step / CORRELATION_TIME)
            left = 1.0 - correlation * correlation
            diagonal = np.full(n, (1.0 + correlation * correlation) / left)
            diagonal[[0, -1]] = 1.0 / left
            beside = np.full(n - 1, -correlation / left)
            parts.append(kron(diags_array([beside, diagonal, beside], offsets=[-1, 0, 1]), eye_array(6)))
            log_determinant -= 6.0 * (n - 1) * math.log(left)
    return block_diag(parts, format="csc"), log_determinant
