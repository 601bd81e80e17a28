# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Alignment: what bringing the rounds of a campaign together leaves."""

from collections.abc import Mapping
from dataclasses import dataclass

from maxcon.mapping.align.matching import Tie
from maxcon.mapping.align.pose_graph import Adjusted
from maxcon.mapping.align.residuals import PairResiduals, pair_residuals
from maxcon.mapping.align.rounds import Rounds
from maxcon.mapping.align.tied import RoundTied

__all__ = ["Alignment"]


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """The outcome of an alignment.

    Parameters
    ----------
    rounds : Rounds
        All rounds.
    ties : tuple of Tie
        Matched pairs of visits that are used.
    refused : mapping of str to int
        Number of the other matched pairs, by the reason why they are not used (`Tie.fault`).
    adjusted : Adjusted
        Corrections of the rounds, and what remains.
    tied : tuple of RoundTied
        For each round: its correction, how sure that is, and which rounds it is tied to.
    sigma_before, sigma_of_round : float
        Standard deviation of one round's position relative to the others, along a horizontal axis, m, before and after.
    sigma_of_map : float
        Standard deviation of a map of all rounds, that is of their mean, along a horizontal axis, m: from the
        differences that remain between rounds and their mean drift, which no match reveals; without `sigma_of_datum`.
    sigma_of_datum : float
        Standard deviation of a shift common to all rounds, m: only their priors, not their matches, determine it.
    """

    rounds: Rounds
    ties: tuple[Tie, ...]
    refused: Mapping[str, int]
    adjusted: Adjusted
    tied: tuple[RoundTied, ...]
    sigma_before: float
    sigma_of_round: float
    sigma_of_map: float
    sigma_of_datum: float

    @property
    def pairs(self) -> list[PairResiduals]:
        """Residuals of each pair of rounds."""
        return pair_residuals(self.ties, self.adjusted)
