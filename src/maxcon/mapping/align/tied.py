# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Which rounds are tied to each other, how well, and in words which are not."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.align.matching import Tie
from maxcon.mapping.align.pose_graph import Adjusted, Georeference
from maxcon.mapping.align.residuals import is_contradicted
from maxcon.mapping.align.rounds import Rounds

__all__ = ["RoundTied", "datum_sigma", "tied_rounds"]

OPEN_SHARE = 0.5
"""A round is open along a direction in which its standard deviation exceeds this share of its prior's."""


@dataclass(frozen=True, slots=True)
class RoundTied:
    """The correction of one round, and how well the other rounds determine it.

    Parameters
    ----------
    name : str
        Name of the round.
    n_ties : int
        Ties of its visits that the others do not contradict.
    group : int
        Number of its connected component in the graph of ties; 0 is the largest one.
    shift : array, shape (3,)
        By which its centre was moved, in the middle of its time, m.
    turn : array, shape (3,)
        Rotation vector by which it was turned there, rad.
    sigma : array, shape (3,)
        Standard deviations of that position along x, y and z, m, relative to the mean of the others of its group.
    words : str
        What the ties leave open, for the user; empty where it is nothing.
    """

    name: str
    n_ties: int
    group: int
    shift: NDArray[np.float64]
    turn: NDArray[np.float64]
    sigma: NDArray[np.float64]
    words: str


def tied_rounds(rounds: Rounds, ties: Sequence[Tie], adjusted: Adjusted, georeference: Georeference) -> list[RoundTied]:
    """Say of every round how it is tied to the others.

    Parameters
    ----------
    rounds : Rounds
        All rounds.
    ties : sequence of Tie
        Without a fault.
    adjusted : Adjusted
        From these ties.
    georeference : Georeference
        The prior.
    """
    used = [tie for tie, weight in zip(ties, adjusted.weights.tolist(), strict=True) if not is_contradicted(weight)]
    groups = _groups(len(rounds), used)
    found = []
    for number, each in enumerate(rounds.rounds):
        n_ties = sum(number in tie.rounds for tie in used)
        others = [other for other, group in enumerate(groups) if group == groups[number] and other != number]
        covariance = _beside(rounds, number, others, adjusted)
        twist = adjusted.corrections.twist_at(each.centre, _middle(rounds, number), number)
        words = _words(rounds, number, others, groups, covariance, georeference)
        sigma = np.sqrt(np.diag(covariance))
        found.append(RoundTied(each.name, n_ties, groups[number], twist[:3], twist[3:], sigma, words))
    return found


def datum_sigma(rounds: Rounds, adjusted: Adjusted) -> float:
    """Standard deviation of a common shift of all rounds along a horizontal axis, m: only their priors limit it."""
    place = np.average(
        [each.centre for each in rounds.rounds], axis=0, weights=[each.n_points for each in rounds.rounds]
    )
    rows = np.mean(
        [adjusted.twist_rows(place, _middle(rounds, number), number)[:2] for number in range(len(rounds))], axis=0
    )
    return math.sqrt(float(np.trace(adjusted.covariance(rows))) / 2.0)


def _middle(rounds: Rounds, number: int) -> float:
    times = rounds.rounds[number].times
    return float(times[len(times) // 2])


def _groups(n_rounds: int, ties: Sequence[Tie]) -> list[int]:
    """Number of the group of each round, the largest group first."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = np.array([tie.rounds for tie in ties], np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n_rounds, n_rounds))
    _, labels = connected_components(graph, directed=False)
    sizes = np.bincount(labels)
    rank = np.empty(len(sizes), np.int64)
    rank[np.lexsort((np.arange(len(sizes)), -sizes))] = np.arange(len(sizes))
    return [int(group) for group in rank[labels]]


def _beside(rounds: Rounds, number: int, others: Sequence[int], adjusted: Adjusted) -> NDArray[np.float64]:
    """Covariance of a round's position relative to the mean of others, at its centre, shape (3, 3), m^2."""
    place = rounds.rounds[number].centre
    rows = adjusted.twist_rows(place, _middle(rounds, number), number)[:3]
    if others:
        rows = rows - np.mean(
            [adjusted.twist_rows(place, _middle(rounds, other), other)[:3] for other in others], axis=0
        )
    return adjusted.covariance(rows)


def _words(
    rounds: Rounds,
    number: int,
    others: Sequence[int],
    groups: Sequence[int],
    covariance: NDArray[np.float64],
    georeference: Georeference,
) -> str:
    name = rounds.rounds[number].name
    if not others:
        return f"{name} ({rounds.rounds[number].n_points:,} points) cannot be tied to any other: it stays where it was"
    if groups[number] > 0:
        names = ", ".join(rounds.rounds[other].name for other in others)
        return f"{name} is tied to {names} only, not to the other rounds"
    variances, axes = np.linalg.eigh(covariance)
    if math.sqrt(variances[-1]) > OPEN_SHARE * georeference.sigma:
        x, y, z = axes[:, -1].tolist()
        along = "in height" if abs(z) > 0.7 else f"along {math.degrees(math.atan2(y, x)) % 180.0:.0f} degrees from +x"
        return f"{name} is not tied {along}: it stays near where it was there, to {math.sqrt(variances[-1]):.3f} m"
    return ""
