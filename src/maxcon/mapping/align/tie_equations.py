# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""TieEquations: residuals of ties and how they change with the corrections, whatever is known of these a priori."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.align.corrections import Corrections, rotated, twist_matrix
from maxcon.mapping.align.matching import Tie

__all__ = ["TieEquations"]


class TieEquations:
    """The equations that n ties add to an adjustment.

    Unknowns are numbered six by six: the twist of each round as a whole, then that of each knot.

    Parameters
    ----------
    corrections : Corrections
        Rounds and knots; their twists are those at which an adjustment starts.
    ties : sequence of Tie
        Without a fault.
    """

    def __init__(self, corrections: Corrections, ties: Sequence[Tie]) -> None:
        self.corrections = corrections
        self._ties = ties
        self.n_whole = 6 * corrections.n_rounds
        """Unknowns of rounds as wholes; those of knots come behind."""
        roots = [np.linalg.inv(np.linalg.cholesky(tie.covariance)) for tie in ties]
        self._roots = np.array(roots).reshape(-1, 6, 6)
        self._times = np.array([tie.times for tie in ties]).reshape(-1, 2)
        self._rounds = np.array([tie.rounds for tie in ties], np.int64).reshape(-1, 2)
        self._places = np.array([tie.place for tie in ties]).reshape(-1, 3)
        self._positions = np.array([tie.pose.position for tie in ties]).reshape(-1, 3)
        self._poses = _rotations(ties)

    def __len__(self) -> int:
        return len(self._ties)

    def blocks(self, place: NDArray[np.float64], time: float, number: int) -> list[tuple[int, NDArray[np.float64]]]:
        """Derivatives of the twist of what round `number` measured at a place (global, m) and a time (s).

        Returns
        -------
        list of (int, array of shape (6, 6))
            First column of the six unknowns of the round or of a knot, and the derivatives by them.
        """
        blocks = [(6 * number, twist_matrix(place - self.corrections.centres[number]))]
        blocks += [
            (self.n_whole + 6 * share.number, share.part * twist_matrix(place - share.centre))
            for share in self.corrections.shares(time, number)
        ]
        return blocks

    def residuals(self, corrections: Corrections) -> NDArray[np.float64]:
        """Twists by which the second visits would still have to be moved onto the first, shape (n, 6), m and rad."""
        from scipy.spatial.transform import Rotation

        if not self._ties:
            return np.empty((0, 6))
        shifts, turns = [], []
        for side in range(2):
            about, moved, vectors = corrections.motions(self._times[:, side], self._rounds[:, side])
            arms = self._places - about
            shifts.append(moved + rotated(arms, vectors) - arms)
            turns.append(Rotation.from_rotvec(vectors))
        # first @ pose @ second.inverse: where it takes the origin, and how it turns
        at = self._poses.apply(turns[1].apply(-shifts[1], inverse=True)) + self._positions
        together = turns[0] * self._poses * turns[1].inv()
        return np.column_stack([turns[0].apply(at) + shifts[0], together.as_rotvec()])

    def whitened(self, residuals: NDArray[np.float64]) -> NDArray[np.float64]:
        """Residuals (n, 6) in units of the ties' standard deviations, uncorrelated, shape (n, 6)."""
        if not self._ties:
            return residuals
        return np.asarray(np.einsum("nij,nj->ni", self._roots, residuals))

    def design(self, scales: NDArray[np.float64]) -> Any:
        """Negative derivatives of whitened residuals by the first unknowns, each divided by its scale.

        Parameters
        ----------
        scales : array, shape (n_unknowns,)
            Of all unknowns that take part: those of the wholes only, where rounds are rigid.

        Returns
        -------
        csr_array, shape (6 n, n_unknowns)
        """
        from scipy.sparse import csr_array

        values, rows, columns = self._entries
        takes_part = columns < len(scales)
        values, rows, columns = values[takes_part], rows[takes_part], columns[takes_part]
        return csr_array((values * scales[columns], (rows, columns)), shape=(6 * len(self), len(scales)))

    @cached_property
    def _entries(self) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
        """Entries of the design by all unknowns, not scaled: value, row and column, (k,) each; some cells twice."""
        values, rows, columns = [np.empty(0)], [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        row, column = (index.ravel() for index in np.indices((6, 6)))
        for number, (tie, root) in enumerate(zip(self._ties, self._roots, strict=True)):
            for sign, time, of_round in zip((-1.0, 1.0), tie.times, tie.rounds, strict=True):
                for at, block in self.blocks(tie.place, time, of_round):
                    values.append((sign * root @ block).ravel())
                    rows.append(6 * number + row)
                    columns.append(at + column)
        return np.concatenate(values), np.concatenate(rows), np.concatenate(columns)


def _rotations(ties: Sequence[Tie]) -> Any:
    """Rotations of the poses of ties; None if there is none."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(np.array([tie.pose.rotation for tie in ties])) if ties else None
