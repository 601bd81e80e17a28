"""What a cell is worth: functions of the moments its matches added (D5).

A new objective is a class with one method, ``score(moments)``; nothing has to be registered. Pictures use its ``title``
and the ``unit`` of its scores, if it has them. The moments of a cell are count, Nxx, Nxy and Nyy: the number of its
matches and the normal matrix N = sum of w n n^T over them (equation (4)).
"""

from __future__ import annotations

import traceback
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from maxcon.errors import ArrayError, OptionError

Moments = NDArray[np.floating]
Scores = NDArray[np.float64]

# The products of float32 normals are exact to about 1e-7; a determinant below a few of these is noise.
SINGULAR_RATIO = 1e-6


class Objective(Protocol):
    """Anything that scores moments; higher is better, and 0 is worth nothing."""

    def score(self, moments: Moments) -> Scores:
        """Scores, shape (...), of moments, shape (..., 4): count, Nxx, Nxy, Nyy. Never NaN.

        Branch and bound refuses negative scores: it looks for ratios to the best one.
        """
        ...


@runtime_checkable
class BoundedByCount(Objective, Protocol):
    """An objective that branch and bound can bound by the number of matches; it depends on that only."""

    def bound_by_count(self, count: Scores) -> Scores:
        """Most that a cell with at most so many matches scores; never falls when the count grows."""
        ...


@runtime_checkable
class BoundedByAxes(Objective, Protocol):
    """An objective that branch and bound can bound by N along two axes; it depends on N only."""

    def bound_by_axes(self, along_u: Scores, along_v: Scores) -> Scores:
        """Most that a cell scores whose N has u^T N u and v^T N v of at most this.

        Holds for any orthonormal u and v, and for scores as they are computed, rounding included. Never falls when one
        of the two grows.
        """
        ...


Bounded = BoundedByCount | BoundedByAxes  # an objective that branch and bound can bound


def scores_of(objective: Objective, moments: Moments) -> Scores:
    """Checked scores, (...), of moments, (..., 4); where a user's own raises, `OptionError` with its file and line."""
    name = f"{type(objective).__module__}.{type(objective).__qualname__}"
    try:
        scores = objective.score(moments)
    except Exception as error:  # the user's own code may fail in any way
        if name.startswith("maxcon."):
            raise
        way = traceback.extract_tb(error.__traceback__)[1:]
        place = next((f" in {at.filename}, line {at.lineno}" for at in way[::-1] if at.filename == way[0].filename), "")
        raise OptionError(
            f"Expected {name} to score moments, got {type(error).__name__}: {error}{place}. Mend it there."
        ) from error
    return checked_scores(scores, moments.shape[:-1], name)


def checked_scores(scores: Scores, shape: tuple[int, ...], name: str = "an objective") -> Scores:
    """Return scores of an objective of a name; `ArrayError` if they have another shape, or one is no number."""
    scores = np.asarray(scores)
    if scores.shape != shape or scores.dtype.kind not in "biuf":
        raise ArrayError(
            f"Expected {name} to return scores of shape {shape}, got {scores.shape} of {scores.dtype}."
            " Reduce the last axis of the moments only."
        )
    if scores.size and np.isnan(scores.max()):
        raise ArrayError(f"Expected scores of {name} that are numbers, got NaN. Let it return 0 where it has none.")
    return scores


@dataclass(frozen=True, slots=True)
class Checked:
    """An objective whose scores are checked for shape, NaN and negative values: a user's own may return anything."""

    objective: Objective

    def score(self, moments: Moments) -> Scores:
        """Scores, shape (...), of moments, shape (..., 4); `ArrayError` if they are not as promised."""
        scores = scores_of(self.objective, moments)
        if scores.min(initial=0) < 0:
            raise ArrayError(
                f"Expected scores of 0 or more where ratios to the best one are looked for, got {scores.min():g}. Let"
                " the objective return 0 where a cell is worth nothing, or search given cells exhaustively."
            )
        return scores


