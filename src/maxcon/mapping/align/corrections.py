# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Corrections: how each pass is moved, as a whole and, if it drifts, as a function of time."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from maxcon.geometry import Pose
from maxcon.mapping.align.passes import Passes


@dataclass(frozen=True, slots=True, eq=False)
class Corrections:
    """Motions of passes that bring them together; each is a twist: a shift (m) and a rotation vector (rad).

    Each pass is shifted and turned about its centre, as a whole. In addition it has knots at regular times, each with
    a twist about the mean of the points measured then; between two knots their twists are interpolated linearly. All
    points of one pass and time are moved by the same rigid motion.
    """

    centres: NDArray[np.float64]  # (r, 3): Centres of the passes, global, m
    wholes: NDArray[np.float64]  # (r, 6): Twist of each pass about its centre
    starts: NDArray[np.float64]  # (r,): Time of the first knot of each pass, s
    steps: NDArray[np.float64]  # (r,): Time between two knots of each pass, s
    # (r + 1,): Number of the first knot of each pass; the last entry is the number of all knots
    firsts: NDArray[np.int64]
    knot_centres: NDArray[np.float64]  # (k, 3): Centres of the knots, global, m
    knots: NDArray[np.float64]  # (k, 6): Twist of each knot about its centre

    @classmethod
    def none(cls, passes: Passes, spacing: float) -> Self:
        """Corrections that move nothing yet, with knots at most `spacing` (s) apart."""
        n_knots = [1 + int(np.ceil((each.end - each.start) / spacing)) for each in passes]
        starts = np.array([each.start for each in passes])
        steps = np.array([(each.end - each.start) / (n - 1) for each, n in zip(passes, n_knots, strict=True)])
        knot_centres = [
            np.column_stack([np.interp(start + step * np.arange(n), each.times, axis) for axis in each.middles.T])
            for each, start, step, n in zip(passes, starts, steps, n_knots, strict=True)
        ]
        firsts = np.concatenate([[0], np.cumsum(n_knots)])
        centres = np.array([each.centre for each in passes])
        wholes, knots = np.zeros((len(passes), 6)), np.zeros((int(firsts[-1]), 6))
        return cls(centres, wholes, starts, steps, firsts, np.concatenate(knot_centres), knots)

    def changed(self, wholes: NDArray[np.float64], knots: NDArray[np.float64]) -> Self:
        """The same with other twists."""
        return replace(self, wholes=wholes, knots=knots)

    @property
    def n_passes(self) -> int:
        """How many passes there are."""
        return len(self.centres)

    def _between(
        self, times: NDArray[np.float64], passes: NDArray[np.integer]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Number of the knot before each time, shape (n,), and the weight of the next one, 0 to 1."""
        n_knots = np.diff(self.firsts)[passes]
        steps = (times - self.starts[passes]) / self.steps[passes]
        before = np.clip(np.floor(steps), 0, n_knots - 2).astype(np.int64)
        return self.firsts[passes] + before, np.clip(steps - before, 0.0, 1.0)

    def derivatives(
        self, place: NDArray[np.float64], time: float, number: int
    ) -> list[tuple[int, NDArray[np.float64]]]:
        """Derivatives of the twist at a place (global, m) that pass `number` measured at a time (s).

        Unknowns are numbered six by six: the twist of each pass as a whole, then that of each knot. Returned are the
        first column of the six unknowns of the pass and of each knot that takes part, and the derivatives (6, 6).
        """
        first, part = self._between(np.array([time]), np.array([number]))
        blocks = [(6 * number, twist_matrix(place - self.centres[number]))]
        for knot, weight in ((int(first[0]), 1.0 - float(part[0])), (int(first[0]) + 1, float(part[0]))):
            if weight > 0.0:
                block = weight * twist_matrix(place - self.knot_centres[knot])
                blocks.append((6 * (self.n_passes + knot), block))
        return blocks

    def motions(
        self, times: NDArray[np.float64], passes: NDArray[np.integer]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Rigid motions of points at times, (n,), s, of passes, (n,).

        Returned are (n, 3) each: centre of rotation (global, m), shift (m), rotation vector (rad).
        """
        from scipy.spatial.transform import Rotation

        first, part = self._between(times, passes)
        part = part[:, None]
        about = (1.0 - part) * self.knot_centres[first] + part * self.knot_centres[first + 1]
        shifts = np.zeros_like(about)
        for knots, parts in ((first, 1.0 - part), (first + 1, part)):
            turned = np.cross(self.knots[knots, 3:], about - self.knot_centres[knots])
            shifts += parts * (self.knots[knots, :3] + turned)
        turns = (1.0 - part) * self.knots[first, 3:] + part * self.knots[first + 1, 3:]
        wholes, arms = self.wholes[passes], about - self.centres[passes]
        shifts += wholes[:, :3] + Rotation.from_rotvec(wholes[:, 3:]).apply(arms) - arms
        return about, shifts, turns + wholes[:, 3:]

    def moved(
        self, points: NDArray[np.float64], times: NDArray[np.float64], passes: NDArray[np.integer]
    ) -> NDArray[np.float64]:
        """Where points, shape (n, 3), global, m, measured at times, (n,), s, by passes, (n,), lie after correction."""
        from maxcon.mapping.kernels import move

        moved = np.empty((len(points), 3))
        move(
            np.ascontiguousarray(points, np.float64), np.asarray(times, np.float64), np.asarray(passes, np.int64),
            self.centres, self.wholes, self.starts, self.steps, self.firsts, self.knot_centres, self.knots, moved,
        )  # fmt: skip
        return moved

    def twist_at(self, place: NDArray[np.float64], time: float, number: int) -> NDArray[np.float64]:
        """Twist, shape (6,), by which pass `number` moves a place (3,), global, m, that it measured at a time (s)."""
        times, passes = np.array([time]), np.array([number])
        turn = self.motions(times, passes)[2][0]
        return np.concatenate([self.moved(place[None], times, passes)[0] - place, turn])


def pose_of_twist(twist: NDArray[np.float64]) -> Pose:
    """The rigid motion of a shift (m) and a rotation vector (rad), shape (6,)."""
    from scipy.spatial.transform import Rotation

    return Pose.from_rotation(twist[:3], Rotation.from_rotvec(twist[3:]).as_matrix())


def twist_matrix(arm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrix (6, 6) from a small twist about a centre to the twist of a point that lies `arm` (3,), m, from it."""
    x, y, z = arm.tolist()
    matrix = np.eye(6)
    matrix[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return matrix
