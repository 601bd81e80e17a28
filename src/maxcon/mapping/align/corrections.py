# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Corrections: how each round is moved, as a whole and, if it drifts, as a function of time."""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from maxcon.mapping.align.rounds import Rounds

__all__ = ["Corrections", "Share", "rotated", "twist_matrix"]


class Share(NamedTuple):
    """Part of a knot in the motion of a point: number of the knot, its centre (global, m), and its weight, 0 to 1."""

    number: int
    centre: NDArray[np.float64]
    part: float


@dataclass(frozen=True, slots=True, eq=False)
class Corrections:
    """Motions of rounds that bring them together; each is a twist: a shift (m) and a rotation vector (rad).

    Each round is shifted and turned about its centre, as a whole. In addition it has knots at regular times, each with
    a twist about the mean of the points measured then; between two knots their twists are interpolated linearly. All
    points of one round and time are moved by the same rigid motion.

    Parameters
    ----------
    centres : array, shape (r, 3)
        Centres of the rounds, global, m.
    wholes : array, shape (r, 6)
        Twist of each round about its centre.
    starts : array, shape (r,)
        Time of the first knot of each round, s.
    steps : array, shape (r,)
        Time between two knots of each round, s.
    firsts : array, shape (r + 1,), int64
        Number of the first knot of each round; the last entry is the number of all knots.
    knot_centres : array, shape (k, 3)
        Centres of the knots, global, m.
    knots : array, shape (k, 6)
        Twist of each knot about its centre.
    """

    centres: NDArray[np.float64]
    wholes: NDArray[np.float64]
    starts: NDArray[np.float64]
    steps: NDArray[np.float64]
    firsts: NDArray[np.int64]
    knot_centres: NDArray[np.float64]
    knots: NDArray[np.float64]

    @classmethod
    def none(cls, rounds: Rounds, spacing: float) -> Self:
        """Corrections that move nothing yet.

        Parameters
        ----------
        rounds : Rounds
            The rounds.
        spacing : float
            Largest time between two knots, s.
        """
        n_knots = [1 + int(np.ceil((each.end - each.start) / spacing)) for each in rounds.rounds]
        starts = np.array([each.start for each in rounds.rounds])
        steps = np.array([(each.end - each.start) / (n - 1) for each, n in zip(rounds.rounds, n_knots, strict=True)])
        knot_centres = [
            np.column_stack([np.interp(start + step * np.arange(n), each.times, axis) for axis in each.middles.T])
            for each, start, step, n in zip(rounds.rounds, starts, steps, n_knots, strict=True)
        ]
        firsts = np.concatenate([[0], np.cumsum(n_knots)])
        centres = np.array([each.centre for each in rounds.rounds])
        none = np.zeros((len(rounds), 6)), np.zeros((int(firsts[-1]), 6))
        return cls(centres, none[0], starts, steps, firsts, np.concatenate(knot_centres), none[1])

    def changed(self, wholes: NDArray[np.float64], knots: NDArray[np.float64]) -> Self:
        """The same with other twists."""
        return replace(self, wholes=wholes, knots=knots)

    @property
    def n_rounds(self) -> int:
        """How many rounds there are."""
        return len(self.centres)

    def _between(
        self, times: NDArray[np.float64], rounds: NDArray[np.integer]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Number of the knot before each time, shape (n,), and how much of the next one counts, 0 to 1."""
        n_knots = np.diff(self.firsts)[rounds]
        steps = (times - self.starts[rounds]) / self.steps[rounds]
        before = np.clip(np.floor(steps), 0, n_knots - 2).astype(np.int64)
        return self.firsts[rounds] + before, np.clip(steps - before, 0.0, 1.0)

    def shares(self, time: float, number: int) -> list[Share]:
        """Return the knots that move what round `number` measured at a time (s), with their weights."""
        before, parts = self._between(np.array([time]), np.array([number]))
        first, part = int(before[0]), float(parts[0])
        return [
            Share(first + k, self.knot_centres[first + k], share)
            for k, share in ((0, 1.0 - part), (1, part))
            if share > 0.0
        ]

    def motions(
        self, times: NDArray[np.float64], rounds: NDArray[np.integer]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Rigid motions of points, (n, 3) each: centre of rotation (global, m), shift (m), rotation vector (rad).

        Parameters
        ----------
        times : array, shape (n,)
            s.
        rounds : array, shape (n,)
            Numbers of their rounds.
        """
        first, part = self._between(times, rounds)
        part = part[:, None]
        about = (1.0 - part) * self.knot_centres[first] + part * self.knot_centres[first + 1]
        shifts = np.zeros_like(about)
        for knots, parts in ((first, 1.0 - part), (first + 1, part)):
            turned = np.cross(self.knots[knots, 3:], about - self.knot_centres[knots])
            shifts += parts * (self.knots[knots, :3] + turned)
        turns = (1.0 - part) * self.knots[first, 3:] + part * self.knots[first + 1, 3:]
        wholes, arms = self.wholes[rounds], about - self.centres[rounds]
        shifts += wholes[:, :3] + rotated(arms, wholes[:, 3:]) - arms
        return about, shifts, turns + wholes[:, 3:]

    def moved(
        self, points: NDArray[np.float64], times: NDArray[np.float64], rounds: NDArray[np.integer]
    ) -> NDArray[np.float64]:
        """Where points lie after correction, shape (n, 3), global, m.

        Parameters
        ----------
        points : array, shape (n, 3)
            Global, m.
        times : array, shape (n,)
            s.
        rounds : array, shape (n,)
            Numbers of their rounds.
        """
        from maxcon.mapping.align.correction_kernels import move

        moved = np.empty((len(points), 3))
        move(
            np.ascontiguousarray(points, np.float64), np.asarray(times, np.float64), np.asarray(rounds, np.int64),
            self.centres, self.wholes, self.starts, self.steps, self.firsts, self.knot_centres, self.knots, moved,
        )  # fmt: skip
        return moved

    def twist_at(self, place: NDArray[np.float64], time: float, number: int) -> NDArray[np.float64]:
        """Twist, shape (6,), by which round `number` moves a place (3,), global, m, that it measured at a time (s)."""
        times, rounds = np.array([time]), np.array([number])
        turn = self.motions(times, rounds)[2][0]
        return np.concatenate([self.moved(place[None], times, rounds)[0] - place, turn])


def rotated(vectors: NDArray[np.float64], turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors turned by rotation vectors (rad), both of shape (n, 3), exactly (Rodrigues)."""
    squares = np.einsum("ni,ni->n", turns, turns)
    angles = np.sqrt(squares)
    is_small = angles < 1e-6
    safe = np.where(is_small, 1.0, angles)
    once = np.where(is_small, 1.0, np.sin(safe) / safe)[:, None]
    twice = np.where(is_small, 0.5, (1.0 - np.cos(safe)) / (safe * safe))[:, None]
    crossed = np.cross(turns, vectors)
    return vectors + once * crossed + twice * np.cross(turns, crossed)


def twist_matrix(arm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrix (6, 6) from a small twist about a centre to the twist of a point that lies `arm` (3,), m, from it."""
    x, y, z = arm.tolist()
    matrix = np.eye(6)
    matrix[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return matrix
