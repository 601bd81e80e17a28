"""Estimate: what a method answers for one epoch, and in which words it fails."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.search.space import Cell


class Status(StrEnum):
    """How far an estimate may be trusted; the values are the words a user reads, `explanation` says what to do.

    Only a pose that is LOCALIZED may be used. Which rule gives which word: docs/decisions/trust-and-status.md.
    """

    LOCALIZED = "localized"
    UNDETERMINED = "undetermined"
    AT_RIM = "at the rim"
    AMBIGUOUS = "ambiguous"
    WALLS_MISSING = "walls missing"
    NOT_CONFIRMED = "not confirmed"
    MISFIT = "misfit"
    FEW_MATCHES = "few matches"
    NO_MATCH = "no match"
    NO_POINTS = "no points"
    NO_PRIOR = "no prior"
    OUTSIDE_MAP = "outside the map"
    LOST = "lost"
    NOT_CONVERGED = "not converged"
    UNREADABLE = "unreadable scan"
    FAILED = "failed"

    @property
    def explanation(self) -> str:
        """What happened and what to do about it, in a sentence."""
        return _EXPLANATIONS[self]


_EXPLANATIONS = {
    Status.LOCALIZED: "The best cell lies inside the search space and its matches determine x and y.",
    Status.UNDETERMINED: "The matches leave a direction open (a single wall, a bare street): do not use x and y.",
    Status.AT_RIM: "The scores still rise at the rim of the search space: the true pose may lie outside. Widen it.",
    Status.AMBIGUOUS: "Another place scores nearly as high: the scan fits there too. Search a smaller part of the map,"
    " or first mend what the reason beside it names.",
    Status.WALLS_MISSING: "Of the walls that the scan sees in one direction hardly any stand in the map there: the"
    " pose fits the others only, or the place has changed. See the reason beside it.",
    Status.NOT_CONFIRMED: "Adjusted to the surfaces of the map the pose moves away from the best cell, or few surfaces"
    " carry it: the place may be right, the centimetres are not.",
    Status.MISFIT: "The scan does not fit the map as one taken there would: it is distorted, the map is off, or the"
    " place only looks alike. See the reason beside it.",
    Status.FEW_MATCHES: "Few of the scan's points match the map even at the best cell: was it taken elsewhere than was"
    " searched, or is the map old or thin?",
    Status.NO_MATCH: "No place was found where the scan matches: was it taken in the map, and is the height right?",
    Status.NO_POINTS: "The scan has no point within the range limits (--min-range, --max-range, in metres).",
    Status.NO_PRIOR: "The prior trajectory has no pose at, or closely around, the time of the scan"
    " (--max-gap, --time-offset).",
    Status.OUTSIDE_MAP: "The prior lies outside the map.",
    Status.LOST: "The track has no place yet that enough scans agree on, or none any more: it looks around the prior"
    " until it has. The reason beside it says which. Without a prior: `maxcon relocalize`.",
    Status.NOT_CONVERGED: "The iteration did not come to rest within its limit: start nearer, or allow more steps.",
    Status.UNREADABLE: "The scan cannot be read: see the reason beside it.",
    Status.FAILED: "The method ended with an error: see the reason beside it.",
}


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The answer of a method for one epoch.

    Parameters
    ----------
    pose : Pose
        T_map_sensor, local frame of the map: refined, or that of the best cell. The prior where nothing matched.
    score : float
        Worth of the best cell, in units of the objective.
    cell : tuple of 3 int, or None
        (heading, y, x) of the best cell in the search space; None for a method without cells, an open space, and an
        answer outside of the space.
    status : Status
        Whether the pose may be used, with words.
    cofactor : array, shape (2, 2)
        Q = N^-1 of x and y at the best cell (equation (4)): the covariance up to the variance factor, in
        units of one match's variance. Infinite on the diagonal where the matches leave a direction open.
    share : float
        Ratio of the searched points that match the map at the best cell, 0 to 1.
    runner_up : float
        Helmert's score of the second best candidate, farther than a guard radius away, over that of the best cell: near
        0 where the answer is distinct, near 1 where it is ambiguous. In given cells it is proved that no other scores
        more, and it is exact if it exceeds `Trust.largest_runner_up`. In an open space it is the highest ratio of
        another adjusted candidate, of scores or, if less, of scores times shares; and at least the ratio that large
        cells prove of all places that were not followed (D11).
    reason : str
        Why the answer, of whatever status, is to be doubted: what is unusual about the scan or about the matches that
        carry it, in words; empty if nothing is.
    covariance : array, shape (6, 6)
        Of x, y, z, roll, pitch and heading, map axes, m^2, m rad and rad^2; infinite on the diagonal where it is not
        known.
    protection_level : tuple of 2 float
        Along and across the vehicle's heading: the error is larger with at most the method's stated risk, m; infinite
        where that is not known.
    was_widened : bool
        Whether the answer was in doubt and searched for again, farther around.
    """

    pose: Pose
    score: float
    cell: Cell | None
    status: Status
    cofactor: NDArray[np.float64]
    share: float = 0.0
    runner_up: float = math.inf
    reason: str = ""
    covariance: NDArray[np.float64] = field(default_factory=lambda: np.diag(np.full(6, np.inf)))
    protection_level: tuple[float, float] = (math.inf, math.inf)
    was_widened: bool = False

    def __repr__(self) -> str:
        return f"Estimate({self.status.value}, {self.pose}, score={self.score:.6g}, reason={self.reason!r})"

    @property
    def is_localized(self) -> bool:
        """Whether the pose may be used."""
        return self.status is Status.LOCALIZED

    @property
    def helmert_point_error(self) -> float:
        """sqrt(tr Q): Helmert's point error, in units of one match's standard deviation."""
        return float(np.sqrt(np.trace(self.cofactor)))