# Scores are computed from N with an error of a few times 2^-52 of its largest eigenvalue squared in det N, which is
# above SINGULAR_RATIO of that: less than 1e-9 of the score.
ROUNDING = 1.0 + 1e-9


def _eigenvalues(moments: Moments) -> tuple[Scores, Scores]:
    """Return smaller and larger eigenvalue of N; the smaller is 0 where it cannot be told from rounding."""
    nxx, nxy, nyy = (moments[..., channel].astype(np.float64) for channel in (1, 2, 3))
    middle = 0.5 * (nxx + nyy)
    larger = middle + np.hypot(0.5 * (nxx - nyy), nxy)
    determinant = nxx * nyy - nxy * nxy
    is_regular = determinant > SINGULAR_RATIO * larger * larger
    smaller = np.divide(determinant, larger, out=np.zeros_like(larger), where=is_regular)
    return smaller, larger


@dataclass(frozen=True)
class Count:
    """The number of matches, Psi of equation (2)."""

    name: ClassVar[str] = "count"
    title: ClassVar[str] = "Count"
    unit: ClassVar[str] = "matches"

    def score(self, moments: Moments) -> Scores:
        """Scores, shape (...), of moments, shape (..., 4)."""
        return moments[..., 0].astype(np.float64)

    def bound_by_count(self, count: Scores) -> Scores:
        """The count itself."""
        return count


@dataclass(frozen=True)
class Helmert:
    """1 / tr(Q), the inverse square of Helmert's point error, equation (6).

    Equal to det N / tr N, and to n1 n2 / (n1 + n2) for the eigenvalues n1, n2 of N; 0 where the
    matches leave a direction undetermined: where one eigenvalue is below a millionth of the other.
    """

    name: ClassVar[str] = "helmert"
    title: ClassVar[str] = "Helmert's score"
    unit: ClassVar[str] = "1/tr Q"

    def score(self, moments: Moments) -> Scores:
        """Scores, shape (...), of moments, shape (..., 4)."""
        smaller, larger = _eigenvalues(moments)
        return np.divide(smaller * larger, smaller + larger, out=np.zeros_like(larger), where=smaller > 0.0)

    def bound_by_axes(self, along_u: Scores, along_v: Scores) -> Scores:
        """Nuu Nvv / (Nuu + Nvv): det N <= Nuu Nvv, and the trace is the same in any axes (design section 3)."""
        total = along_u + along_v
        bound = np.divide(along_u * along_v, total, out=np.zeros_like(total), where=total > 0.0)
        return bound * ROUNDING


@dataclass(frozen=True)
class MaxEigenvalue:
    """1 / max(lambda_1, lambda_2) of Q, the paper's first loss: the smallest eigenvalue of N."""

    name: ClassVar[str] = "max-eigenvalue"
    title: ClassVar[str] = "Smallest eigenvalue of N"
    unit: ClassVar[str] = "1/max λ of Q"

    def score(self, moments: Moments) -> Scores:
        """Scores, shape (...), of moments, shape (..., 4)."""
        return _eigenvalues(moments)[0]

    def bound_by_axes(self, along_u: Scores, along_v: Scores) -> Scores:
        """The smaller of Nuu and Nvv: the smallest eigenvalue is the least u^T N u of any axis."""
        return np.minimum(along_u, along_v) * ROUNDING


OBJECTIVES = (Count(), Helmert(), MaxEigenvalue())
"""Objectives with names, in the order of the paper: what studies compare and the command line offers."""


def as_objective(objective: Objective | str) -> Objective:
    """Return an objective as it is, or the one of a name; `OptionError` if it is neither."""
    if not isinstance(objective, str | type) and callable(getattr(objective, "score", None)):
        return objective
    named: dict[str, Objective] = {each.name: each for each in OBJECTIVES}
    if isinstance(objective, str) and objective in named:
        return named[objective]
    *others, last = (repr(name) for name in named)
    raise OptionError(
        f"Expected `objective` to be {', '.join(others)}, {last} or an object with `score(moments)`, got {objective!r}."
    )
